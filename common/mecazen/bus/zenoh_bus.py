"""The bus over Eclipse Zenoh.

On Zenoh's threads samples and queries become functions in one queue. `spin_once` calls them on the
service's thread, which alone decodes: msgspec 0.22 crashed in decoders on Zenoh's threads.
"""

from __future__ import annotations

import ctypes
import logging
import queue
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, NoReturn, TypeVar

import zenoh
from msgspec.structs import replace

from mecazen.bus.base import (
    UNNAMED,
    Bus,
    Handler,
    Nothing,
    Publisher,
    Reply,
    StoppedError,
    decode_sample,
    deliver,
)
from mecazen.bus.session import OPERATOR, ROUTER_ENTRIES, Mode, includes, open_session, reason_of
from mecazen.config import LIVELINESS, BusConfig
from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import JSON_ENCODING, RefusedError, Stamp, decode, encode

SAMPLE_BYTES = 500
"""Approximate memory of a waiting sample besides its content [bytes]."""
BACKLOG_BYTES = 1 << 26
"""Maximum size of the waiting samples of a subscription to bytes [bytes]."""
SENDERS_AT_MOST = 8
"""Maximum number of programs noted on a key."""
WAITING_AT_MOST = 16
"""Maximum number of waiting samples of a subscription that takes the newest valid one."""
SIGNAL_CHECK_S = 0.2
"""Maximum delay of a signal that another thread receives, and so does not end a wait [s]."""

Queue = queue.SimpleQueue[Callable[[], object]]
ItemT = TypeVar("ItemT")
Sent = tuple[str, bytes, str, bytes | None]
"""Key, payload, encoding and attachment of a sample."""

logger = logging.getLogger(__name__)

_thread = threading.local()
"""Marks Zenoh's threads whose Python state is kept; the mark ends with that state."""
ASKED = "", "/publisher/**", "/subscriber/**", "/token/**"
"""The entries of a router that tools ask for, below its own: programs with what they declare."""


