"""The bus within one process: a put reaches every subscriber before it returns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from threading import Event
from typing import Any

from mecazen.bus.base import Bus, Handler, Publisher, Reply, StoppedError, deliver
from mecazen.errors import BusError, RefusedError
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.wire import Stamp


class LocalBus(Bus):
    """Passes messages on without encoding them; only `put_bytes` decodes its payload."""

    hears_itself = True

    def __init__(self, renamed: Mapping[str, str] | None = None) -> None:
        super().__init__(renamed)
        self._handlers: defaultdict[str, list[Handler[Any]]] = defaultdict(list)
        self._topics: dict[str, Topic[Any]] = {}
        self._stopped = Event()

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        return _LocalPublisher(self._handlers[self.key_of(topic)])

    def subscribe(self, topic: Topic[MessageT], handler: Handler[MessageT], **_: Any) -> None:
        """Deliver every sample of a topic to `handler`, in the order of subscription."""
        key = self.key_of(topic)
        self._topics.setdefault(key, topic)
        self._handlers[key].append(handler)

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on `key`, as an external program would."""
        if handlers := self._handlers.get(key):
            try:
                sample = self._decode_sample(self._topics[key], payload, encoding, attachment)
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
            else:
                deliver(handlers, *sample)

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        self._servers[call.key] = handler

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        self._files |= {f"{prefix}/{path}": data for path, data in files.items()}

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key, or `prefix/**`, selects."""
        del timeout_s
        return {key: data for key, data in self._files.items() if fnmatchcase(key, selector)}

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        del timeout_s
        if not self.serves(call):
            raise BusError(f"{call.key}: nobody answers")
        return self._ask(call, request)

    def declare_alive(self, name: str, robot: str = "") -> None:
        self.presence.update(join_key(name, robot), alive=True)

    def spin_once(self, timeout_s: float | None = None) -> bool:
        """Return False: nothing waits within one process."""
        del timeout_s
        if self._stopped.is_set():
            raise StoppedError
        return False

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        for handlers in self._handlers.values():
            handlers.clear()


class _LocalPublisher(Publisher[MessageT]):
    def __init__(self, handlers: list[Handler[Any]]) -> None:
        self._handlers = handlers

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        for handler in self._handlers:
            handler(message, stamp)

    def put_nothing(self, stamp: Stamp) -> None:
        """Do nothing: turns in this process need no report of a missing message."""
