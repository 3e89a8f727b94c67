"""A million malformed payloads: they crash, delay and move no service."""

from __future__ import annotations

import json
import logging
import random
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from copy import deepcopy
from typing import Any, NamedTuple

import msgspec
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.bus.base import decode_sample
from mecazen.config import Scenario
from mecazen.errors import BusError
from mecazen.keys import Call, Topic
from mecazen.loading import load_scenario
from mecazen.messages import Message
from mecazen.wire import (
    ENCODINGS,
    JSON_ENCODING,
    MAX_SAMPLE_BYTES,
    MSGPACK_ENCODING,
    RefusedError,
    decode,
    encode,
)
from mecazen_tools.simulate import InProcess, simulate

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.stack import SCENARIOS

PAYLOADS = 1_000_000
TICKS = 500
SEED = 20
NONE = Target(0.0, 0.0)

WRONG_VALUES: tuple[Any, ...] = (
    None, True, "", "1", [], {}, [[]], {"x": 1}, -1, 2**31, 2**32, 2**63, -(2**63), 1.5,
    "\ud7ff", "é" * 50, list(range(200)), [None] * 36,
)  # fmt: skip
NUMBERS = (b"NaN", b"Infinity", b"-Infinity", b"1e999", b"9" * 400, b"0x10", b"1.", b".5", b"+1")
BOMBS = (
    b"[" * 5000, b'{"header":' * 5000, b'{"a":' * 5000, b'{"linear":[' * 2000,
    b"\x91" * 5000, b"\x81\xa1a" * 5000, b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff",
    b"\x81\xd9\xff", b"\x81\xa6header" * 3000,
)  # fmt: skip
LABELS = (
    "", JSON_ENCODING, MSGPACK_ENCODING, "text/json", "text/plain", "application/cdr",
    "zenoh/bytes", "application/json;é", "\x00", "/", "a" * 200,
)  # fmt: skip
CALLS: dict[str, Call[Any, Any]] = {call.key: call for call in keys.CALLS}


