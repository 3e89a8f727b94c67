"""A million malformed payloads: they crash, delay and move no service."""

from __future__ import annotations

import logging
import math
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from typing import Any, NamedTuple

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
    MAX_SAMPLE_BYTES,
    RefusedError,
    decode,
    encode,
)
from mecazen_ros import cdr
from mecazen_ros.types import RosTypeError
from mecazen_tools.simulate import InProcess, simulate

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.stack import SCENARIOS

PAYLOADS = 1_000_000
TICKS = 500
REPORT_S = 60.0
SEED = 20
NONE = Target(0.0, 0.0)

TOKEN = re.compile(rb'"[^"]*"|[-+.\w]+')
"""A name or a value in JSON."""
ODD = (
    b"null", b"true", b'"1"', b"{}", b"[[]]", b'{"x":1}', b"-1", b"2147483648", b"1.5", b"NaN",
    b"-Infinity", b"1e999", b"9" * 400, b"0x10", b".5", b"[0,1]", b'"\\ud7ff"', b"\xff", b"\xc0",
    b"[" * 5000, b'{"header":' * 5000, b'{"linear":[' * 2000, b"\x91" * 5000, b"\x81\xa1a" * 5000,
    b"\xff" * 4, b"\xf0\x7f",
    b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\x81\xd9\xff", b"\x81\xa6header" * 3000,
    b" " * MAX_SAMPLE_BYTES,
)  # fmt: skip
"""Wrong values, NaN, no UTF-8, bombs in JSON, MessagePack and CDR, too much."""
LABELS = (
    "", *ENCODINGS.values(), "application/cdr", "text/json", "text/plain", "zenoh/bytes",
    "application/json;é", "\x00", "/", "a" * 200,
)  # fmt: skip
CALLS: dict[str, Call[Any, Any]] = {call.key: call for call in keys.CALLS}


