"""The bus over Eclipse Zenoh. The only module that imports zenoh."""

from __future__ import annotations

import ctypes
import json
import logging
import os
import queue
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar

import zenoh

from mecazen.bus.base import Bus, Handler, Publisher, Reply, StoppedError, decode_sample
from mecazen.bus.endpoints import is_open
from mecazen.config import LIVELINESS, BusConfig, join_key
from mecazen.errors import BusError
from mecazen.keys import TOPICS, Call, Topic
from mecazen.messages import Message
from mecazen.wire import (
    ENCODINGS,
    MAX_SAMPLE_BYTES,
    Format,
    RefusedError,
    Stamp,
    decode,
    encode,
)

MessageT = TypeVar("MessageT", bound=Message)
RequestT = TypeVar("RequestT", bound=Message)
AnswerT = TypeVar("AnswerT", bound=Message)

logger = logging.getLogger(__name__)

Mode = Literal["router", "peer", "client"]
SAMPLE_BYTES = 500
"""About what a sample that waits needs besides its payload."""
BACKLOG_BYTES = 1 << 26
"""So much waits at most of a topic of which every sample is wanted."""
WAITING_SAMPLES = 16
"""So many wait at most of any other: the newest that is good is taken."""
WAITING_QUERIES = 100
"""So many wait at most of a key that is queried."""

THREADS = "(rx: (worker_threads: 1), net: (handover: rx), acc: (handover: rx))"
"""What a service receives is little and comes in turns: more threads only wake each other."""

CONNECT_MS = 10_000
"""So long a service that can work through the router alone tries to reach it; tools do once."""

BETWEEN_PAUSES = 0.1
"""Of a pause: so long it takes to receive what has gathered in it."""

AUTHORITY = "ca"
"""The name of the certificate authority's own certificate, in a folder of keys."""
OPERATOR = "operator"
"""Whose certificate the tools use."""

SIGNAL_CHECK_S = 0.2
"""A signal just before a wait does not end it: Python handles it after so long."""


def session_config(
    config: BusConfig,
    mode: Mode,
    name: str = OPERATOR,
    *,
    most_hz: float | None = None,
    robots: Sequence[str] = ("",),
) -> zenoh.Config:
    """Return Zenoh's configuration: loopback, no multicast, unless `config` says otherwise.

    A router listens where the others connect to. A peer listens on a free port of loopback
    and is found by gossip through the router. A client only connects. With `config.keys` each
    shows the certificate of its `name`. A router with `most_hz` takes from each link no more
    samples a second of a topic, where there are several `robots`, of a topic of each.

    Raises:
        BusError: A file can't be read, or strangers would get in.
    """
    if config.zenoh_config is None:
        base = zenoh.Config()
        listen: tuple[str, ...] | None = config.listen or (
            "tls/127.0.0.1:0" if config.keys else "tcp/127.0.0.1:0",
        )
    else:
        try:
            base = zenoh.Config.from_file(str(config.zenoh_config))
        except zenoh.ZError as error:
            raise BusError(
                f"{config.zenoh_config}: not a Zenoh configuration: {_reason(error)}"
            ) from None
        listen = config.listen
    meeting = config.router_endpoints
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": config.multicast_scouting,
        "scouting/delay": 0,
        # it pays from a megabyte on, and has a thread that wakes twenty times a second
        "transport/shared_memory/enabled": False,
    }
    if mode == "router":
        settings["listen/endpoints"] = meeting
        # what no service would take is not worth its way to all of them
        settings["low_pass_filter"] = [
            {
                "id": "size of samples",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": [f"**/{topic.key}" for topic in TOPICS],
                "size_limit": MAX_SAMPLE_BYTES,
            }
        ]
        if most_hz is not None:
            settings["downsampling"] = [
                {
                    "id": "rate of samples",
                    "flows": ["ingress"],
                    "messages": ["put"],
                    # two keys of one rule share its rate: physics tells of all robots at once
                    "rules": [
                        {"key_expr": f"**/{join_key(topic.key, robot)}", "freq": most_hz}
                        for robot in robots
                        for topic in TOPICS
                    ],
                }
            ]
    else:
        settings["connect/endpoints"] = meeting
        # a router that starts late or comes back is found again within 0.2 s
        settings["connect/retry"] = {
            "period_init_ms": 50,
            "period_max_ms": 200,
            "period_increase_factor": 1.5,
        }
        settings["listen/endpoints"] = listen if mode == "peer" else ()
        if config.mode == "client" and name != OPERATOR:
            settings["connect/timeout_ms"] = CONNECT_MS
        if config.namespace is not None:
            settings["namespace"] = config.namespace
    if config.keys is not None:
        settings["transport/link/protocols"] = ["tls"]
        settings["transport/link/tls"] = _certificates(config.keys, name)
    for key, value in settings.items():
        if value is not None:
            base.insert_json5(key, json.dumps(value))
    if mode != "client":
        _refuse_strangers(base, mode, insecure=config.insecure)
    return base


