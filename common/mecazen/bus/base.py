"""The bus within one process, and the refusal of invalid data.

A sample reaches every subscriber before `put` returns. `ZenohBus` extends the bus to other
processes.
"""

from __future__ import annotations

import logging
import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from threading import Event
from typing import Any, ClassVar, Generic, cast

from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import RefusedError, Stamp, decode

Handler = Callable[[MessageT, Stamp | None], None]
"""Receives a message and the stamp of its tick; the stamp is None if the publisher sent none."""

Nothing = Callable[[Stamp], None]
"""Receives the stamp of a tick in which a message was due but does not exist."""

DRAINED_AT_MOST = 1000
"""Maximum number of deliveries in one `drain`; more wait only during a flood."""

UNNAMED = "unnamed"
"""Stands for programs whose samples do not name their Zenoh session."""

logger = logging.getLogger(__name__)


class StoppedError(Exception):
    """`Bus.stop` was called."""


class Publisher(Generic[MessageT]):
    """Publishes messages on one key."""

    def __init__(self, handlers: Iterable[Handler[MessageT]]) -> None:
        self._handlers = handlers

    def put(self, message: MessageT, stamp: Stamp | None) -> None:
        """Publish a message with the stamp of its tick, or without one, as external programs do."""
        deliver(self._handlers, message, stamp)

    def put_nothing(self, stamp: Stamp) -> None:
        """Report that a tick has no message although one is due, to other processes."""


@dataclass(frozen=True)
class Reply(Generic[AnswerT]):
    """The answer to one query; it is sent once, now or later."""

    answer: Callable[[AnswerT], None]
    """Answers with a message."""
    refuse: Callable[[str], None]
    """Answers with an error."""


class Presence:
    """The services that are alive, which means that they hold a liveliness token.

    The name of a robot's service begins with the robot's name: `two/controller`.
    """

    def __init__(self) -> None:
        self.known: Container[str] | None = None
        """Names that are noted, since any client can invent names; None: all."""
        self.names: set[str] = set()
        self.returns: Counter[str] = Counter()
        """Number of returns of a service after it had gone, by name."""
        self.on_change: list[Callable[[], None]] = []
        """Functions called after each change."""
        self.on_return: list[Callable[[str], None]] = []
        """Functions called with the name of a service that has returned."""
        self._seen: set[str] = set()

    def update(self, name: str, *, alive: bool) -> None:
        """Note that `name` has come or gone, if it is known."""
        if self.known is not None and name not in self.known:
            return
        if not alive:
            self.names.discard(name)
        elif name not in self.names:
            self.names.add(name)
            if name in self._seen:
                self.returns[name] += 1
                for report in self.on_return:
                    report(name)
            self._seen.add(name)
        for report_change in self.on_change:
            report_change()


