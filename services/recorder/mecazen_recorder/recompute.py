"""Feeds one service with its recorded inputs and compares its outputs with the recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple, TypeVar

import msgspec
from mecazen import keys
from mecazen.bus import LocalBus, Publisher
from mecazen.bus.base import Handler
from mecazen.config import split_key
from mecazen.errors import ConfigError
from mecazen.graph import GRAPH, TABLE, services
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.node import Node
from mecazen.programs import find
from mecazen.runtime.host import make_nodes
from mecazen.runtime.participant import Participant
from mecazen.wire import NS_PER_S, Stamp, encode

from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.sink import RecordingError

MessageT = TypeVar("MessageT", bound=Message)

_ORDER: tuple[Topic[Any], ...] = (
    keys.JOINT_STATES,
    keys.GROUND_TRUTH,
    keys.TARGET_ODOM,
    keys.OBSERVATION,
    keys.ODOM,
    keys.FOLLOWER_STATE,
    keys.CMD_VEL,
    keys.JOINT_COMMAND,
)
"""The causal order of the samples of a tick, see docs/time.md.

The recorder gets them from several processes, possibly in another order.
"""
_RANKS = {topic.key: rank for rank, topic in enumerate(_ORDER)}


class Difference(NamedTuple):
    """The first difference from the recording."""

    key: str
    time_ns: int
    field: str
    """Path in the message; empty if one of the two samples is missing."""
    recorded: str
    recomputed: str

    def __str__(self) -> str:
        """Return the difference in one line."""
        where = " ".join(filter(None, (self.key, self.field)))
        values = f"recorded {self.recorded}, recomputed {self.recomputed}"
        return f"{where} at {self.time_ns / NS_PER_S} s: {values}"


class Comparison(NamedTuple):
    """The result of a re-computation."""

    counts: Counter[str]
    """Number of compared samples by key."""
    difference: Difference | None


def recompute(recording: Recording, program: str, robot: str = "") -> Comparison:
    """Re-compute a service from a recording.

    Runs that are not recorded from their first tick, or without configuration, are skipped.
    Diagnostics are not compared.

    Args:
        recording: The recorded inputs and outputs.
        program: A service's name, or `file.py:Class` of one in its place.
        robot: Name of one of several robots.

    Raises:
        MecazenError: There is nothing to compute or to compare, or the service failed.
    """
    counts: Counter[str] = Counter()
    for run, samples in _whole_runs(recording).items():
        service, bus = _make_service(recording, run, program, robot)
        compared = _recompute_run(_of_robot(samples, robot, recording.robots(run)), bus)
        service.close()
        counts += compared.counts
        if compared.difference is not None:
            return Comparison(counts, compared.difference)
    if not counts:
        raise RecordingError(f"{recording.path}: holds nothing that {program} publishes")
    return Comparison(counts, None)


class _OneServiceBus(LocalBus):
    """Stores what its only service publishes instead of delivering it."""

    def __init__(self) -> None:
        super().__init__()
        self.inputs: dict[str, Topic[Any]] = {}
        self.outputs: dict[str, Topic[Any]] = {}
        self.published: dict[str, list[_Output]] = {}

    def publisher(self, topic: Topic[MessageT]) -> Publisher[MessageT]:
        self.outputs[topic.key] = topic
        return _Keeper(self.published.setdefault(topic.key, []))

    def subscribe(
        self, topic: Topic[MessageT], handler: Handler[MessageT], *, every: bool = False
    ) -> None:
        self.inputs[topic.key] = topic
        super().subscribe(topic, handler, every=every)


class _Output(NamedTuple):
    time_ns: int
    message: Message


class _Keeper(Publisher[MessageT]):
    def __init__(self, kept: list[_Output]) -> None:
        self._kept = kept

    def put(self, message: MessageT, stamp: Stamp) -> None:
        self._kept.append(_Output(stamp.time_ns, message))


def _whole_runs(recording: Recording) -> dict[int, list[Sample]]:
    """Return the samples of each run that can be re-computed."""
    runs: dict[int, list[Sample]] = {}
    run: int | None = None
    for sample in recording.samples():
        run = run if sample.stamp is None else sample.stamp.run
        if run is not None:
            runs.setdefault(run, []).append(sample)
    known = {run: samples for run, samples in runs.items() if run in recording.scenarios}
    whole = {run: samples for run, samples in known.items() if samples[0].time_ns == 0}
    if not whole:
        missing = "the beginning of a run" if known else "the configuration of a run"
        raise RecordingError(f"{recording.path}: can't be computed anew without {missing}")
    return whole


def _of_robot(samples: Sequence[Sample], robot: str, robots: Sequence[str]) -> list[Sample]:
    """Return the samples in the namespace of a robot, with keys relative to it."""
    parts = ((sample, *split_key(sample.key, robots)) for sample in samples)
    return [sample._replace(key=key) for sample, name, key in parts if name == robot]


def _make_service(
    recording: Recording, run: int, program: str, robot: str
) -> tuple[Participant, _OneServiceBus]:
    """Return the nodes with their recorded configuration.

    Raises:
        ConfigError: There are none of that name, or they have no inputs to compute from.
    """
    scenario = recording.scenario(run)
    names = [row.name for row in services().get(program, ()) if not row.owns_time] or [program]
    kinds = {}
    for name in names:
        kind = find(name, scenario.programs)
        if not issubclass(kind, Node):
            raise ConfigError(
                f"{program}: is no node with recorded inputs; `mecazen simulate` runs the rest anew"
            )
        place = name if name in TABLE or name in scenario.programs else kind.ROW.name
        kinds[place] = kind
    place = next(iter(kinds))
    service = TABLE[place].part_of if place in TABLE else place
    bus = _OneServiceBus()
    programs = {**scenario.programs, **({place: program} if ":" in program else {})}
    recorded = msgspec.structs.replace(recording.scenario(run, service), programs=programs)
    return make_nodes(service, kinds, bus, recorded, robot), bus


def _recompute_run(samples: Sequence[Sample], bus: _OneServiceBus) -> Comparison:
    for sample in sorted(samples, key=_place_in_time):
        if sample.key in bus.inputs:
            bus.put_bytes(sample.key, *sample.as_published(bus.inputs[sample.key].type))
            bus.spin()
    outputs = {
        key: topic for key, topic in bus.outputs.items() if not key.startswith("diagnostics/")
    }
    horizon_ns = _horizon_ns(samples, {**bus.inputs, **outputs})
    recorded: dict[str, list[_Output]] = {}
    for sample in samples:
        if sample.key in outputs and sample.stamp is not None:
            message = sample.message(outputs[sample.key].type)
            recorded.setdefault(sample.key, []).append(_Output(sample.time_ns, message))
    differences = [
        difference
        for key in recorded
        if (difference := _compare(key, recorded[key], bus.published[key], horizon_ns)) is not None
    ]
    counts = Counter({key: len(kept) for key, kept in recorded.items()})
    first = min(differences, key=lambda d: (d.time_ns, _rank(d.key)), default=None)
    return Comparison(counts, first)


def _rank(key: str) -> int:
    return _RANKS.get(key, len(_RANKS))


def _place_in_time(sample: Sample) -> tuple[int, int]:
    # a sample without a stamp may have come at any time within its tick
    rank = len(_RANKS) + 1 if sample.stamp is None else _rank(sample.key)
    return sample.time_ns, rank


def _horizon_ns(samples: Sequence[Sample], topics: dict[str, Topic[Any]]) -> int:
    """Return the time of the last completely recorded tick [ns]."""
    last: dict[str, int] = {}
    for sample in samples:
        topic = topics.get(sample.key)
        if topic is not None and _is_periodic(topic) and sample.stamp is not None:
            last[sample.key] = max(last.get(sample.key, 0), sample.time_ns)
    return min(last.values(), default=0)


def _is_periodic(topic: Topic[Any]) -> bool:
    """Return whether a topic's last sample says how far a recording goes."""
    return any(topic.key in {t.key for t in row.outputs} for row in GRAPH)