def _certificates(folder: Path, name: str) -> dict[str, Any]:
    """Return Zenoh's settings by which both ends of a link show certificates.

    Raises:
        BusError: The folder has none for `name`.
    """
    authority, certificate, key = (
        folder / file for file in (f"{AUTHORITY}.crt", f"{name}.crt", f"{name}.key")
    )
    for file in (authority, certificate, key):
        if not os.access(file, os.R_OK):
            raise BusError(f"{file}: can't be read; `mecazen keys create` makes such files")
    return {
        "root_ca_certificate": str(authority),
        "enable_mtls": True,
        "listen_certificate": str(certificate),
        "listen_private_key": str(key),
        "connect_certificate": str(certificate),
        "connect_private_key": str(key),
    }


def _refuse_strangers(base: zenoh.Config, mode: Mode, *, insecure: bool) -> None:
    """Look at where a peer or a router meets others: on loopback, or by certificates.

    Raises:
        BusError: Elsewhere, and it is not said that this is meant.
    """
    mutual_tls = base.get_json("transport/link/tls/enable_mtls") == "true"
    for way in ("listen", "connect"):
        endpoints = json.loads(base.get_json(f"{way}/endpoints"))
        if isinstance(endpoints, dict):
            endpoints = endpoints.get(mode) or ()
        for endpoint in endpoints:
            if not is_open(endpoint, mutual_tls=mutual_tls):
                continue
            what = f"{way} endpoint {endpoint} of a {mode} is beyond loopback and without TLS"
            if not insecure:
                raise BusError(
                    f"{what}: give bus.keys and take tls/…, or allow it by bus.insecure = true"
                )
            logger.warning("msg=%r", f"{what}: whoever reaches it drives the robot")


