"""A million payloads that are no messages: none crashes, holds up or moves any service."""

from __future__ import annotations

import json
import logging
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.bus.base import decode_sample
from mecazen.config import Scenario
from mecazen.errors import BusError
from mecazen.keys import Call, Topic
from mecazen.loading import load_scenario
from mecazen.messages import DiagnosticArray, Message
from mecazen.runtime import find_service
from mecazen.wire import (
    ENCODINGS,
    JSON_ENCODING,
    MAX_SAMPLE_BYTES,
    MSGPACK_ENCODING,
    RefusedError,
    Stamp,
    decode,
    encode,
)
from mecazen_tools.simulate import in_lockstep
from mecazen_tools.trajectory import Trajectory

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

PAYLOADS = 1_000_000
TICKS = 500
SEED = 20
BLOCK = 4096
"""Payloads whose random numbers are drawn together."""

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


class Payload(NamedTuple):
    """What an intruder puts on a key, or asks it."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


class Malformed:
    """Makes payloads that are refused, of good messages or of nothing, from one seed."""

    def __init__(self, good: Mapping[str, Sequence[Message]], seed: int = SEED) -> None:
        """Prepare.

        Args:
            good: Messages that each key carries.
            seed: Of all that is drawn.
        """
        self.well_formed: Counter[str] = Counter()
        """Payloads that were made and, by chance, are messages: left out, by key."""
        self._rng = np.random.default_rng(seed)
        self._keys = sorted(good)
        self._kinds = {key: type(messages[0]) for key, messages in good.items()}
        self._good = {
            key: [encode(message, form) for message in messages for form in ENCODINGS]
            for key, messages in good.items()
        }
        self._wrong = {key: self._damaged(messages) for key, messages in good.items()}
        self._ways: tuple[Callable[[bytes, str, Sequence[int]], bytes], ...] = (
            lambda good, _, r: good[: r[0] % len(good)],
            self._flipped,
            lambda _, key, r: self._wrong[key][r[0] % len(self._wrong[key])],
            lambda _, __, r: BOMBS[r[0] % len(BOMBS)],
            self._with_number,
            lambda good, *_: good,
            lambda good, *_: good,
            lambda *_: b"",
            lambda good, _, r: _spliced(good, r[0], bytes((0xFF, 0xC0, 0x80 | r[1] % 64))),
            lambda _, __, r: r[1].to_bytes(8, "little")[: 1 + r[0] % 8] * (1 + r[2] % 9),
            lambda good, *_: good + b" " * MAX_SAMPLE_BYTES,
        )

    def __iter__(self) -> Iterator[Payload]:
        """Return payloads without end."""
        while True:
            for numbers in self._rng.integers(0, 2**63, (BLOCK, 8)).tolist():
                made = self._make(numbers)
                if self._is_refused(made):
                    yield made
                else:
                    self.well_formed[made.key] += 1

    def _make(self, numbers: Sequence[int]) -> Payload:
        key = self._keys[numbers[0] % len(self._keys)]
        good = self._good[key][numbers[1] % len(self._good[key])]
        way = numbers[2] % len(self._ways)
        payload = self._ways[way](good, key, numbers[3:])
        encoding = LABELS[numbers[6] % len(LABELS)]
        attachment = None
        if way == 6:
            size = (numbers[3] % 40) if numbers[4] % 2 else 16
            attachment = struct.pack("<5Q", *numbers[:5])[:size]
        return Payload(key, payload, encoding, attachment)

    def _is_refused(self, made: Payload) -> bool:
        try:
            if made.key in CALLS:
                return bool(made.payload.strip()) and _refuses(self._kinds[made.key], made.payload)
            decode_sample(cast(Topic[Message], keys.topic_of(made.key)), *made[1:])
        except RefusedError:
            return True
        return False

    def _flipped(self, good: bytes, key: str, numbers: Sequence[int]) -> bytes:
        del key
        payload = bytearray(good)
        for place in numbers[: 1 + numbers[3] % 3]:
            payload[(place >> 3) % len(payload)] ^= 1 << (place & 7)
        return bytes(payload)

    def _with_number(self, good: bytes, key: str, numbers: Sequence[int]) -> bytes:
        del good
        text = b'{"%b":%b}' % (
            self._field(key, numbers[0]).encode(),
            NUMBERS[numbers[1] % len(NUMBERS)],
        )
        return text if numbers[2] % 2 else b'{"header":{"stamp":{"sec":' + text

    def _field(self, key: str, number: int) -> str:
        fields = msgspec.structs.fields(self._kinds[key])
        return fields[number % len(fields)].encode_name if fields else "x"

    def _damaged(self, messages: Sequence[Message], count: int = 200) -> list[bytes]:
        """Return messages with a value of a wrong type somewhere."""
        made = []
        for _ in range(count):
            tree = msgspec.to_builtins(messages[int(self._rng.integers(len(messages)))])
            self._damage(tree)
            try:
                made.append(
                    msgspec.msgpack.encode(tree)
                    if self._rng.integers(2)
                    else json.dumps(tree).encode(errors="replace")
                )
            except OverflowError:  # MessagePack has no such integer
                made.append(json.dumps(tree).encode())
        return made

    def _damage(self, node: Any) -> None:
        while node:
            places = list(node) if isinstance(node, dict) else list(range(len(node)))
            place = places[self._rng.integers(len(places))]
            child = node[place]
            if not isinstance(child, dict | list) or not child or self._rng.integers(4) == 0:
                node[place] = deepcopy(WRONG_VALUES[self._rng.integers(len(WRONG_VALUES))])
                return
            node = child


def _refuses(kind: type[Message], payload: bytes) -> bool:
    try:
        decode(payload, kind)
    except RefusedError:
        return True
    return False


def _spliced(good: bytes, place: int, what: bytes) -> bytes:
    place %= len(good)
    return good[:place] + what + good[place + 1 :]


CALLS: dict[str, Call[Any, Any]] = {call.key: call for call in keys.CALLS}


class Loop:
    """A scenario's services on the bus within this process, tick by tick."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = in_lockstep(scenario)
        self.bus = LocalBus()
        sim = self.scenario.sim
        self.trajectory = Trajectory(self.bus, sim.tick_ns, sim.ticks, scenario.services)
        self.heard: dict[str, list[Message]] = {}
        topics: list[Topic[Any]] = [topic for topic in keys.TOPICS if "*" not in topic.key]
        for topic in (*topics, *map(keys.diagnostics, scenario.services)):
            self._listen(topic)
        kinds = {part: find_service(part, self.scenario) for part in scenario.services}
        self.parts = {part: kind(self.bus, self.scenario) for part, kind in kinds.items()}
        for part in self.parts:
            self.bus.declare_alive(part)

    def _listen(self, topic: Topic[Any]) -> None:
        heard = self.heard.setdefault(topic.key, [])

        def keep(message: Message, _: Stamp | None) -> None:
            if len(heard) < 20:
                heard.append(message)

        self.bus.subscribe(topic, keep)

    def run(self, between: Callable[[], None]) -> str:
        """Run it whole, with something done between ticks; return the trajectory's hash."""
        physics = cast(Any, self.parts["physics"])  # its class is not known here
        physics.begin()
        for _ in range(1, self.scenario.sim.ticks):
            physics.step()
            between()
        physics.await_answers()
        self.bus.spin()
        for part in self.parts.values():
            part.close()
        return self.trajectory.sha256()

    def messages(self) -> dict[str, list[Message]]:
        """Return messages that each key carries, as heard; of a key in silence, an empty one."""
        kinds = {topic.key: topic.type for topic in keys.TOPICS}
        heard = {
            key: messages or [kinds.get(key, DiagnosticArray)()]
            for key, messages in self.heard.items()
        }
        return {**heard, **{key: [call.request()] for key, call in CALLS.items()}}


