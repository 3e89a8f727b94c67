"""The bus over Eclipse Zenoh. The only module that imports zenoh."""

from __future__ import annotations

import ctypes
import json
import math
import queue
import re
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, NoReturn, TypeVar

import zenoh

from mecazen.bus.base import Bus, Handler, Publisher, Reply, StoppedError
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Call, Topic
from mecazen.messages import Message
from mecazen.wire import (
    ENCODINGS,
    MAX_PAYLOAD_BYTES,
    Format,
    RefusedError,
    Stamp,
    decode,
    encode,
)

MessageT = TypeVar("MessageT", bound=Message)
RequestT = TypeVar("RequestT", bound=Message)
AnswerT = TypeVar("AnswerT", bound=Message)

Mode = Literal["router", "peer", "client"]
LIVELINESS_PREFIX = "mecazen/"

SAMPLE_BYTES = 500
"""About what a sample that waits needs besides its payload."""

SIGNAL_CHECK_S = 0.2
"""A signal just before a wait does not end it: Python handles it after so long."""


def session_config(config: BusConfig, mode: Mode) -> zenoh.Config:
    """Return Zenoh's configuration: loopback, no multicast, unless `config` says otherwise.

    A router listens where the others connect to. A peer listens on a free port of loopback
    and is found by gossip through the router. A client only connects.

    Raises:
        BusError: The Zenoh configuration file can't be read.
    """
    if config.zenoh_config is None:
        base = zenoh.Config()
        listen: tuple[str, ...] | None = config.listen or ("tcp/127.0.0.1:0",)
    else:
        try:
            base = zenoh.Config.from_file(str(config.zenoh_config))
        except zenoh.ZError as error:
            raise BusError(
                f"{config.zenoh_config}: not a Zenoh configuration: {_reason(error)}"
            ) from None
        listen = config.listen
    meeting = config.meeting_point
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": config.multicast_scouting,
        "scouting/delay": 0,
    }
    if mode == "router":
        settings["listen/endpoints"] = meeting
    else:
        settings["connect/endpoints"] = meeting
        # a router that starts late or comes back is found again within 0.2 s
        settings["connect/retry"] = {
            "period_init_ms": 50,
            "period_max_ms": 200,
            "period_increase_factor": 1.5,
        }
        settings["listen/endpoints"] = listen if mode == "peer" else ()
        if config.namespace is not None:
            settings["namespace"] = config.namespace
    for key, value in settings.items():
        if value is not None:
            base.insert_json5(key, json.dumps(value))
    return base


def open_session(config: BusConfig, mode: Mode) -> zenoh.Session:
    """Open a Zenoh session.

    Raises:
        BusError: A port is taken, or a client finds nobody to connect to.
    """
    try:
        return zenoh.open(session_config(config, mode))
    except zenoh.ZError as error:
        endpoints = ", ".join(config.meeting_point or (str(config.zenoh_config),))
        reason = _reason(error)
        if mode == "router" and "Address already in use" in reason:
            raise BusError(
                f"can't listen on {endpoints}: the port is taken, by another `mecazen up` or "
                "router? (--set bus.connect='[\"tcp/127.0.0.1:PORT\"]' takes another)"
            ) from None
        if mode == "client" and "Unable to connect" in reason:
            raise BusError(f"nothing answers at {endpoints}: is `mecazen up` running?") from None
        where = f"listen on {endpoints}" if mode == "router" else "open the Zenoh session"
        raise BusError(f"can't {where}: {reason}") from None


def includes(expression: str, key: str) -> bool:
    """Return whether a key expression holds a key.

    Raises:
        BusError: It is no key expression.
    """
    try:
        return bool(zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key)))
    except zenoh.ZError as error:
        raise BusError(f"{expression!r} is not a key expression: {_reason(error)}") from None


def _reason(error: zenoh.ZError) -> str:
    """Return what Zenoh says in one line, without the places in its sources."""
    text = re.sub(r"\s+at /\S+\.rs:\d+\.?", "", str(error))
    parsing = re.search(r"-->\s*(\d+):(\d+)\s.*=\s+(.*)", text, re.DOTALL)
    if parsing:
        return f"line {parsing[1]}, column {parsing[2]}: {' '.join(parsing[3].split())}"
    quoted = re.search(r'msg: "((?:[^"\\]|\\.)*)"', text)
    return " ".join((quoted[1] if quoted else text).split())


