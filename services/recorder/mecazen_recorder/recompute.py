"""Feeds nodes with their recorded inputs and compares their outputs with the recording."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import zip_longest
from typing import Any, NamedTuple

import msgspec
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import ConfigError, is_installed
from mecazen.graph import GRAPH, NODES, SERVICES, WORLDS
from mecazen.keys import PARAMETERS
from mecazen.messages import Message
from mecazen.node import Node
from mecazen.programs import Kind, classes, find
from mecazen.runtime.host import Host
from mecazen.runtime.worker import Worker
from mecazen.wire import NS_PER_S, Stamp, encode

from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError

PERIODIC = {topic.key for row in GRAPH for topic in row.outputs} - {PARAMETERS.key}
"""Keys whose last sample marks the end of a recording."""


NO_INPUTS = "is no node with recorded inputs; `mecazen simulate` runs the rest again"
NOTHING = "nothing"
"""The value of a missing sample."""


class Difference(NamedTuple):
    """The first difference from the recording."""

    key: str
    time_ns: int
    field: str
    """Path in the message; empty if one of the two samples is missing."""
    recorded: str
    recomputed: str

    def __str__(self) -> str:
        where = " ".join(filter(None, (self.key, self.field)))
        values = f"recorded {self.recorded}, recomputed {self.recomputed}"
        hint = "; does `mecazen info` show gaps?" if self.recorded == NOTHING else ""
        return f"{where} at {self.time_ns / NS_PER_S} s: {values}{hint}"


class Comparison(NamedTuple):
    """The result of a re-computation."""

    counts: Counter[str]
    """Number of compared samples by key."""
    difference: Difference | None


Outputs = list[tuple[int, Message]]
"""Messages on a key with their times [ns]."""


def recompute(recording: Recording, program: str, robot: str = "") -> Comparison:
    """Re-compute a service, a node, or a user node `file.py:Class` that takes a node's place.

    Runs that are not recorded from their first tick, or without configuration, are skipped.
    Diagnostics are not compared.

    Raises:
        UntrustedError: The recording names programs, and is not trusted.
        MecazenError: There is nothing to compute or to compare, or the service failed.
    """
    counts: Counter[str] = Counter()
    runs = _whole_runs(recording)
    recording.refuse_code()
    for run, samples in runs.items():
        scenario = recording.scenario(run)
        bus = Bus(scenario.renamed)
        worker = _make_worker(recording, run, scenario, program, robot, bus)
        with closing(worker.host):
            compared = _recompute_run(recording, samples, worker, bus)
        counts += compared.counts
        if compared.difference is not None:
            return Comparison(counts, compared.difference)
    if not counts:
        raise RecordingError(f"{recording.path}: holds nothing that {program} publishes")
    return Comparison(counts, None)


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
        missing, remedy = "with its configuration", "--scenario NAME says which scenario it was"
        if known:
            missing = "from its first tick"
            remedy = "`mecazen sim reset` begins one while `mecazen record` runs"
        raise RecordingError(f"{recording.path}: holds no run {missing}; {remedy}")
    return whole


def _make_worker(
    recording: Recording, run: int, scenario: Scenario, program: str, robot: str, bus: Bus
) -> Worker:
    """Return the nodes with their recorded configuration; raises as `recompute`."""
    service = NODES[program].part_of if program in NODES else program
    if service in WORLDS:
        raise ConfigError(f"{program}: {NO_INPUTS}")
    programs = scenario.programs
    if program in SERVICES:
        kinds = classes(program, scenario)
    else:
        kind = find(program, programs)
        user = isinstance(kind, type) and ":" in program
        kinds = {_place_of(kind) if user else program: kind}
        programs = {**programs, **(dict.fromkeys(kinds, program) if user else {})}
    place = next(iter(kinds))
    name = NODES[place].part_of if place in NODES else place
    if not all(issubclass(kind, Node) for kind in kinds.values()):
        raise ConfigError(f"{program}: {NO_INPUTS}")
    if name not in scenario.services:
        raise RecordingError(f"{recording.path}: holds nothing that {program} publishes")
    recorded = msgspec.structs.replace(recording.scenario(run, name), programs=programs)
    return Worker(Host([(name, robot)], bus, recorded, kinds))


def _place_of(kind: Kind) -> str:
    """Return the name of the node whose place a user class takes."""
    row = kind.ROW if issubclass(kind, Node) else None
    if row is not None:
        return row.name
    return next(name for name in NODES if is_installed(name) and issubclass(kind, find(name, {})))


def _recompute_run(
    recording: Recording, samples: Sequence[Sample], worker: Worker, bus: Bus
) -> Comparison:
    """Feed a service with its inputs among the samples and compare its outputs."""
    turns = worker.host.loop.turns
    inputs = [slot.on_bus for turn in turns for slot in turn.slots]
    topics = {bus.key_of(topic): topic for topic in inputs}
    published = [output.on_bus for turn in turns for output in turn.outputs.values()]
    outputs = {bus.key_of(topic): topic for topic in published}
    topics |= {**outputs, PARAMETERS.key: PARAMETERS}
    recorded: dict[str, Outputs] = {key: [] for key in outputs}
    recomputed: dict[str, Outputs] = {key: [] for key in outputs}
    for key, topic in outputs.items():
        bus.subscribe(topic, partial(_keep, recomputed[key]))
    last_ns: dict[str, int] = {}
    # parameters come before their tick, a sample without a stamp at any time within it
    for sample in sorted(
        samples, key=lambda s: (s.time_ns, s.key != PARAMETERS.key, s.stamp is None)
    ):
        if sample.key not in topics:
            continue
        kind = topics[sample.key].type
        if sample.key not in recorded:
            with recording.reading(sample):
                bus.put_bytes(sample.key, *sample.as_published(kind))
            while worker.step():
                pass
        elif sample.stamp is not None:
            with recording.reading(sample):
                _keep(recorded[sample.key], sample.message(kind), sample.stamp)
        if sample.stamp is not None and topics[sample.key].name in PERIODIC:
            last_ns[sample.key] = sample.time_ns
    # the last completely recorded tick
    horizon_ns = min(last_ns.values(), default=0)
    compared = {key: messages for key, messages in recorded.items() if messages}
    differences = [
        _compare(key, messages, recomputed[key], horizon_ns) for key, messages in compared.items()
    ]
    first = min(filter(None, differences), key=lambda difference: difference.time_ns, default=None)
    return Comparison(Counter({key: len(messages) for key, messages in compared.items()}), first)


def _keep(kept: Outputs, message: Message, stamp: Stamp | None) -> None:
    assert stamp is not None
    kept.append((stamp.time_ns, message))


def _compare(
    key: str, recorded: Outputs, recomputed: Outputs, horizon_ns: int
) -> Difference | None:
    within = (
        [(time_ns, message) for time_ns, message in outputs if time_ns <= horizon_ns]
        for outputs in (recorded, recomputed)
    )
    for (old_ns, old), (new_ns, new) in zip_longest(*within, fillvalue=(math.inf, Message())):
        if old_ns != new_ns:
            first_ns = min(old_ns, new_ns)
            values = ["a message" if ns == first_ns else NOTHING for ns in (old_ns, new_ns)]
            return Difference(key, int(first_ns), "", *values)
        # compared as bytes, since 0.0 and -0.0 are equal as numbers
        if encode(old) != encode(new):
            was, now = (dict(_leaves(msgspec.to_builtins(message))) for message in (old, new))
            paths = (path for path in was | now if was.get(path) != now.get(path))
            path = next(paths)
            recorded_value, value = was.get(path, NOTHING), now.get(path, NOTHING)
            return Difference(key, int(old_ns), path, recorded_value, value)
    return None


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield path and text of each number and text in a message."""
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _leaves(part, f"{path}.{name}" if path else name)
    elif isinstance(value, list | tuple):
        for index, part in enumerate(value):
            yield from _leaves(part, f"{path}[{index}]")
    else:
        yield path, repr(value)