class ZenohBus(Bus):
    """A Zenoh session whose samples wait in one queue until `spin_once` delivers them.

    A subscription to a topic receives samples of other processes only; a subscription to bytes
    receives samples of this process as well.
    """

    hears_itself = False

    def __init__(
        self,
        config: BusConfig,
        mode: Mode | None = None,
        *,
        name: str = OPERATOR,
        renamed: Mapping[str, str] | None = None,
    ) -> None:
        """Open the session; raises as `open_session`.

        Args:
            config: Endpoints and namespace.
            mode: A peer connects directly to the others, a client only to the router. None: the
                mode in `config`.
            name: Name of the certificate that the session shows, if certificates are used.
            renamed: Keys on the bus that differ from those of their topics, by topic key.
        """
        super().__init__(renamed)
        self.queue: Queue = queue.SimpleQueue()
        """Functions that `spin_once` calls."""
        self._handlers: dict[tuple[str, bool, str], list[Handler[Any]]] = {}
        """Handlers of each Zenoh subscriber, by key, `every` and `sender`."""
        self._publishers: dict[str, _ZenohPublisher[Any]] = {}
        self._of_bytes: dict[str, zenoh.Publisher] = {}
        self._sources: dict[str, object] = {}
        """The session of each service that alone publishes a topic, by its first sample."""
        self._tokens: list[zenoh.LivelinessToken] = []
        self._config = config
        self.prefix = f"{config.namespace}/" if config.namespace else ""
        """Beginning of all keys outside the session's namespace."""
        self._session = open_session(config, mode or config.mode, name)
        self._outside: zenoh.Session | None = None

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        key = self.key_of(topic)
        if key not in self._publishers:
            declared = self._session.declare_publisher(
                key, encoding=JSON_ENCODING, congestion_control=zenoh.CongestionControl.DROP
            )
            self._publishers[key] = _ZenohPublisher(declared, self, topic)
        return self._publishers[key]

    def listeners(self, topic: Topic[Any]) -> list[Handler[Any]]:
        """Return the list of handlers for a topic's samples of this process; callers add to it."""
        return self._listeners[topic.key]

    def subscribe(
        self,
        topic: Topic[MessageT],
        handler: Handler[MessageT],
        *,
        every: bool = False,
        nothing: Nothing | None = None,
        sender: str = "",
    ) -> None:
        key = self.key_of(topic)
        handlers = self._handlers.setdefault((key, every, sender), [])
        handlers.append(handler)
        if len(handlers) > 1:  # they share a Zenoh subscriber, which decodes each sample once
            return

        def receive(sample: zenoh.Sample) -> None:
            try:
                self._refuse_unread(sample, key, topic.max_bytes, sender)
            except RefusedError as refusal:
                self.queue.put(partial(self.refuse, key, str(refusal)))
            else:
                if topic.open and sample.attachment is None:
                    self._note_sender(key, sample)
                keep(sample)

        def take(sample: zenoh.Sample) -> bool:
            payload, encoding, attachment = _content(sample)
            try:
                if nothing is not None and not payload and attachment is not None:
                    nothing(Stamp.unpack(attachment))
                    return True
                message, stamp = decode_sample(topic, payload, encoding, attachment)
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
                return False
            deliver(handlers, message, stamp)
            return True

        keep = self.keep_every(take) if every else self.keep_newest(take, key)
        self._declare_subscriber(key, receive, zenoh.Locality.REMOTE, self._session)

    def keep_every(self, take: Callable[[ItemT], object]) -> Callable[[ItemT], None]:
        """Return a function for Zenoh's threads: the service's thread takes its items in order."""
        return lambda item: self.queue.put(partial(take, item))

    def keep_newest(self, take: Callable[[ItemT], object], key: str) -> Callable[[ItemT], None]:
        """Return a function as `keep_every`, of whose items only the newest one is taken.

        If `take` returns False for it, the item before it is taken, and so on. Items that newer
        ones replace are counted as lost.
        """
        lock, items, count = threading.Lock(), deque[ItemT](maxlen=WAITING_AT_MOST), 0

        def keep(item: ItemT) -> None:
            nonlocal count
            with lock:
                items.append(item)
                count += 1
                if count == 1:
                    self.queue.put(take_newest)

        def take_newest() -> None:
            nonlocal count
            with lock:
                waiting, lost = list(items), count - 1
                items.clear()
                count = 0
            while waiting and take(waiting.pop()) is False:
                lost -= 1
            if lost > 0:
                self.lost[key] += lost

        return keep

    def _refuse_unread(self, sample: zenoh.Sample, key: str, limit: int, service: str) -> None:
        """Refuse a sample by its size [bytes], its key expression, or its session.

        Access rules may allow a wildcard to clients that may not publish on the key. A program that
        copies the identity of the service's session is accepted; only certificates exclude it.
        """
        if len(sample.payload) > limit:
            raise RefusedError(f"payload of {len(sample.payload)} bytes, at most {limit}")
        if str(sample.key_expr) != key:
            raise RefusedError("put on another key expression")
        source = sample.source_info
        session = None if source is None else source.source_id.zid
        if service and self._sources.setdefault(service, session) != session:
            raise RefusedError(f"not from {service}, which alone publishes it")

    def _note_sender(self, key: str, sample: zenoh.Sample) -> None:
        senders, source = self.senders.setdefault(key, set()), sample.source_info
        if len(senders) < SENDERS_AT_MOST:
            senders.add(UNNAMED if source is None else str(source.source_id.zid))

    def router_entries(self, timeout_s: float = 1.0) -> dict[str, bytes]:
        """Return what the router knows of clients, publishers, subscribers and tokens.

        Keys begin behind `@/<id>/router`, and are those of all namespaces. Ask seldom: a router
        that answers while a program declares something may stop for good, since it locks its tables
        twice (eclipse-zenoh/zenoh, pull request 2619).
        """
        session, router = self._outside_namespace(), ROUTER_ENTRIES.removesuffix("/**")
        return {
            str(reply.ok.key_expr).split("/", 3)[-1]: reply.ok.payload.to_bytes()
            for entries in ASKED
            for reply in session.get(f"{router}{entries}", timeout=timeout_s)
            if reply.ok is not None
        }

    def _outside_namespace(self) -> zenoh.Session:
        """Return a session without the namespace, for admin spaces and keys of strangers."""
        if self._outside is None:
            config = replace(self._config, namespace=None)
            self._outside = open_session(config, "client") if self.prefix else self._session
        return self._outside

    def subscribe_bytes(
        self,
        key: str,
        handler: Callable[[str, bytes, str, bytes | None], None],
        backlog_bytes: float = BACKLOG_BYTES,
        *,
        outside: bool = False,
    ) -> None:
        """Deliver every sample of a key expression as key, payload, encoding and attachment.

        Keys are in the namespace, or `outside` it.

        Samples on keys of ROS are left out, since they repeat other samples. Samples are
        refused if more than `backlog_bytes` would wait.
        """
        lock, waiting_bytes, refused = threading.Lock(), 0, 0

        def receive(sample: zenoh.Sample) -> None:
            nonlocal waiting_bytes, refused
            name = str(sample.key_expr)
            if "::" in name:  # a type of ROS
                return
            # a Zenoh sample would keep the memory of its whole batch
            sent = (name, *_content(sample))
            with lock:
                has_room = waiting_bytes + bytes_of(sent) <= backlog_bytes
                if has_room:
                    waiting_bytes += bytes_of(sent)
                else:
                    refused += 1
            if has_room:
                self.queue.put(partial(take, sent))

        def take(sent: Sent) -> None:
            nonlocal waiting_bytes, refused
            with lock:
                waiting_bytes -= bytes_of(sent)
                count, refused = refused, 0
            if count:
                self.refuse(key, f"more than {backlog_bytes:.0f} bytes wait", count)
            handler(*sent)

        session = self._outside_namespace() if outside else self._session
        self._declare_subscriber(key, receive, zenoh.Locality.ANY, session)

    def _declare_subscriber(
        self,
        key: str,
        receive: Callable[[zenoh.Sample], None],
        origin: zenoh.Locality,
        session: zenoh.Session,
    ) -> None:
        try:
            session.declare_subscriber(key, direct(receive), allowed_origin=origin)
        except zenoh.ZError as error:
            raise BusError(f"{key!r} is not a key expression: {reason_of(error)}") from None

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        if key not in self._of_bytes:  # declared, so that the router can name it
            self._of_bytes[key] = self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.BLOCK
            )
        publisher = self._of_bytes[key]
        publisher.put(
            payload,
            encoding=encoding or None,
            attachment=attachment,
            source_info=zenoh.SourceInfo(publisher.id, 0),
        )

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        key = call.key

        def take(query: zenoh.Query) -> None:
            def answer(message: AnswerT) -> None:
                with query:
                    query.reply(key, encode(message), encoding=JSON_ENCODING)

            def refuse(reason: str) -> None:
                with query:
                    query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)

            if call.changes and str(query.key_expr) != key:
                # a query with a wildcard explores the keys and must not change state
                self.refuse(key, "asked on another key expression")
                refuse("asked on another key expression")
                return
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                request = decode(payload, call.request) if payload.strip() else call.request()
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
                refuse(str(refusal))
            else:
                handler(request, Reply(answer, refuse))

        self._servers[key] = handler
        self._declare_queryable(key, take)

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        served = {f"{prefix}/{path}": data for path, data in files.items()}

        def take(query: zenoh.Query) -> None:
            with query:
                for key, data in served.items():
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, data, encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM)

        self._files |= served
        self._declare_queryable(f"{prefix}/**", take)

    def _declare_queryable(self, key: str, take: Callable[[zenoh.Query], None]) -> None:
        self._session.declare_queryable(key, direct(self.keep_every(take)))

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        files = {key: data for key, data in self._files.items() if includes(selector, key)}
        if not files:  # otherwise this process serves them
            for reply in self._session.get(selector, timeout=timeout_s):
                if reply.ok is not None:
                    files[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
        return files

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        key = call.key
        if key in self._servers:
            return self._ask(call, request, timeout_s)
        replies = self._session.get(
            key, payload=encode(request), encoding=JSON_ENCODING, timeout=timeout_s
        )
        reply = next(iter(replies), None)
        if reply is None:
            raise BusError(f"{key}: nobody answers; is `mecazen up` running?")
        if reply.err is not None:
            reason = reply.err.payload.to_bytes().decode(errors="replace")
            raise BusError(f"{key}: {printable(reason)}")
        assert reply.ok is not None  # a reply is either
        try:
            return decode(reply.ok.payload.to_bytes(), call.answer, str(reply.ok.encoding))
        except RefusedError as refusal:
            raise BusError(f"{key}: the answer is {refusal}") from None

    def declare_alive(self, name: str, robot: str = "") -> None:
        liveliness = self._session.liveliness()
        if not self._tokens:
            # not earlier: Zenoh answers `alive` from the tokens that a watching session has got so
            # far, and at first it has got none
            watch = direct(self._on_liveliness)
            liveliness.declare_subscriber(f"**/{LIVELINESS}/**", watch, history=True)
        token = join_key(f"{LIVELINESS}/{name}", robot)
        self._tokens.append(liveliness.declare_token(token))

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        name, alive = name_of(sample), sample.kind == zenoh.SampleKind.PUT
        self._sources.pop(name, None)  # a service that has restarted has another session
        self.queue.put(partial(self.presence.update, name, alive=alive))

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Query the network for tokens; names that end in `/ready` mark ready services.

        This is for clients, which the router answers. A peer uses `presence`: 6 of 1000 queries of
        a peer with Zenoh 1.10.2 end before all others have answered.
        """
        replies = self._session.liveliness().get(f"**/{LIVELINESS}/**", timeout=timeout_s)
        return {name_of(reply.ok) for reply in replies if reply.ok is not None}

    def spin_once(self, timeout_s: float | None = None) -> bool:
        try:
            if timeout_s is None:
                function = next_of(self.queue)
            elif timeout_s <= 0.0:
                function = self.queue.get_nowait()
            else:
                function = self.queue.get(timeout=timeout_s)
        except queue.Empty:
            return False
        function()
        return True

    def stop(self) -> None:
        self.queue.put(_raise_stopped)

    def close(self) -> None:
        try:
            if self._outside is not None:
                self._outside.close()  # type: ignore[no-untyped-call]
            self._session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            # another process is frozen; the reason for which the caller exits stays visible
            logger.warning("msg=%r", f"the session did not close: {reason_of(error)}")


class _ZenohPublisher(Publisher[MessageT]):
    def __init__(self, publisher: zenoh.Publisher, bus: ZenohBus, topic: Topic[MessageT]) -> None:
        super().__init__(bus.listeners(topic))
        self._publisher = publisher
        self._source = zenoh.SourceInfo(publisher.id, 0)
        self._bus, self._topic = bus, topic

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        attachment = None if stamp is None else stamp.pack()
        payload, limit = encode(message), self._topic.max_bytes
        if len(payload) > limit:  # no receiver would take it
            key = self._bus.key_of(self._topic)
            self._bus.refuse(key, f"not sent: {len(payload)} bytes, at most {limit}")
            if stamp is not None:
                self.put_nothing(stamp)
            return
        self._publisher.put(payload, attachment=attachment, source_info=self._source)
        if self._handlers:
            self._bus.queue.put(partial(deliver, self._handlers, message, stamp))

    def put_nothing(self, stamp: Stamp) -> None:
        self._publisher.put(b"", attachment=stamp.pack(), source_info=self._source)


def direct(function: Callable[[Any], None]) -> Any:
    """Return a handler that runs on Zenoh's receiving thread, which saves a hop.

    It keeps Python's state of that thread. Otherwise Python creates and destroys the state with
    each call, and receiving a sample takes 67 µs of processor time instead of 50.
    """

    def receive(item: Any) -> None:
        if not hasattr(_thread, "is_kept"):
            _thread.is_kept = True
            ctypes.pythonapi.PyGILState_Ensure()
        function(item)

    return zenoh.handlers.Callback(receive, indirect=False)


def next_of(items: queue.SimpleQueue[ItemT]) -> ItemT:
    """Wait for the next item of a queue and return it; a signal handler may also add an item."""
    while True:
        with suppress(queue.Empty):
            return items.get(timeout=SIGNAL_CHECK_S)


def name_of(token: zenoh.Sample) -> str:
    """Return the name of the service that holds a liveliness token, with its robot's name."""
    robot, _, name = str(token.key_expr).rpartition(f"{LIVELINESS}/")
    return f"{robot}{name}"


def bytes_of(sent: Sent) -> int:
    """Return the approximate memory of a waiting sample [bytes]."""
    key, payload, encoding, attachment = sent
    return SAMPLE_BYTES + len(key) + len(payload) + len(encoding) + len(attachment or b"")


def _content(sample: zenoh.Sample) -> tuple[bytes, str, bytes | None]:
    attachment = None if sample.attachment is None else sample.attachment.to_bytes()
    return sample.payload.to_bytes(), str(sample.encoding), attachment


def _raise_stopped() -> NoReturn:
    raise StoppedError
