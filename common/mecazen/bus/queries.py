"""Queries over Zenoh: the queue of those that wait, and their answers."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import zenoh

from mecazen.bus.base import Reply
from mecazen.bus.inbox import Queue
from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT
from mecazen.text import printable
from mecazen.wire import (
    JSON_ENCODING,
    MAX_ENVELOPE_BYTES,
    MAX_SAMPLE_BYTES,
    RefusedError,
    decode,
    encode,
)

WAITING_QUERIES = 100
"""Maximum number of queries that wait on a key."""
WAITING_REFUSALS = 1000
"""Maximum number of queries that wait for their refusal; beyond it Zenoh's thread waits."""
TOO_LONG = f"key and attachment of more than {MAX_ENVELOPE_BYTES} bytes"


class Refuser:
    """Refuses queries on a thread of its own.

    Sending may take seconds while a link is full. On the receiving thread it would block all other
    samples, and deadlock if the other end also waits for this end to receive: a client that sent
    queries without pause stopped physics in this way.
    """

    def __init__(self) -> None:
        self._waiting: queue.Queue[Callable[[], None]] = queue.Queue(WAITING_REFUSALS)
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def put(self, refuse: Callable[[], None]) -> None:
        """Queue the refusal of a query; runs on Zenoh's threads."""
        with self._lock:
            if self._thread is None:  # most processes never need it
                self._thread = threading.Thread(target=self._run, name="refuser", daemon=True)
                self._thread.start()
        self._waiting.put(refuse)

    def _run(self) -> None:
        while True:
            refuse = self._waiting.get()
            with suppress(zenoh.ZError):  # the session is closed
                refuse()
            del refuse


_refuser = Refuser()


@dataclass
class QueryInbox:
    """Keeps waiting queries, and refuses those that are oversized or beyond `WAITING_QUERIES`."""

    ready: Queue
    key: str | None
    """The only key expression that is answered; None for any."""
    take: Callable[[zenoh.Query], None]
    """Answers a query, on the service's thread."""
    refuse: Callable[[zenoh.Query, str], None]
    """Refuses a query with a reason, on the refuser's thread."""
    _room: threading.Semaphore = field(
        default_factory=partial(threading.Semaphore, WAITING_QUERIES)
    )

    def receive(self, query: zenoh.Query) -> None:
        """Keep a query if it is valid and there is room for it."""
        if self.key is not None and str(query.key_expr) != self.key:
            # a query with a wildcard explores the keys and must not change state
            self._put_off(query, "asked on another key expression")
        elif len(query.payload or b"") > MAX_SAMPLE_BYTES:
            self._put_off(query, f"payload of more than {MAX_SAMPLE_BYTES} bytes")
        elif envelope_bytes(query) + len(str(query.parameters)) > MAX_ENVELOPE_BYTES:
            self._put_off(query, TOO_LONG)
        elif self._room.acquire(blocking=False):
            self.ready.put(partial(self._deliver, query))
        else:
            self._put_off(query, f"{WAITING_QUERIES} queries wait")

    def _put_off(self, query: zenoh.Query, reason: str) -> None:
        _refuser.put(partial(self.refuse, query, reason))

    def _deliver(self, query: zenoh.Query) -> None:
        self._room.release()
        self.take(query)


def envelope_bytes(one: zenoh.Sample | zenoh.Query) -> int:
    """Return the size of key and attachment [bytes]; Zenoh limits the length of an encoding."""
    return len(str(one.key_expr)) + len(one.attachment or b"")


@dataclass
class ZenohReply(Reply[AnswerT]):
    """Answers one query, on its key."""

    query: zenoh.Query
    key: str

    def answer(self, message: AnswerT) -> None:
        """Answer with a message."""
        with self.query as query:
            query.reply(self.key, encode(message), encoding=JSON_ENCODING)

    def refuse(self, reason: str) -> None:
        """Answer with an error."""
        with self.query as query:
            query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)


def answer_in(replies: Iterable[zenoh.Reply], call: Call[RequestT, AnswerT]) -> AnswerT:
    """Return the first reply to a query.

    Raises:
        BusError: There is no reply, or it is an error or a message of a wrong type.
    """
    for reply in replies:
        if reply.err is not None:
            reason = reply.err.payload.to_bytes().decode(errors="replace")
            raise BusError(f"{call.key}: {printable(reason)}")
        if reply.ok is not None:
            sample = reply.ok
            try:
                return decode(sample.payload.to_bytes(), call.answer, str(sample.encoding))
            except RefusedError as refusal:
                raise BusError(f"{call.key}: the answer is {refusal}") from None
    raise BusError(f"{call.key}: nobody answers; is `mecazen up` running?")
