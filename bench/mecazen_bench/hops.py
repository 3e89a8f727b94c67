"""What Zenoh alone takes for a tick: processes that pass bytes on, as many and as long as ours."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, suppress
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

from mecazen.bus.receiving import direct
from mecazen.bus.session import open_session
from mecazen.config import BusConfig, Scenario
from mecazen.graph import COLLECTOR, TABLE, Graph
from mecazen.programs import graph_of
from mecazen.wire import Stamp, encode
from mecazen_tools.processes import beside_that_core, on_one_core
from mecazen_tools.simulate import InProcess

NUMBER_BYTES = 8
"""A sample begins with the number of its tick; the last has none, and ends who receives it."""
ATTACHMENT = Stamp(0, 0, 0).pack()
AGAIN_S = 0.2
"""So long a tick may take at first, until all processes have found each other."""


class Relay(NamedTuple):
    """A node that computes nothing: once it has a tick's inputs, it publishes its outputs."""

    inputs: tuple[str, ...]
    outputs: Mapping[str, int]
    """Bytes of each."""


def relays_of(scenario: Scenario) -> list[list[Relay]]:
    """Return the relays of each process of a distributed run: first that of the world.

    Of a process they take and give what comes in every tick, as long as it is in the first.
    """
    graph, lengths = graph_of(scenario), _lengths(scenario)
    found = []
    for process in scenario.process_plan:
        rows = [row for part in process.services for row in graph.services[part] if row.inputs]
        found.append(
            [
                Relay(
                    tuple(
                        given.topic.key
                        for given in graph.resolved(row, lockstep=True)
                        if given.rule != "latest" and _each_tick(scenario, graph, given.topic.key)
                    ),
                    {t.key: lengths[t.key] for t in row.outputs if t.key in lengths},
                )
                for row in rows
            ]
        )
    return sorted(found, key=lambda relays: "joint_states" not in relays[0].outputs)


def _each_tick(scenario: Scenario, graph: Graph, key: str) -> bool:
    return graph.giver(key) is not None and scenario.ticks_per(graph.rate(key)) == 1


def _lengths(scenario: Scenario) -> dict[str, int]:
    """Return the bytes of what nodes give in the first tick of a run."""
    found: dict[str, int] = {}
    graph = graph_of(scenario)
    with closing(InProcess(scenario)) as run:
        for topic in graph.topics:
            if _each_tick(scenario, graph, topic.key):
                take = partial(_note_length, found, topic.key, scenario)
                run.bus.subscribe(topic, take)
        run.begin()
        run.end()
    return found


def _note_length(
    found: dict[str, int], key: str, scenario: Scenario, message: Any, _: Stamp | None
) -> None:
    found[key] = len(encode(message, scenario.bus.format))


def rate(scenario: Scenario, ticks: int) -> float:
    """Return ticks a second, of processes that are placed as those of a distributed run.

    A router runs where the scenario says.
    """
    config = scenario.bus
    first, *others = relays_of(scenario)
    listener = [Relay(tuple(i.topic.key for i in TABLE[COLLECTOR].inputs), {})]
    with ProcessPoolExecutor(2 + len(others), get_context("spawn")) as pool:
        with beside_that_core():
            ends = [pool.submit(pass_on, config, listener)]
        with on_one_core():
            ends += [pool.submit(pass_on, config, relays) for relays in others]
            found = pool.submit(lead, config, first, ticks).result()
        for end in ends:
            end.result()
    return found


class _Passing:
    """The relays of a process, on a session."""

    def __init__(self, session: Any, relays: Sequence[Relay]) -> None:
        self._relays = relays
        self._queue: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._newest = {key: -1 for relay in relays for key in relay.inputs}
        self._publishers = {
            key: session.declare_publisher(key) for relay in relays for key in relay.outputs
        }
        for key in self._newest.keys() - self._publishers.keys():
            session.declare_subscriber(key, direct(partial(self._receive, key)))

    def _receive(self, key: str, sample: Any) -> None:
        self._queue.put((key, sample.payload.to_bytes()))

    def whole(self, timeout_s: float | None = None) -> Iterator[tuple[Relay, int]]:
        """Yield each relay that has all of a tick, until an empty sample comes.

        Raises:
            queue.Empty: Nothing comes in time.
        """
        while True:
            key, payload = self._queue.get(timeout=timeout_s)
            if not payload:
                return
            yield from self._take(key, int.from_bytes(payload[:NUMBER_BYTES]))

    def _take(self, key: str, number: int) -> Iterator[tuple[Relay, int]]:
        self._newest[key] = number
        for relay in self._relays:
            if key in relay.inputs and all(self._newest[i] == number for i in relay.inputs):
                yield relay, number
                for own in relay.outputs.keys() & self._newest.keys():
                    yield from self._take(own, number)

    def publish(self, relay: Relay, number: int) -> None:
        """Publish a relay's outputs of a tick."""
        for key, length in relay.outputs.items():
            payload = number.to_bytes(NUMBER_BYTES) + bytes(length - NUMBER_BYTES)
            self._publishers[key].put(payload, attachment=ATTACHMENT)

    def end(self) -> None:
        """Publish that it ends."""
        for publisher in self._publishers.values():
            publisher.put(b"")


def pass_on(config: BusConfig, relays: Sequence[Relay]) -> None:
    """Relay until an empty sample comes, and pass that on."""
    with open_session(config, "peer") as session:
        passing = _Passing(session, relays)
        for relay, number in passing.whole():
            passing.publish(relay, number)
        passing.end()


def lead(config: BusConfig, relays: Sequence[Relay], ticks: int) -> float:
    """Relay as the world does, which begins each tick; return ticks a second."""
    (world,) = relays
    with open_session(config, "peer") as session:
        passing = _Passing(session, relays)
        number = answered = 0
        while not answered:
            number += 1
            passing.publish(world, number)
            with suppress(queue.Empty):
                _, answered = next(passing.whole(AGAIN_S))
        begin, last = time.perf_counter(), number + ticks
        answers = passing.whole()
        while number < last:
            if answered == number:
                number += 1
                passing.publish(world, number)
            _, answered = next(answers)
        elapsed_s = time.perf_counter() - begin
        passing.end()
    return ticks / elapsed_s
