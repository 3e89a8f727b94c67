"""Clients that send what must be refused, or too much, and one that takes samples too slowly."""

import multiprocessing
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from typing import Any

import zenoh
from harness import COMMAND_GUARD_S
from hostile import Put, damaged
from mecazen import keys
from mecazen.bus.base import decode_sample
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.graph import SERVICES
from mecazen.messages import DiagnosticArray, Message
from mecazen.wire import JSON_ENCODING, RefusedError, decode, encode

SEED = 20
LABELS = (
    "", JSON_ENCODING, "application/cdr", "text/json", "text/plain", "zenoh/bytes",
    "application/json;é", "\x00", "/", "a" * 200,
)  # fmt: skip
CALLS = {call.key: call for call in keys.CALLS}
EXPRESSIONS = ("**", "*", "*/odom", "sim/*", "diagnostics/*", "**/cmd_vel")
SIZES = (1, 15, 16, 17, 40, 2000, 70_000)
"""Sizes of forged attachments [bytes]."""
OPEN_QUERIES = 50
"""Queries that wait for their answers at most: services refuse unread what comes while a hundred
wait."""

OF_A_SESSION = 20_000
"""Payloads that a session sends. Only the first declares liveliness tokens: Zenoh 1.10.2 keeps each
name at both ends of every link over which it has ever gone, and queries take longer with each."""

KINDS = {
    **{topic.key: topic.type for topic in keys.TOPICS if "*" not in topic.key},
    **{keys.diagnostics(name).key: DiagnosticArray for name in SERVICES},
    **{key: call.request for key, call in CALLS.items()},
}
"""Types of messages by key."""


def malformed() -> Iterator[Put]:
    """Damage messages for ever; those that happen to stay valid are skipped."""
    chance = random.Random(SEED)
    while True:
        key, kind = chance.choice([*KINDS.items()])
        # a stamp is 16 or 20 bytes
        sizes = (16, 20, chance.randrange(40)) if chance.randrange(10) == 0 else ()
        attachment = chance.randbytes(chance.choice(sizes)) if sizes else None
        put = Put(key, damaged(chance, encode(kind())), chance.choice(LABELS), attachment)
        if _is_refused(put, kind):
            yield put


def _is_refused(put: Put, kind: type[Message]) -> bool:
    topic = keys.topic_of(put.key)
    with suppress(RefusedError):
        if topic is not None:
            decode_sample(topic, *put[1:])
        elif put.payload.strip():  # a query may be empty
            decode(put.payload, kind)
        return False
    return True


class Intruder:
    """Sends payloads that must be refused: malformed, or good ones in a wrong way.

    Args:
        open_session: Opens the session of a client.
    """

    def __init__(self, open_session: Callable[[], Any]) -> None:
        self._open_session = open_session
        self._session = open_session()
        self._random = random.Random(SEED)
        self._malformed = malformed()
        self._puts = [(key, encode(kind())) for key, kind in KINDS.items() if key not in CALLS]
        self._tokens: list[Any] = []
        self._asked: deque[tuple[Any, bool]] = deque()
        self.sent = self.accepted = 0

    def send(self, count: int) -> None:
        """Send some more."""
        if self.sent // OF_A_SESSION < (self.sent + count) // OF_A_SESSION:
            self.leave()
            self._session = self._open_session()
        for _ in range(count):
            self._send(self._random.random())
            self.sent += 1

    def leave(self) -> None:
        """Take all answers, and close the session."""
        self._take_answers()
        self._tokens.clear()
        self._session.close()

    def _send(self, which: float) -> None:
        choice = self._random.choice
        key, payload = choice(self._puts)
        if which < 0.85:
            key, payload, label, attachment = next(self._malformed)
            if key in CALLS:
                self._ask(key, payload, attachment, malformed=True)
            else:
                self._session.put(key, payload, encoding=label or None, attachment=attachment)
        elif which < 0.90:
            self._session.put(choice(EXPRESSIONS), payload)
        elif which < 0.93:
            self._ask(choice(EXPRESSIONS), payload, None, malformed=False)
        elif which < 0.98 or self.sent > OF_A_SESSION:
            self._session.put(key, payload, attachment=self._random.randbytes(choice(SIZES)))
        else:
            form = choice(("mecazen/[/{}]\x1b", "mecazen/viewer/{}/every", "{}/mecazen/viewer"))
            token = self._session.liveliness().declare_token(form.format(self.sent))
            self._tokens = [*self._tokens[-100:], token]

    def _ask(self, key: str, payload: bytes, attachment: bytes | None, *, malformed: bool) -> None:
        replies = self._session.get(key, payload=payload, attachment=attachment, timeout=1.0)
        self._asked.append((replies, malformed))
        self._take_answers(OPEN_QUERIES)

    def _take_answers(self, wait: int = 0) -> None:
        """Wait for the answers to all queries but the newest; count malformed ones taken."""
        while len(self._asked) > wait:
            replies, was_malformed = self._asked.popleft()
            for reply in replies:
                self.accepted += was_malformed and reply.ok is not None


@contextmanager
def flooding(names, payload, config):
    """Flood from another process; yield the number of its puts."""
    context = multiprocessing.get_context("spawn")
    sent, stop = context.Value("q", 0), context.Event()
    process = context.Process(target=flood_until, args=(stop, names, payload, config, sent))
    process.start()
    try:
        yield sent
    finally:
        stop.set()
        process.join()


def flood_until(stop, names, payload, config, sent) -> None:
    with closing(ZenohBus(config, "client", name="viewer")) as bus:
        while not stop.is_set():
            for key in names:
                bus.put_bytes(key, payload, JSON_ENCODING)
            sent.value += len(names)


SAMPLE_S = 0.05


def hear_slowly(config, mode, heard, hears) -> None:
    """Take 50 ms for each sample on Zenoh's own thread, as a client that knows no better."""

    def take(_: zenoh.Sample) -> None:
        time.sleep(SAMPLE_S)
        heard.value += 1

    with open_session(config, mode, "viewer") as session:
        session.declare_subscriber("**", zenoh.handlers.Callback(take, indirect=False))
        hears.set()
        threading.Event().wait()


@contextmanager
def slow_observer(config, mode):
    """Observe slowly, from another process; yield the number of samples that it has taken."""
    context = multiprocessing.get_context("spawn")
    heard, hears = context.Value("q", 0), context.Event()
    process = context.Process(target=hear_slowly, args=(config, mode, heard, hears), daemon=True)
    process.start()
    assert hears.wait(COMMAND_GUARD_S)
    try:
        yield heard
    finally:
        process.kill()
        process.join()