def run(payloads: int = PAYLOADS, ticks: int = TICKS) -> list[Group]:
    """Run the scenario `back` without them and with them, and compare the trajectories."""
    settings = (f"sim.duration_s={ticks / 100}",)
    alone = Loop(load_scenario(SCENARIOS / "back.toml", settings))
    expected = alone.run(lambda: None)
    loop = Loop(load_scenario(SCENARIOS / "back.toml", settings))
    malformed = Malformed(alone.messages())
    batch = -(-payloads // (ticks - 1))
    source = iter(malformed)
    counts: Counter[str] = Counter()
    spent = 0.0

    def intrude() -> None:
        nonlocal spent
        made = [next(source) for _ in range(min(batch, payloads - counts.total()))]
        begin = time.perf_counter()
        for one in made:
            _put(loop.bus, one)
        loop.bus.spin()
        spent += time.perf_counter() - begin
        counts.update(one.key for one in made)

    logger = logging.getLogger("mecazen.bus.base")
    level = logger.level
    logger.setLevel(logging.ERROR)  # each refusal is a warning
    try:
        found = loop.run(intrude)
    finally:
        logger.setLevel(level)
    refused = loop.bus.refused
    rows = [
        Row(
            key,
            {
                "payloads": Figure.of(count, "more"),
                "not refused": Figure.of(count - refused[key], Target.around(0.0, 0.0)),
                "left out as well-formed": Figure.of(malformed.well_formed[key], "less"),
            },
        )
        for key, count in sorted(counts.items())
    ]
    rows.append(
        Row(
            "all",
            {
                "payloads": Figure.of(counts.total(), "more"),
                "not refused": Figure.of(counts.total() - refused.total(), Target.around(0.0, 0.0)),
                "left out as well-formed": Figure.of(malformed.well_formed.total(), "less"),
                "payloads/s": Figure.of(counts.total() / spent, "more"),
                "trajectories that differ": Figure.of(found != expected, Target.around(0.0, 0.0)),
            },
        )
    )
    how = f"put between {ticks} ticks of lockstep, seed {SEED}; the trajectory's hash must stay"
    return [Group("Malformed payloads: scenario back", how, tuple(rows))]


def _put(bus: LocalBus, made: Payload) -> None:
    call = CALLS.get(made.key)
    if call is None:
        bus.put_bytes(*made)
        return
    with suppress(BusError):  # what is not refused is seen in the counts
        bus.call_bytes(call, made.payload)