class Payload(NamedTuple):
    """What an intruder puts on a key, or sends as a query."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


class Budget:
    """How many payloads are sent, for how long at most; says once a minute how many were.

    Args:
        name: Of what is fuzzed.
        payloads: So many at most.
        minutes: For so long at most.
    """

    def __init__(self, name: str, payloads: int, minutes: float = math.inf) -> None:
        self._name = name
        self._payloads = payloads
        self._seconds = 60.0 * minutes
        self._begin = self._reported = time.monotonic()

    def spent(self, sent: int, remark: Callable[[], str] = str) -> float:
        """Return how much of it is spent after so many payloads, 1 and above for all."""
        now = time.monotonic()
        if now - self._reported >= REPORT_S:
            self._reported = now
            print(
                f"{self._name}: {sent:,} of {self._payloads:,} payloads sent,",
                f"{self.rate(sent):,.0f}/s {remark()}",
                file=sys.stderr,
                flush=True,
            )
        return max(sent / self._payloads, (now - self._begin) / self._seconds)

    def rate(self, sent: int) -> float:
        """Return the payloads a second since the start."""
        return sent / (time.monotonic() - self._begin)


class Malformed:
    """Generates payloads that are refused, from `good` messages that each key carries."""

    def __init__(self, good: Mapping[str, Sequence[Message]]) -> None:
        self.well_formed: Counter[str] = Counter()
        """Payloads that happened to be valid and were discarded, by key."""
        self._random = random.Random(SEED)  # noqa: S311
        self._kinds = {key: type(messages[0]) for key, messages in good.items()}
        self._good = {
            key: [payload for message in messages for payload in _well_formed(message)]
            for key, messages in sorted(good.items())
        }

    def __iter__(self) -> Iterator[Payload]:
        below = self._random.randrange
        while True:
            key = self._random.choice(list(self._good))
            # a stamp is 16 or 20 bytes
            sizes = (16, 20, below(40)) if below(10) == 0 else ()
            attachment = self._random.randbytes(self._random.choice(sizes)) if sizes else None
            label = self._random.choice(LABELS)
            made = Payload(
                key, self._damaged(self._random.choice(self._good[key])), label, attachment
            )
            if self._is_refused(made):
                yield made
            else:
                self.well_formed[key] += 1

    def _damaged(self, good: bytes) -> bytes:
        """Return a message with a token, any piece, its end or all of it replaced."""
        choice, below = self._random.choice, self._random.randrange
        begin = below(len(good))
        spans = [(begin, begin + below(4)), (begin, len(good)), (0, len(good))]
        if token := TOKEN.search(good, begin):
            spans.append(token.span())
        begin, end = choice(spans)
        odd = choice((b"", self._random.randbytes(1 + below(9)), choice(ODD), good[begin:end]))
        return good[:begin] + odd + good[end:]

    def _is_refused(self, made: Payload) -> bool:
        kind, topic = self._kinds[made.key], keys.topic_of(made.key)
        try:
            if topic is not None:
                decode_sample(topic, *made[1:])
            elif made.payload.strip():  # a query may be empty
                decode(made.payload, kind)
        except RefusedError:
            return True
        return False


def _well_formed(message: Message) -> Iterator[bytes]:
    for form in ENCODINGS:
        yield encode(message, form)
    with suppress(RosTypeError):  # a request that may leave its seed open
        yield cdr.encode(message)


def sample_messages(scenario: Scenario) -> dict[str, list[Message]]:
    """Run a scenario; return messages that each key carries, a default one where it is silent."""
    with closing(InProcess(scenario)) as run:
        received = _subscribe(run.bus, scenario)
        for _ in run.ticks():
            pass
    messages = {topic.key: kept[:20] or [topic.type()] for topic, kept in received.items()}
    return messages | {key: [call.request()] for key, call in CALLS.items()}


def _subscribe(bus: LocalBus, scenario: Scenario) -> dict[Topic[Any], list[Message]]:
    """Subscribe to all topics, so that the bus checks each; return the messages to come."""
    topics: list[Topic[Any]] = [topic for topic in keys.TOPICS if "*" not in topic.key]
    received: dict[Topic[Any], list[Message]] = {}
    for topic in (*topics, *map(keys.diagnostics, scenario.services)):
        keep = received.setdefault(topic, []).append
        bus.subscribe(topic, lambda message, _, keep=keep: keep(message))  # type: ignore[misc]
    return received


def run(payloads: int = PAYLOADS, ticks: int = TICKS, minutes: float = math.inf) -> list[Group]:
    """Run the scenario `back` with and without them, and compare the trajectories."""
    scenario = load_scenario(SCENARIOS / "back.toml", (f"sim.duration_s={ticks / 100}",))
    expected = simulate(scenario, "back")[0].trajectory_sha256
    malformed = Malformed(sample_messages(scenario))
    source = iter(malformed)
    batch = -(-payloads // (ticks - 1))
    counts: Counter[str] = Counter()
    spent = 0.0
    budget = Budget("in one process", payloads, minutes)
    logging.disable(logging.WARNING)  # each refusal is one
    try:
        with closing(InProcess(scenario)) as loop:
            _subscribe(loop.bus, scenario)
            for _ in loop.ticks():
                total = counts.total()
                room = 0 if budget.spent(total) >= 1.0 else min(batch, payloads - total)
                made = [next(source) for _ in range(room)]
                begin = time.perf_counter()
                for one in made:
                    _put(loop.bus, one)
                loop.bus.spin()
                spent += time.perf_counter() - begin
                counts.update(one.key for one in made)
    finally:
        logging.disable(logging.NOTSET)
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


def _put(bus: LocalBus, made: Payload) -> None:
    if made.key not in CALLS:
        bus.put_bytes(*made)
        return
    with suppress(BusError):  # the counts show what is not refused
        bus.call_bytes(CALLS[made.key], made.payload)
