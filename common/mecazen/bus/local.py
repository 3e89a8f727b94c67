"""The bus within one process: no threads, one fixed order of delivery."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from threading import Event
from typing import Any

from mecazen.bus.base import Bus, Handler, Publisher, Reply, StoppedError
from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT
from mecazen.wire import RefusedError, Stamp

Sample = tuple[list[Handler[Any]], Any, Stamp | None]
"""The handlers of a message, the message, and its stamp."""


class LocalBus(Bus):
    """Delivers in the order of publishing, to subscribers in the order of subscribing.

    Messages are immutable and delivered as they are; only what comes through `put_bytes` is
    decoded, as from a wire.
    """

    def __init__(self) -> None:
        super().__init__()
        self._pending: deque[Sample] = deque()
        self._stopped = Event()

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return what publishes on a topic."""
        return _LocalPublisher(self._pending, self._subscribers_of(topic).handlers)

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        """Deliver every sample of a topic to `handler`; none is ever replaced here."""
        del every
        self._subscribers_of(topic).handlers.append(handler)

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on `key`, with the namespace in it if any, as an external program would."""

        def deliver(*_: object) -> None:
            self._deliver_bytes(key, payload, encoding, attachment)

        self._pending.append(([deliver], None, None))

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        """Answer queries on a call's key."""
        self._servers[self._prefix + call.key] = handler

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Keep files for `fetch_files`."""
        self._files |= {f"{self._prefix}{prefix}/{path}": data for path, data in files.items()}

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key, or `prefix/**`, selects."""
        del timeout_s
        selector = self._prefix + selector
        return {
            key.removeprefix(self._prefix): data
            for key, data in self._files.items()
            if fnmatchcase(key, selector)
        }

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key; what is pending is delivered until the answer is there."""
        del timeout_s
        if self._prefix + call.key not in self._servers:
            raise BusError(f"{call.key}: nobody answers")
        return self._ask(call, request)

    def call_bytes(self, call: Call[RequestT, AnswerT], payload: bytes) -> AnswerT:
        """Query a key with bytes, as an external program would."""
        try:
            return self.call(call, self._decode_request(call, payload))
        except RefusedError as refusal:
            raise BusError(f"{call.key}: {refusal}") from None

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
    def __init__(self, pending: deque[Sample], handlers: list[Handler[Any]]) -> None:
        self._pending = pending
        self._handlers = handlers

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        if self._handlers:
            self._pending.append((self._handlers, message, stamp))