def _compare(
    key: str, recorded: Sequence[_Output], recomputed: Sequence[_Output], horizon_ns: int
) -> Difference | None:
    pairs = zip_longest(
        (output for output in recorded if output.time_ns <= horizon_ns),
        (output for output in recomputed if output.time_ns <= horizon_ns),
    )
    for old, new in pairs:
        if old is None or new is None or old.time_ns != new.time_ns:
            time_ns = min(output.time_ns for output in (old, new) if output is not None)
            there = [
                "a message" if output is not None and output.time_ns == time_ns else "nothing"
                for output in (old, new)
            ]
            return Difference(key, time_ns, "", *there)
        # compared as bytes, since 0.0 and -0.0 are equal as numbers
        if encode(old.message, "json") != encode(new.message, "json"):
            was, now = (msgspec.to_builtins(output.message) for output in (old, new))
            return Difference(key, old.time_ns, *next(_different(was, now, "")))
    return None


def _different(was: Any, now: Any, path: str) -> Iterator[tuple[str, str, str]]:
    """Yield path and both values of each leaf that differs."""
    if isinstance(was, dict) and isinstance(now, dict):
        for name in was:
            yield from _different(was[name], now[name], f"{path}.{name}" if path else name)
    elif isinstance(was, list | tuple) and isinstance(now, list | tuple) and len(was) == len(now):
        for index, pair in enumerate(zip(was, now, strict=True)):
            yield from _different(*pair, f"{path}[{index}]")
    elif repr(was) != repr(now):
        yield path, _short(was), _short(now)


def _short(value: Any) -> str:
    return f"{len(value)} items" if isinstance(value, list | tuple) else repr(value)