class Bus:
    """Publish, subscribe, query, answer and liveliness.

    The bus refuses a payload of a wrong type or size. It counts the refusal in `refused`, logs it
    at most once a second for each key, and does not deliver the payload. So the last valid value
    remains in use.
    """

    hears_itself: ClassVar[bool] = True
    """Whether subscribers receive samples that are published through the same object."""

    def __init__(self, renamed: Mapping[str, str] | None = None) -> None:
        self.renamed = dict(renamed or {})
        """Keys on the bus that differ from those of their topics, by topic key."""
        self.refused: Counter[str] = Counter()
        """Number of refused payloads, by key."""
        self.lost: Counter[str] = Counter()
        """Number of samples that newer ones replaced before delivery, by key."""
        self.senders: dict[str, set[str]] = {}
        """Programs that have published samples without a stamp, by open key: their Zenoh ids, and
        `UNNAMED` for all whose samples have none. Readers remove what they have reported."""
        self.presence = Presence()
        self._logged: dict[str, float] = {}
        """Time of the last line about a key [s]."""
        self._servers: dict[str, Callable[[Any, Any], None]] = {}
        self._files: dict[str, bytes] = {}
        self._listeners: defaultdict[str, list[Handler[Any]]] = defaultdict(list)
        """Handlers of samples that are published through this object, by key."""
        self._topics: dict[str, Topic[Any]] = {}
        self._stopped = Event()

    def key_of(self, topic: Topic[Any]) -> str:
        """Return the key on which a topic's samples are published."""
        return self.renamed.get(topic.key, topic.key)

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        """Return a publisher for a topic."""
        return Publisher(self._listeners[self.key_of(topic)])

    def subscribe(
        self,
        topic: Topic[MessageT],
        handler: Handler[MessageT],
        *,
        every: bool = False,
        nothing: Nothing | None = None,
        sender: str = "",
    ) -> None:
        """Deliver samples of a topic to `handler`.

        Within one process each sample is delivered at once. From other processes, the newest sample
        replaces one that still waits, so a flood causes neither delay nor growth of memory. With
        `every` all samples are kept. `nothing` is called for a tick that has no message. `sender`
        names the only service whose samples are accepted.
        """
        del every, nothing, sender
        key = self.key_of(topic)
        self._topics.setdefault(key, topic)
        self._listeners[key].append(handler)

    def put_bytes(
        self, key: str, payload: bytes, encoding: str = "", attachment: bytes | None = None
    ) -> None:
        """Publish bytes on any key, as an external program would."""
        if key in self._topics:
            try:
                sample = decode_sample(self._topics[key], payload, encoding, attachment)
            except RefusedError as refusal:
                self.refuse(key, str(refusal))
            else:
                deliver(self._listeners[key], *sample)

    def serve(
        self, call: Call[RequestT, AnswerT], handler: Callable[[RequestT, Reply[AnswerT]], None]
    ) -> None:
        """Answer queries on a call's key; an empty request means its defaults."""
        self._servers[call.key] = handler

    def serve_files(self, prefix: str, files: Mapping[str, bytes]) -> None:
        """Answer queries on `prefix/<path>` with a file's bytes."""
        self._files |= {f"{prefix}/{path}": data for path, data in files.items()}

    def fetch_files(self, selector: str, timeout_s: float = 10.0) -> dict[str, bytes]:
        """Return the served files that a key expression selects, by key."""
        del timeout_s
        # a last ** includes no further part as well, as it does in Zenoh
        return {
            key: data
            for key, data in self._files.items()
            if fnmatchcase(key, selector) or fnmatchcase(f"{key}/", selector)
        }

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a key and return the answer.

        A server in this process answers on the calling thread, which must be the thread that
        spins. Samples that arrive before the answer are delivered.

        Raises:
            BusError: No server answers, or the answer is an error.
        """
        del timeout_s
        if call.key not in self._servers:
            raise BusError(f"{call.key}: nobody answers")
        return self._ask(call, request)

    def declare_alive(self, name: str, robot: str = "") -> None:
        """Hold a service's liveliness token until the bus is closed."""
        self.presence.update(join_key(name, robot), alive=True)

    def spin_once(self, timeout_s: float | None = None) -> bool:
        """Deliver one sample, query or event; wait up to `timeout_s`, or without limit if None.

        Returns:
            False if nothing arrived in time, or nothing can arrive any more.

        Raises:
            StoppedError: `stop` was called.
        """
        del timeout_s
        if self._stopped.is_set():
            raise StoppedError
        return False

    def drain(self) -> None:
        """Deliver waiting items, up to `DRAINED_AT_MOST`."""
        for _ in range(DRAINED_AT_MOST):
            if not self.spin_once(0.0):
                return

    def stop(self) -> None:
        """Make the next `spin_once` raise StoppedError; callable from a signal handler."""
        self._stopped.set()

    def close(self) -> None:
        """Leave the bus."""
        for handlers in self._listeners.values():
            handlers.clear()

    def refuse(self, key: str, reason: str, count: int = 1) -> None:
        """Count a payload of a key as refused, and log the refusal at most once a second."""
        self.refused[key] += count
        now = time.monotonic()
        if now - self._logged.get(key, -1.0) >= 1.0:
            self._logged[key] = now
            shown, total = printable(key), self.refused[key]
            logger.warning("msg=refused key=%s count=%d reason=%.300r", shown, total, reason)

    def server(self, call: Call[RequestT, AnswerT]) -> Callable[[RequestT, Reply[AnswerT]], None]:
        """Return the function that answers a call in this process.

        Raises:
            KeyError: The call has no server here.
        """
        return self._servers[call.key]

    def _ask(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = math.inf
    ) -> AnswerT:
        answers: list[Any] = []
        end = time.monotonic() + timeout_s
        self.server(call)(
            request,
            Reply(answers.append, lambda why: answers.append(BusError(f"{call.key}: {why}"))),
        )
        while not answers and (left_s := end - time.monotonic()) > 0.0 and self.spin_once(left_s):
            pass
        if not answers:
            raise BusError(f"{call.key}: not answered")
        if isinstance(answers[0], BusError):
            raise answers[0]
        return cast(AnswerT, answers[0])


def deliver(handlers: Iterable[Handler[MessageT]], message: MessageT, stamp: Stamp | None) -> None:
    """Pass a sample to each handler, in order."""
    for handler in handlers:
        handler(message, stamp)


def decode_sample(
    topic: Topic[MessageT], payload: bytes, encoding: str, attachment: bytes | None
) -> tuple[MessageT, Stamp | None]:
    """Return the message of a topic's sample and its stamp.

    Raises:
        RefusedError: The payload is no message of the topic.
    """
    if len(payload) > topic.max_bytes:
        raise RefusedError(f"payload of {len(payload)} bytes, at most {topic.max_bytes}")
    stamp = None if attachment is None else Stamp.unpack(attachment)
    return decode(payload, topic.type, encoding), stamp