def open_session(
    config: BusConfig,
    mode: Mode,
    name: str = OPERATOR,
    *,
    most_hz: float | None = None,
    robots: Sequence[str] = ("",),
) -> zenoh.Session:
    """Open a Zenoh session; see `session_config`.

    Raises:
        BusError: A port is taken, or a client finds nobody to connect to.
    """
    os.environ.setdefault("ZENOH_RUNTIME", THREADS)  # read once, by a process's first session
    try:
        return zenoh.open(session_config(config, mode, name, most_hz=most_hz, robots=robots))
    except zenoh.ZError as error:
        endpoints = ", ".join(config.router_endpoints or (str(config.zenoh_config),))
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

    def __init__(
        self,
        config: BusConfig,
        mode: Mode | None = None,
        *,
        lossless: bool = False,
        name: str = OPERATOR,
        gather_s: float = 0.0,
    ) -> None:
        """Open the session.

        Args:
            config: Where to meet, the namespace and the format.
            mode: A peer talks directly to the others; a client goes through the router; where
                nothing is said, as `config` has it.
            lossless: A full link holds the publisher up instead of dropping samples.
            name: Whose certificate it shows, where there are certificates.
            gather_s: Samples may come so much later, many at once: for who is in no hurry, so
                that those who send need not wake it for each [s].

        Raises:
            BusError: See `open_session`.
        """
        super().__init__()
        self._pause = _Pause(gather_s) if gather_s else None
        self._format: Format = config.format
        self._congestion = (
            zenoh.CongestionControl.BLOCK if lossless else zenoh.CongestionControl.DROP
        )
        self._queue: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._refusals = _Refusals(self._queue, self.refuse)
        self._session = open_session(config, mode or config.mode, name)
        self._tokens: list[zenoh.LivelinessToken] = []

    def _make_namespaced(self) -> ZenohBus:
        """Return a bus of the same session and queue."""
        bus = copy(self)
        Bus.__init__(bus)
        bus._tokens = []
        bus._refusals = _Refusals(self._queue, bus.refuse)
        return bus

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return what publishes on a topic."""
        return _ZenohPublisher(
            self._session.declare_publisher(
                self._prefix + topic.key,
                encoding=ENCODINGS[self._format],
                congestion_control=self._congestion,
            ),
            self._format,
        )

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        """Deliver samples of a topic to `handler`, the latest or every one."""
        key = self._prefix + topic.key

        def check(sample: zenoh.Sample) -> tuple[MessageT, Stamp | None]:
            if str(sample.key_expr) != key:
                # an expression that holds this key may be allowed to who may not put on it
                raise RefusedError("put on another key expression")
            return decode_sample(
                topic.type,
                sample.payload.to_bytes(),
                str(sample.encoding),
                None if sample.attachment is None else sample.attachment.to_bytes(),
            )

        def take(sample: zenoh.Sample) -> bool:
            try:
                decoded = check(sample)
            except RefusedError as refusal:
                self.refuse(topic.key, str(refusal))
                return False
            handler(*decoded)
            return True

        def is_good(sample: zenoh.Sample) -> bool:
            try:
                check(sample)
            except RefusedError as refusal:
                refuse(str(refusal))
                return False
            return True

        def receive(sample: zenoh.Sample) -> None:
            if len(sample.payload) > MAX_SAMPLE_BYTES:
                refuse(f"payload of more than {MAX_SAMPLE_BYTES} bytes")
            else:
                keep(sample)

        refuse = partial(self._refusals.add, topic.key)
        if every:
            full = partial(refuse, f"more than {BACKLOG_BYTES} bytes wait")
            keep = _Backlog(self._queue, take, BACKLOG_BYTES, full).receive
        else:
            keep = _Inbox(self._queue, take, is_good).receive
        self._declare_subscriber(topic.key, receive)

    def subscribe_bytes(
        self,
        key: str,
        handler: Callable[[str, bytes, str, bytes | None], None],
        backlog_bytes: float = BACKLOG_BYTES,
    ) -> None:
        """Deliver every sample of a key expression as key, payload, encoding and attachment.

        What comes while more than `backlog_bytes` wait is refused: it slows down nobody and
        fills nothing.
        """

        def take(sample: zenoh.Sample) -> None:
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
            name = str(sample.key_expr).removeprefix(self._prefix)
            handler(name, sample.payload.to_bytes(), str(sample.encoding), attachment)

        full = partial(self._refusals.add, key, f"more than {backlog_bytes:.0f} bytes wait")
        self._declare_subscriber(key, _Backlog(self._queue, take, backlog_bytes, full).receive)

    def _declare_subscriber(self, key: str, keep: Callable[[zenoh.Sample], None]) -> None:
        receive = keep if self._pause is None else self._pause.after(keep)
        try:
            self._session.declare_subscriber(self._prefix + key, _direct(receive))
        except zenoh.ZError as error:
            raise BusError(f"{key!r} is not a key expression: {_reason(error)}") from None

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on any key."""
        self._session.put(
            self._prefix + key,
            payload,
            encoding=encoding or None,
            attachment=attachment,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        """Answer queries on a call's key."""
        key = self._prefix + call.key
        waiting = threading.Semaphore(WAITING_QUERIES)

        def receive(query: zenoh.Query) -> None:
            if waiting.acquire(blocking=False):
                self._queue.put(partial(take, query))
            else:
                reason = f"{WAITING_QUERIES} queries wait"
                self._refusals.add(call.key, reason)
                _ZenohReply(query, key, self._format).refuse(reason)

        def take(query: zenoh.Query) -> None:
            waiting.release()
            reply: _ZenohReply[AnswerT] = _ZenohReply(query, key, self._format)
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                request = self._decode_request(call, payload)
            except RefusedError as refusal:
                reply.refuse(str(refusal))
            else:
                handler(request, reply)

        self._session.declare_queryable(key, _direct(receive))

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Answer queries on `prefix/<path>` with a file's bytes."""

        def answer(query: zenoh.Query) -> None:
            with query:
                for path, data in files.items():
                    key = f"{self._prefix}{prefix}/{path}"
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, data, encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM)

        self._session.declare_queryable(
            f"{self._prefix}{prefix}/**",
            _direct(lambda query: self._queue.put(partial(answer, query))),
        )

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key expression selects, by key."""
        replies = self._session.get(self._prefix + selector, timeout=timeout_s)
        return {
            str(reply.ok.key_expr).removeprefix(self._prefix): reply.ok.payload.to_bytes()
            for reply in replies
            if reply.ok is not None
        }

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key and return the answer."""
        replies = self._session.get(
            self._prefix + call.key,
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
        raise BusError(f"{call.key}: nobody answers; is `mecazen up` running?")

    def declare_alive(self, name: str) -> None:
        """Hold the liveliness token `mecazen/<name>` until the bus is closed.

        Who takes part also watches who else does. Not before: Zenoh answers `alive` from
        what a watching session has heard so far, which is nothing at first.
        """
        if not self._tokens:
            self._session.liveliness().declare_subscriber(
                f"{self._alive_prefix}**", _direct(self._on_liveliness), history=True
            )
        self._tokens.append(self._session.liveliness().declare_token(f"{self._alive_prefix}{name}"))

    @property
    def _alive_prefix(self) -> str:
        return f"{self._prefix}{LIVELINESS}/"

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Ask the network who holds a token; names with a slash are marks of readiness."""
        replies = self._session.liveliness().get(f"{self._alive_prefix}**", timeout=timeout_s)
        return {
            str(reply.ok.key_expr).removeprefix(self._alive_prefix)
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
        name = str(sample.key_expr).removeprefix(self._alive_prefix)
        alive = sample.kind == zenoh.SampleKind.PUT
        self._queue.put(partial(self.presence.update, name, alive=alive))


class _Pause:
    """Holds Zenoh's receiving thread up, so that what comes meanwhile gathers in its socket.

    To wake a thread that sleeps on another core takes a sender 12 to 15 µs, four times as long
    as all else about sending; one that does not wait for its socket is not woken.
    """

    def __init__(self, pause_s: float) -> None:
        self._pause_s = pause_s
        self._next_s = 0.0

    def after(self, keep: Callable[[zenoh.Sample], None]) -> Callable[[zenoh.Sample], None]:
        """Return what keeps a sample and then pauses, once all is kept that had gathered."""

        def receive(sample: zenoh.Sample) -> None:
            keep(sample)
            if time.monotonic() >= self._next_s:
                time.sleep(self._pause_s)
                self._next_s = time.monotonic() + self._pause_s * BETWEEN_PAUSES

        return receive


class _Refusals:
    """Counts what Zenoh's threads refuse, until the service's thread is told of it."""

    def __init__(
        self,
        ready: queue.SimpleQueue[Callable[[], None]],
        tell: Callable[[str, str, int], None],
    ) -> None:
        self._ready = ready
        self._tell = tell
        self._counts: Counter[tuple[str, str]] = Counter()
        self._lock = threading.Lock()

    def add(self, key: str, reason: str) -> None:
        """Count one more, on any thread."""
        with self._lock:
            if not self._counts:
                self._ready.put(self.deliver)
            self._counts[key, reason] += 1

    def deliver(self) -> None:
        """Tell of all that were counted since the last call, on the service's thread."""
        with self._lock:
            counts, self._counts = self._counts, Counter()
        for (key, reason), count in counts.items():
            self._tell(key, reason, count)


class _Inbox:
    """The newest samples of a topic that wait, of which the newest good one is taken.

    A malformed one never takes the place of a good one: where as many wait as are kept, the
    next is let in only if it is good. `receive` runs on Zenoh's threads and `deliver` on the
    service's.
    """

    def __init__(
        self,
        ready: queue.SimpleQueue[Callable[[], None]],
        take: Callable[[zenoh.Sample], bool],
        is_good: Callable[[zenoh.Sample], bool],
    ) -> None:
        self._ready = ready
        self._take = take
        self._is_good = is_good
        self._samples: deque[zenoh.Sample] = deque(maxlen=WAITING_SAMPLES)
        self._announced = False
        self._lock = threading.Lock()

    def receive(self, sample: zenoh.Sample) -> None:
        """Keep a sample, on any thread."""
        if not self._keep(sample, full=False) and self._is_good(sample):
            self._keep(sample, full=True)

    def _keep(self, sample: zenoh.Sample, *, full: bool) -> bool:
        """Keep a sample, where all places are taken only if it may be `full`."""
        with self._lock:
            if len(self._samples) == WAITING_SAMPLES and not full:
                return False
            self._samples.append(sample)
            if not self._announced:
                self._announced = True
                self._ready.put(self.deliver)
            return True

    def deliver(self) -> None:
        """Take the newest sample that is good."""
        with self._lock:
            samples, self._samples = self._samples, deque(maxlen=WAITING_SAMPLES)
            self._announced = False
        while samples and not self._take(samples.pop()):
            pass


class _Backlog:
    """All samples of a subscription that wait, up to a number of bytes."""

    def __init__(
        self,
        ready: queue.SimpleQueue[Callable[[], None]],
        take: Callable[[zenoh.Sample], object],
        limit: float,
        refuse: Callable[[], None],
    ) -> None:
        self._ready = ready
        self._take = take
        self._limit = limit
        self._refuse = refuse
        self._bytes = 0
        self._lock = threading.Lock()

    def receive(self, sample: zenoh.Sample) -> None:
        """Keep a sample if there is place for it, on any thread."""
        size = SAMPLE_BYTES + len(sample.payload)
        with self._lock:
            has_place = self._bytes + size <= self._limit
            if has_place:
                self._bytes += size
        if has_place:
            self._ready.put(partial(self._deliver, sample, size))
        else:
            self._refuse()

    def _deliver(self, sample: zenoh.Sample, size: int) -> None:
        with self._lock:
            self._bytes -= size
        self._take(sample)


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