class ZenohBus(Bus):
    """A Zenoh session whose samples wait in one queue until `spin_once` takes them."""

    def __init__(self, config: BusConfig, mode: Mode = "peer", *, lossless: bool = False) -> None:
        """Open the session.

        Args:
            config: Where to meet, the namespace and the format.
            mode: A peer talks directly to the others; a client goes through the router.
            lossless: A full link holds the publisher up instead of dropping samples.

        Raises:
            BusError: See `open_session`.
        """
        super().__init__()
        self._format: Format = config.format
        self._congestion = (
            zenoh.CongestionControl.BLOCK if lossless else zenoh.CongestionControl.DROP
        )
        self._queue: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._session = open_session(config, mode)
        self._tokens: list[zenoh.LivelinessToken] = []

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return what publishes on a topic."""
        return _ZenohPublisher(
            self._session.declare_publisher(
                topic.key,
                encoding=ENCODINGS[self._format],
                congestion_control=self._congestion,
            ),
            self._format,
        )

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        """Deliver samples of a topic to `handler`, the latest or every one."""

        def take(sample: zenoh.Sample) -> None:
            if len(sample.payload) > MAX_PAYLOAD_BYTES:
                self.refuse(topic.key, f"payload of {len(sample.payload)} bytes")
                return
            decoded = self._decode_sample(
                topic.key,
                topic.type,
                sample.payload.to_bytes(),
                str(sample.encoding),
                None if sample.attachment is None else sample.attachment.to_bytes(),
            )
            if decoded is not None:
                handler(*decoded)

        self._declare_subscriber(topic.key, _Inbox(self._queue, take, every=every).receive)

    def subscribe_bytes(
        self,
        key: str,
        handler: Callable[[str, bytes, str, bytes | None], None],
        backlog_bytes: float = math.inf,
    ) -> None:
        """Deliver every sample of a key expression as key, payload, encoding and attachment.

        What comes while more than `backlog_bytes` wait is refused: it slows down nobody and
        fills nothing.
        """
        backlog = _Backlog(backlog_bytes)

        def take(sample: zenoh.Sample) -> None:
            for name, count in backlog.release(sample).items():
                self.refuse(name, f"more than {backlog_bytes:.0f} bytes wait", count)
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
            handler(
                str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), attachment
            )

        inbox = _Inbox(self._queue, take, every=True)
        self._declare_subscriber(
            key, lambda sample: inbox.receive(sample) if backlog.admit(sample) else None
        )

    def _declare_subscriber(self, key: str, receive: Callable[[zenoh.Sample], None]) -> None:
        try:
            self._session.declare_subscriber(key, _direct(receive))
        except zenoh.ZError as error:
            raise BusError(f"{key!r} is not a key expression: {_reason(error)}") from None

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

        def take(query: zenoh.Query) -> None:
            reply: _ZenohReply[AnswerT] = _ZenohReply(query, call.key, self._format)
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                request = self._decode_request(call, payload)
            except RefusedError as refusal:
                reply.refuse(str(refusal))
            else:
                handler(request, reply)

        self._session.declare_queryable(
            call.key, _direct(lambda query: self._queue.put(partial(take, query)))
        )

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Answer queries on `prefix/<path>` with a file's bytes."""

        def answer(query: zenoh.Query) -> None:
            with query:
                for path, data in files.items():
                    key = f"{prefix}/{path}"
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, data, encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM)

        self._session.declare_queryable(
            f"{prefix}/**", _direct(lambda query: self._queue.put(partial(answer, query)))
        )

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key expression selects, by key."""
        replies = self._session.get(selector, timeout=timeout_s)
        return {
            str(reply.ok.key_expr): reply.ok.payload.to_bytes()
            for reply in replies
            if reply.ok is not None
        }

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key and return the answer."""
        replies = self._session.get(
            call.key,
            payload=encode(request, self._format),
            encoding=ENCODINGS[self._format],
            timeout=timeout_s,
        )
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
        raise BusError(f"{call.key}: nobody answers; is {call.server} running?")

    def declare_alive(self, name: str) -> None:
        """Hold the liveliness token `mecazen/<name>` until the bus is closed.

        Who takes part also watches who else does. Not before: Zenoh answers `alive` from
        what a watching session has heard so far, which is nothing at first.
        """
        if not self._tokens:
            self._session.liveliness().declare_subscriber(
                f"{LIVELINESS_PREFIX}**", _direct(self._on_liveliness), history=True
            )
        self._tokens.append(self._session.liveliness().declare_token(f"{LIVELINESS_PREFIX}{name}"))

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Ask the network who holds a token; names with a slash are marks of readiness."""
        replies = self._session.liveliness().get(f"{LIVELINESS_PREFIX}**", timeout=timeout_s)
        return {
            str(reply.ok.key_expr).removeprefix(LIVELINESS_PREFIX)
            for reply in replies
            if reply.ok is not None
        }

    def spin_once(self, timeout_s: float | None = None) -> bool:
        """Deliver one thing that arrived, on this thread."""
        try:
            if timeout_s is None:
                deliver = self._wait()
            elif timeout_s <= 0.0:
                deliver = self._queue.get_nowait()
            else:
                deliver = self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return False
        deliver()
        return True

    def _wait(self) -> Callable[[], None]:
        while True:
            try:
                return self._queue.get(timeout=SIGNAL_CHECK_S)
            except queue.Empty:
                continue

    def stop(self) -> None:
        """Make a `spin_once` raise StoppedError, also one that waits."""
        self._queue.put(_raise_stopped)

    def close(self) -> None:
        """Leave the bus; the tokens go with the session."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).removeprefix(LIVELINESS_PREFIX)
        alive = sample.kind == zenoh.SampleKind.PUT
        self._queue.put(partial(self.presence.update, name, alive=alive))


