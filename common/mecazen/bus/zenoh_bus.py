"""The bus over Eclipse Zenoh."""

from __future__ import annotations

import logging
import queue
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NoReturn

import zenoh

from mecazen.bus.base import (
    Bus,
    Handler,
    Nothing,
    Publisher,
    Reply,
    StoppedError,
    decode_sample,
    deliver,
)
from mecazen.bus.inbox import BACKLOG_BYTES, Backlog, Inbox, Queue, Refusals, next_of
from mecazen.bus.queries import TOO_LONG, QueryInbox, ZenohReply, answer_in, envelope_bytes
from mecazen.bus.receiving import Pause, Sources, direct
from mecazen.bus.session import OPERATOR, Mode, includes, open_session, reason_of
from mecazen.config import LIVELINESS, BusConfig
from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.wire import JSON_ENCODING, MAX_ENVELOPE_BYTES, RefusedError, Stamp, encode

logger = logging.getLogger(__name__)

Sent = tuple[str, bytes, str, bytes | None]
"""Key, payload, encoding and attachment of a sample."""


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
        gather_s: float = 0.0,
        renamed: Mapping[str, str] | None = None,
    ) -> None:
        """Open the session.

        Args:
            config: Endpoints and namespace.
            mode: A peer connects directly to the others, a client only to the router. None: the
                mode in `config`.
            name: Name of the certificate that the session shows, if certificates are used.
            gather_s: Maximum delay by which samples gather and arrive together, so that senders
                need not wake this process for each of them [s].
            renamed: Keys on the bus that differ from those of their topics, by topic key.

        Raises:
            BusError: See `open_session`.
        """
        super().__init__(renamed)
        self._pause = Pause(gather_s)
        self._queue: Queue = queue.SimpleQueue()
        self._refusals = Refusals(self._queue, self.refuse)
        self._sources = Sources(self.presence)
        self._heard: dict[tuple[str, bool, str], list[Handler[Any]]] = {}
        """Handlers of each Zenoh subscriber, by full key, `every` and `of`."""
        self._listeners: dict[str, list[Handler[Any]]] = {}
        self._tokens: list[zenoh.LivelinessToken] = []
        self._publishers: dict[str, _ZenohPublisher[Any]] = {}
        self._session = open_session(config, mode or config.mode, name)

    @property
    def queue(self) -> Queue:
        """Queue of the functions that `spin_once` calls."""
        return self._queue

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return a publisher for a topic."""
        key = self.key_of(topic)
        publisher = self._publishers.get(key)
        if publisher is None:
            declared = self._session.declare_publisher(
                key,
                encoding=JSON_ENCODING,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            publisher = _ZenohPublisher(declared, self, topic)
            self._publishers[key] = publisher
        return publisher

    def listeners(self, topic: Topic[Any]) -> list[Handler[Any]]:
        """Return the list of handlers for a topic's samples of this process; callers add to it."""
        return self._listeners.setdefault(topic.key, [])

    def subscribe(
        self,
        topic: Topic[MessageT],
        handler: Handler[MessageT],
        *,
        every: bool = False,
        nothing: Nothing | None = None,
        of: str = "",
    ) -> None:
        """Deliver samples of a topic to `handler`.

        Subscriptions to a key with equal `every` and `of` share one Zenoh subscriber, which decodes
        each sample once.
        """
        handlers = self._heard.setdefault((self.key_of(topic), every, of), [])
        handlers.append(handler)
        if len(handlers) == 1:
            self._hear(topic, handlers, every, nothing, of)

    def _hear(
        self,
        topic: Topic[MessageT],
        handlers: list[Handler[MessageT]],
        every: bool,
        nothing: Nothing | None,
        of: str,
    ) -> None:
        """Subscribe to a topic's samples of other processes."""
        key = self.key_of(topic)
        refuse = partial(self._refusals.add, key)

        def decoded(sample: zenoh.Sample) -> tuple[MessageT, Stamp | None]:
            if str(sample.key_expr) != key:
                # access rules may allow a wildcard to clients that may not publish on this key
                raise RefusedError("put on another key expression")
            return decode_sample(topic, *_content(sample))

        def take(sample: zenoh.Sample) -> bool:
            try:
                if nothing is not None and not sample.payload and sample.attachment is not None:
                    nothing(Stamp.unpack(sample.attachment.to_bytes()))
                    return True
                message, stamp = decoded(sample)
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
                return False
            if stamp is None:
                payload, encoding, _ = _content(sample)
                self.warn_of_unknown_fields(key, payload, encoding, message)
            deliver(handlers, message, stamp)
            return True

        def is_good(sample: zenoh.Sample) -> bool:
            try:
                decoded(sample)
            except RefusedError as refusal:
                refuse(str(refusal))
                return False
            return True

        def receive(sample: zenoh.Sample) -> None:
            if of and self._sources.is_second(of, sample):
                refuse(f"not from {of}, which alone publishes it")
            elif len(sample.payload) > topic.max_bytes:
                refuse(f"payload of more than {topic.max_bytes} bytes")
            elif envelope_bytes(sample) > MAX_ENVELOPE_BYTES:
                refuse(TOO_LONG)
            else:
                keep(sample)

        if every:
            full = partial(refuse, f"more than {BACKLOG_BYTES} bytes wait")
            keep = Backlog(
                self._queue, take, lambda sample: len(sample.payload), BACKLOG_BYTES, full
            ).receive
        else:
            keep = Inbox(self._queue, take, is_good, partial(self._count_lost, key)).receive
        self._declare_subscriber(key, receive, zenoh.Locality.REMOTE)

    def _count_lost(self, key: str, count: int) -> None:
        self.lost[key] += count

    def subscribe_bytes(
        self,
        key: str,
        handler: Callable[[str, bytes, str, bytes | None], None],
        backlog_bytes: float = BACKLOG_BYTES,
    ) -> None:
        """Deliver every sample of a key expression as key, payload, encoding and attachment.

        Samples on keys of ROS are left out, since they repeat other samples. Samples are
        refused if more than `backlog_bytes` would wait.
        """
        refuse = partial(self._refusals.add, key)
        full = partial(refuse, f"more than {backlog_bytes:.0f} bytes wait")
        backlog: Backlog[Sent] = Backlog(
            self._queue, lambda sent: handler(*sent), bytes_of, backlog_bytes, full
        )

        def receive(sample: zenoh.Sample) -> None:
            name = str(sample.key_expr)
            if "::" in name:  # a type of ROS
                return
            if envelope_bytes(sample) > MAX_ENVELOPE_BYTES:
                refuse(TOO_LONG)
                return
            # a Zenoh sample would keep the memory of its whole batch
            backlog.receive((name, *_content(sample)))

        self._declare_subscriber(key, receive, zenoh.Locality.ANY)

    def _declare_subscriber(
        self, key: str, keep: Callable[[zenoh.Sample], None], origin: zenoh.Locality
    ) -> None:
        handler = direct(self._pause.after(keep))
        try:
            self._session.declare_subscriber(key, handler, allowed_origin=origin)
        except zenoh.ZError as error:
            raise BusError(f"{key!r} is not a key expression: {reason_of(error)}") from None

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on any key."""
        self._session.put(
            key,
            payload,
            encoding=encoding or None,
            attachment=attachment,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        """Answer queries on a call's key."""
        key = call.key

        def refuse(query: zenoh.Query, reason: str) -> None:
            self._refusals.add(key, reason)
            ZenohReply(query, key).refuse(reason)

        def take(query: zenoh.Query) -> None:
            reply: ZenohReply[AnswerT] = ZenohReply(query, key)
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                request = self._decode_request(call, payload)
            except RefusedError as refusal:
                reply.refuse(str(refusal))
            else:
                handler(request, reply)

        self._servers[key] = handler
        inbox = QueryInbox(self._queue, key if call.changes else None, take, refuse)
        self._session.declare_queryable(key, direct(inbox.receive))

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Answer queries on `prefix/<path>` with a file's bytes."""
        served = {f"{prefix}/{path}": data for path, data in files.items()}

        def answer(query: zenoh.Query) -> None:
            with query:
                for key, data in served.items():
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, data, encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM)

        def refuse(query: zenoh.Query, reason: str) -> None:
            self._refusals.add(prefix, reason)
            with query:
                query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)

        self._files |= served
        inbox = QueryInbox(self._queue, None, answer, refuse)
        self._session.declare_queryable(f"{prefix}/**", direct(inbox.receive))

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key expression selects, by key."""
        files = {key: data for key, data in self._files.items() if includes(selector, key)}
        if not files:  # otherwise this process serves them
            for reply in self._session.get(selector, timeout=timeout_s):
                if reply.ok is not None:
                    files[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
        return files

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key and return the answer."""
        key = call.key
        if key in self._servers:
            return self._ask(call, request, timeout_s)
        replies = self._session.get(
            key,
            payload=encode(request),
            encoding=JSON_ENCODING,
            timeout=timeout_s,
        )
        return answer_in(replies, call)

    def declare_alive(self, name: str, robot: str = "") -> None:
        """Hold a service's liveliness token until the bus is closed.

        The first call also begins to watch the tokens of other services. An earlier watch would
        falsify `alive`: Zenoh answers it from the tokens that a watching session has received so
        far, and at first it has received none.
        """
        liveliness = self._session.liveliness()
        if not self._tokens:
            watch = direct(self._on_liveliness)
            liveliness.declare_subscriber(f"**/{LIVELINESS}/**", watch, history=True)
        token = join_key(f"{LIVELINESS}/{name}", robot)
        self._tokens.append(liveliness.declare_token(token))

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Query the network for tokens; names that end in `/ready` mark ready services.

        This is for clients, which the router answers. A peer uses `presence`: 6 of 1000 queries of
        a peer with Zenoh 1.10.2 end before all others have answered.
        """
        replies = self._session.liveliness().get(f"**/{LIVELINESS}/**", timeout=timeout_s)
        return {name_of(reply.ok) for reply in replies if reply.ok is not None}

    def spin_once(self, timeout_s: float | None = None) -> bool:
        """Deliver one sample, query or event on this thread."""
        try:
            if timeout_s is None:
                deliver_one = next_of(self._queue)
            elif timeout_s <= 0.0:
                deliver_one = self._queue.get_nowait()
            else:
                deliver_one = self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return False
        deliver_one()
        return True

    def stop(self) -> None:
        """Make the next `spin_once`, or one that waits, raise StoppedError."""
        self._queue.put(_raise_stopped)

    def close(self) -> None:
        """Close the session, which also drops the tokens.

        If another process is frozen, Zenoh gives up after 10 s. This error is only logged, so that
        the reason for which the caller exits stays visible.
        """
        try:
            self._session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            logger.warning("msg=%r", f"the session did not close: {reason_of(error)}")

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        alive = sample.kind == zenoh.SampleKind.PUT
        self._queue.put(partial(self.presence.update, name_of(sample), alive=alive))


class _ZenohPublisher(Publisher[MessageT]):
    """Publishes to other processes, and through the queue to observers in this process."""

    def __init__(
        self,
        publisher: zenoh.Publisher,
        bus: ZenohBus,
        topic: Topic[MessageT],
    ) -> None:
        self._publisher = publisher
        self._source = zenoh.SourceInfo(publisher.id, 0)
        self._listeners = bus.listeners(topic)
        self._ready = bus.queue
        self._refuse = partial(bus.refuse, bus.key_of(topic))
        self._max_bytes = topic.max_bytes

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        attachment = None if stamp is None else stamp.pack()
        payload = encode(message)
        if len(payload) > self._max_bytes:  # no receiver would take it
            self._refuse(f"not sent: {len(payload)} bytes, at most {self._max_bytes}")
            if stamp is not None:
                self.put_nothing(stamp)
            return
        self._publisher.put(payload, attachment=attachment, source_info=self._source)
        if self._listeners:
            self._ready.put(partial(deliver, self._listeners, message, stamp))

    def put_nothing(self, stamp: Stamp) -> None:
        self._publisher.put(b"", attachment=stamp.pack(), source_info=self._source)


def name_of(token: zenoh.Sample) -> str:
    """Return the name of the service that holds a liveliness token, with its robot's name."""
    robot, _, name = str(token.key_expr).rpartition(f"{LIVELINESS}/")
    return f"{robot}{name}"


def bytes_of(sent: Sent) -> int:
    """Return the size of a sample [bytes]."""
    key, payload, encoding, attachment = sent
    return len(key) + len(payload) + len(encoding) + len(attachment or b"")


def _content(sample: zenoh.Sample) -> tuple[bytes, str, bytes | None]:
    """Return payload, encoding and attachment of a sample."""
    attachment = None if sample.attachment is None else sample.attachment.to_bytes()
    return sample.payload.to_bytes(), str(sample.encoding), attachment


def _raise_stopped() -> NoReturn:
    raise StoppedError
