"""The bus within one process: no threads, one fixed order of delivery."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from threading import Event
from typing import Any, TypeVar

from mecazen.bus.base import Bus, Handler, Publisher, Reply, StoppedError, decode_sample
from mecazen.config import split_key
from mecazen.errors import BusError
from mecazen.keys import Call, Topic
from mecazen.messages import Message
from mecazen.wire import RefusedError, Stamp

MessageT = TypeVar("MessageT", bound=Message)
RequestT = TypeVar("RequestT", bound=Message)
AnswerT = TypeVar("AnswerT", bound=Message)

Sample = tuple[list[Handler[Any]], Any, Stamp | None]
"""A message with its stamp, and those who are to have it."""


class LocalBus(Bus):
    """Delivers in the order of publishing, to subscribers in the order of subscribing.

    Messages are immutable and handed on as they are; only what comes through `put_bytes`
    is decoded, as from a wire.
    """

    def __init__(self) -> None:
        super().__init__()
        self._pending: deque[Sample] = deque()
        self._subscribers: dict[str, list[Handler[Any]]] = {}
        self._topics: dict[str, Topic[Any]] = {}
        self._servers: dict[str, Callable[[Any, Any], None]] = {}
        self._files: dict[str, bytes] = {}
        self._stopped = Event()

    def _make_namespaced(self) -> LocalBus:
        """Return a bus of the same queue."""
        bus = LocalBus()
        bus._pending, bus._stopped = self._pending, self._stopped
        return bus

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return what publishes on a topic."""
        return _LocalPublisher(self._pending, self._subscribers.setdefault(topic.key, []))

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        """Deliver every sample of a topic to `handler`; none is ever overtaken here."""
        del every
        self._topics[topic.key] = topic
        self._subscribers.setdefault(topic.key, []).append(handler)

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on `key` as an outsider would; it may be one of a bus beside this."""
        robot, rest = split_key(key, self._namespaced)
        if robot:
            self._namespaced[robot].put_bytes(rest, payload, encoding, attachment)
            return

        def deliver(*_: object) -> None:
            topic = self._topics.get(key)
            if topic is None:
                return
            try:
                decoded = decode_sample(topic.type, payload, encoding, attachment)
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
            else:
                for handler in self._subscribers[key]:
                    handler(*decoded)

        self._pending.append(([deliver], None, None))

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        """Answer queries on a call's key."""
        self._servers[call.key] = handler

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Keep files for `fetch_files`."""
        self._files.update({f"{prefix}/{path}": data for path, data in files.items()})

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key, or `prefix/**`, selects."""
        del timeout_s
        return {key: data for key, data in self._files.items() if fnmatchcase(key, selector)}

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key; what is pending is delivered until the answer is there."""
        del timeout_s
        return self._ask(call, lambda: request)

    def call_bytes(self, call: Call[RequestT, AnswerT], payload: bytes) -> AnswerT:
        """Query a key with bytes, as an outsider would."""
        return self._ask(call, lambda: self._decode_request(call, payload))

    def _ask(self, call: Call[RequestT, AnswerT], request: Callable[[], RequestT]) -> AnswerT:
        if call.key not in self._servers:
            raise BusError(f"{call.key}: nobody answers")
        reply: _LocalReply[AnswerT] = _LocalReply()
        try:
            self._servers[call.key](request(), reply)
        except RefusedError as refusal:
            reply.refuse(str(refusal))
        while not reply.given and self.spin_once():
            pass
        if reply.error is not None:
            raise BusError(f"{call.key}: {reply.error}")
        if reply.message is None:
            raise BusError(f"{call.key}: not answered")
        return reply.message

    def declare_alive(self, name: str) -> None:
        """Note that `name` is alive."""
        self.presence.update(name, alive=True)

    def spin_once(self, timeout_s: float | None = None) -> bool:
        """Deliver the oldest pending sample; there is nothing to wait for in one thread."""
        del timeout_s
        if self._stopped.is_set():
            raise StoppedError
        if not self._pending:
            return False
        handlers, message, stamp = self._pending.popleft()
        for handler in handlers:
            handler(message, stamp)
        return True

    def spin(self) -> None:
        """Deliver until nothing is pending."""
        while self.spin_once():
            pass

    def stop(self) -> None:
        """Make the next `spin_once` raise StoppedError."""
        self._stopped.set()

    def close(self) -> None:
        """Drop what is pending."""
        self._pending.clear()


class _LocalPublisher(Publisher[MessageT]):
    def __init__(self, pending: deque[Sample], subscribers: list[Handler[Any]]) -> None:
        self._pending = pending
        self._subscribers = subscribers

    def put(self, message: MessageT, stamp: Stamp) -> None:
        if self._subscribers:
            self._pending.append((self._subscribers, message, stamp))


class _LocalReply(Reply[AnswerT]):
    def __init__(self) -> None:
        self.message: AnswerT | None = None
        self.error: str | None = None

    @property
    def given(self) -> bool:
        return self.message is not None or self.error is not None

    def answer(self, message: AnswerT) -> None:
        self.message = message

    def refuse(self, reason: str) -> None:
        self.error = reason