class _Inbox:
    """The samples of one subscription that wait: the latest, or every one.

    `receive` runs on Zenoh's threads and `deliver` on the service's. A deque's append and
    popleft are atomic, so no sample is lost between the two: at worst `deliver` is called
    once for nothing.
    """

    def __init__(
        self,
        ready: queue.SimpleQueue[Callable[[], None]],
        take: Callable[[zenoh.Sample], None],
        *,
        every: bool,
    ) -> None:
        self._ready = ready
        self._take = take
        self._every = every
        self._samples: deque[zenoh.Sample] = deque(maxlen=None if every else 1)
        self._announced = False

    def receive(self, sample: zenoh.Sample) -> None:
        self._samples.append(sample)
        if self._every or not self._announced:
            self._announced = True
            self._ready.put(self.deliver)

    def deliver(self) -> None:
        self._announced = False
        try:
            sample = self._samples.popleft()
        except IndexError:
            return
        self._take(sample)


class _Backlog:
    """How many bytes wait, up to a limit, and how many samples came in vain."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._bytes = 0
        self._dropped: Counter[str] = Counter()
        self._lock = threading.Lock()

    def admit(self, sample: zenoh.Sample) -> bool:
        """Return whether there is place for a sample, which then takes it."""
        size = SAMPLE_BYTES + len(sample.payload)
        with self._lock:
            if self._bytes + size > self._limit:
                self._dropped[str(sample.key_expr)] += 1
                return False
            self._bytes += size
            return True

    def release(self, sample: zenoh.Sample) -> Counter[str]:
        """Free the place of a sample; return what was dropped since the last call, by key."""
        with self._lock:
            self._bytes -= SAMPLE_BYTES + len(sample.payload)
            dropped = self._dropped
            if dropped:
                self._dropped = Counter()
            return dropped


class _ZenohPublisher(Publisher[MessageT]):
    def __init__(self, publisher: zenoh.Publisher, form: Format) -> None:
        self._publisher = publisher
        self._format: Format = form

    def put(self, message: MessageT, stamp: Stamp) -> None:
        self._publisher.put(encode(message, self._format), attachment=stamp.pack())


class _ZenohReply(Reply[AnswerT]):
    def __init__(self, query: zenoh.Query, key: str, form: Format) -> None:
        self._query = query
        self._key = key
        self._format: Format = form

    def answer(self, message: AnswerT) -> None:
        with self._query as query:
            query.reply(self._key, encode(message, self._format), encoding=ENCODINGS[self._format])

    def refuse(self, reason: str) -> None:
        with self._query as query:
            query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)


def _direct(function: Callable[[Any], None]) -> Any:
    """Return a handler that runs on Zenoh's receiving thread: one hop less."""

    def call(argument: Any) -> None:
        if not hasattr(_receiving, "kept"):
            _receiving.kept = True
            ctypes.pythonapi.PyGILState_Ensure()
        function(argument)

    return zenoh.handlers.Callback(call, indirect=False)


# Python makes a state for a foreign thread that calls it, with pages of memory for its frames,
# and gives all of it back after the call. Ensuring the state once more than it is released
# keeps it as long as the thread lives, which saves a third of the cost of a sample.
_receiving = threading.local()


def _raise_stopped() -> NoReturn:
    raise StoppedError
