"""Queries over Zenoh: those that wait for their answer, and the answers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

import zenoh

from mecazen.bus.base import Reply
from mecazen.bus.inbox import Queue
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.messages import Message
from mecazen.wire import ENCODINGS, Format, RefusedError, decode, encode

RequestT = TypeVar("RequestT", bound=Message)
AnswerT = TypeVar("AnswerT", bound=Message)

WAITING_QUERIES = 100
"""So many wait at most of a key that is queried."""


class QueryInbox:
    """Keeps the queries of a key that wait, and refuses those beyond a number.

    Args:
        ready: Takes the calls that answer.
        take: Answers a query, on the service's thread.
        refuse: Called with a query and a reason; runs on Zenoh's threads.
    """

    def __init__(
        self,
        ready: Queue,
        take: Callable[[zenoh.Query], None],
        refuse: Callable[[zenoh.Query, str], None],
    ) -> None:
        self._ready = ready
        self._take = take
        self._refuse = refuse
        self._room = threading.Semaphore(WAITING_QUERIES)

    def receive(self, query: zenoh.Query) -> None:
        """Keep a query if there is room for it."""
        if self._room.acquire(blocking=False):
            self._ready.put(partial(self._deliver, query))
        else:
            self._refuse(query, f"{WAITING_QUERIES} queries wait")

    def _deliver(self, query: zenoh.Query) -> None:
        self._room.release()
        self._take(query)


class ZenohReply(Reply[AnswerT]):
    """Answers one query, on its key."""

    def __init__(self, query: zenoh.Query, key: str, form: Format) -> None:
        self._query = query
        self._key = key
        self._format: Format = form

    def answer(self, message: AnswerT) -> None:
        """Answer with a message."""
        with self._query as query:
            query.reply(self._key, encode(message, self._format), encoding=ENCODINGS[self._format])

    def refuse(self, reason: str) -> None:
        """Answer with an error."""
        with self._query as query:
            query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)


def answer_in(replies: Iterable[zenoh.Reply], call: Call[RequestT, AnswerT]) -> AnswerT:
    """Return the answer that is the first reply to a query.

    Raises:
        BusError: There is none, or it is an error, or not what the call answers.
    """
    for reply in replies:
        if reply.err is not None:
            reason = reply.err.payload.to_bytes().decode(errors="replace")
            raise BusError(f"{call.key}: {reason}")
        if reply.ok is not None:
            sample = reply.ok
            try:
                return decode(sample.payload.to_bytes(), call.answer, str(sample.encoding))
            except RefusedError as refusal:
                raise BusError(f"{call.key}: the answer is {refusal}") from None
    raise BusError(f"{call.key}: nobody answers; is `mecazen up` running?")