class Payload(NamedTuple):
    """What an intruder puts on a key, or sends as a query."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


class Malformed:
    """Generates payloads that are refused, from good messages or from nothing.

    Args:
        good: Messages that each key carries.
        seed: Of the generator.
    """

    def __init__(self, good: Mapping[str, Sequence[Message]], seed: int = SEED) -> None:
        self.well_formed: Counter[str] = Counter()
        """Payloads that happened to be valid and were discarded, by key."""
        self._random = random.Random(seed)  # noqa: S311
        self._keys = sorted(good)
        self._kinds = {key: type(messages[0]) for key, messages in good.items()}
        self._good = {
            key: [encode(message, form) for message in messages for form in ENCODINGS]
            for key, messages in good.items()
        }
        self._wrong = {
            key: [self._with_wrong_value(messages) for _ in range(200)]
            for key, messages in good.items()
        }

    def __iter__(self) -> Iterator[Payload]:
        """Return payloads without end."""
        while True:
            key = self._random.choice(self._keys)
            attachment = None
            if self._random.random() < 0.1:  # a stamp is 16 bytes
                size = self._random.choice((16, self._random.randrange(40)))
                attachment = self._random.randbytes(size)
            label = self._random.choice(LABELS)
            made = Payload(key, self._payload(key), label, attachment)
            if self._is_refused(made):
                yield made
            else:
                self.well_formed[key] += 1

    def _payload(self, key: str) -> bytes:
        choice, below = self._random.choice, self._random.randrange
        good = choice(self._good[key])
        match below(9):
            case 0:
                return good[: below(len(good))]
            case 1:
                flipped = bytearray(good)
                for _ in range(1 + below(3)):
                    flipped[below(len(good))] ^= 1 << below(8)
                return bytes(flipped)
            case 2:
                return choice(self._wrong[key])
            case 3:
                return choice(BOMBS)
            case 4:
                fields = msgspec.structs.fields(self._kinds[key])
                name = choice(fields).encode_name if fields else "x"
                text = b'{"%b":%b}' % (name.encode(), choice(NUMBERS))
                return choice((text, b'{"header":{"stamp":{"sec":' + text))
            case 5:  # no UTF-8
                place = below(len(good))
                return good[:place] + bytes((0xFF, 0xC0, 0x80 | below(64))) + good[place + 1 :]
            case 6:
                return self._random.randbytes(below(9)) * (1 + below(9))
            case 7:
                return good + b" " * MAX_SAMPLE_BYTES
        return good  # its encoding or its attachment may be wrong

    def _is_refused(self, made: Payload) -> bool:
        kind = self._kinds[made.key]
        try:
            if made.key not in CALLS:
                decode_sample(Topic(made.key, kind, ""), *made[1:])
            elif made.payload.strip():  # a query may be empty
                decode(made.payload, kind)
        except RefusedError:
            return True
        return False

    def _with_wrong_value(self, messages: Sequence[Message]) -> bytes:
        """Return a message with a value of a wrong type somewhere."""
        tree = node = msgspec.to_builtins(self._random.choice(messages))
        while node:
            places = list(node) if isinstance(node, dict) else range(len(node))
            place = self._random.choice(places)
            child = node[place]
            if not isinstance(child, dict | list) or not child or self._random.random() < 0.25:
                node[place] = deepcopy(self._random.choice(WRONG_VALUES))
                break
            node = child
        if self._random.random() < 0.5:
            with suppress(OverflowError):  # MessagePack has no such integer
                return msgspec.msgpack.encode(tree)
        return json.dumps(tree).encode()


def sample_messages(scenario: Scenario) -> dict[str, list[Message]]:
    """Run a scenario; return messages that each key carries, a default one where it is silent."""
    with closing(InProcess(scenario)) as run:
        received = _subscribe(run.bus, scenario)
        for _ in run.ticks():
            pass
    messages = {
        topic.key: received[topic.key][:20] or [topic.type()] for topic in _topics(scenario)
    }
    return messages | {key: [call.request()] for key, call in CALLS.items()}


def _topics(scenario: Scenario) -> list[Topic[Any]]:
    topics: list[Topic[Any]] = [topic for topic in keys.TOPICS if "*" not in topic.key]
    return [*topics, *map(keys.diagnostics, scenario.services)]


def _subscribe(bus: LocalBus, scenario: Scenario) -> dict[str, list[Message]]:
    """Subscribe to all topics, so that the bus checks each; return the messages to come."""
    received: dict[str, list[Message]] = {topic.key: [] for topic in _topics(scenario)}
    for topic in _topics(scenario):
        keep = received[topic.key].append
        bus.subscribe(topic, lambda message, _, keep=keep: keep(message))  # type: ignore[misc]
    return received


def run(payloads: int = PAYLOADS, ticks: int = TICKS) -> list[Group]:
    """Run the scenario `back` with and without them, and compare the trajectories."""
    scenario = load_scenario(SCENARIOS / "back.toml", (f"sim.duration_s={ticks / 100}",))
    expected = simulate(scenario, "back")[0].trajectory_sha256
    malformed = Malformed(sample_messages(scenario))
    source = iter(malformed)
    batch = -(-payloads // (ticks - 1))
    counts: Counter[str] = Counter()
    spent = 0.0
    with closing(InProcess(scenario)) as loop, _without_warnings():
        _subscribe(loop.bus, scenario)
        for _ in loop.ticks():
            made = [next(source) for _ in range(min(batch, payloads - counts.total()))]
            begin = time.perf_counter()
            for one in made:
                _put(loop.bus, one)
            loop.bus.spin()
            spent += time.perf_counter() - begin
            counts.update(one.key for one in made)
    refused, valid = loop.bus.refused, malformed.well_formed
    rows = [_row(key, n, n - refused[key], valid[key]) for key, n in sorted(counts.items())]
    total = counts.total()
    rows.append(_row("all", total, total - refused.total(), valid.total()))
    rows[-1].figures["payloads/s"] = Figure.of(total / spent, "more")
    differs = loop.trajectory.sha256() != expected
    rows[-1].figures["trajectories that differ"] = Figure.of(differs, NONE)
    how = f"put between {ticks} ticks of lockstep, seed {SEED}; the trajectory must stay the same"
    return [Group("Malformed payloads: scenario back", how, tuple(rows))]


def _row(subject: str, count: int, accepted: int, valid: int) -> Row:
    figures = {
        "payloads": Figure.of(count, "more"),
        "not refused": Figure.of(accepted, NONE),
        "discarded as valid": Figure.of(valid, "less"),
    }
    return Row(subject, figures)


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Silence the bus: each refusal is a warning."""
    logger = logging.getLogger("mecazen.bus.base")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _put(bus: LocalBus, made: Payload) -> None:
    if made.key not in CALLS:
        bus.put_bytes(*made)
        return
    with suppress(BusError):  # the counts show what is not refused
        bus.call_bytes(CALLS[made.key], made.payload)
