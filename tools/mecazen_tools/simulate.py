"""One whole lockstep run: in this process, or as processes over Zenoh, with one result."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import msgspec
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import to_value
from mecazen.graph import COLLECTOR
from mecazen.loading import load_scenario, parse_settings
from mecazen.robots import join_key
from mecazen.runtime.pace import announce_readiness, declare_every
from mecazen.wire import NS_PER_S
from msgspec.structs import asdict

from mecazen_tools.processes import Supervisor, private_router
from mecazen_tools.simulation import Simulation
from mecazen_tools.trajectory import Scores, Trajectory

Progress = Callable[[int], None]
"""Function that is called regularly with the number of finished ticks."""

PROGRESS_TICKS = 100
PATIENCE_S = 0.25
"""Time to wait for a sample before checking whether all processes are alive [s]."""


class Summary(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The scores of a run, whichever program drove: the output of `mecazen score --json`."""

    seed: int
    duration_s: float
    d_err_m: float | None
    theta_err_deg: float | None
    """With several robots, both measures are means over the robots."""
    contacts_persons: int
    """Number of contacts that begin with followed persons, and in the next with obstacles; with
    several robots, sums over the robots."""
    contacts_obstacles: int
    lost: dict[str, float] = {}
    """Share of time in which the person was lost, by reason; several robots have their own."""
    robots: dict[str, Scores] = {}
    """The measures of each of several robots, by its name."""


class Result(Summary, frozen=True, kw_only=True, omit_defaults=True):
    """The output of `mecazen simulate --json`."""

    scenario: str
    ticks: int
    wall_s: float
    rtf: float
    """Real-time factor: simulated over wall time, without the start."""
    trajectory_sha256: str


class InterruptedRun(KeyboardInterrupt):
    """Ctrl-C has ended a run; the arguments are its result and its trajectory until then."""


def simulate(
    scenario: Scenario, name: str, progress: Progress = lambda _: None
) -> tuple[Result, Trajectory]:
    """Run the services of a scenario in this process.

    Raises:
        MecazenError: A service failed.
    """
    with Simulation(scenario) as sim:
        return _scored(name, sim.trajectory, sim.ticks(), progress)


def simulate_distributed(
    path: Path, settings: tuple[str, ...], name: str, progress: Progress = lambda _: None
) -> tuple[Result, Trajectory]:
    """Run the services of a scenario's file, with overrides, as processes over Zenoh in lockstep.

    Raises:
        MecazenError: A service failed.
    """
    scenario = load_scenario(path, parse_settings(settings))
    settings = (
        *settings,
        "sim.mode=lockstep",
        f"services={to_value([*scenario.services, COLLECTOR])}",
        *private_router("tls" if scenario.bus.keys else "tcp"),
    )
    scenario = load_scenario(path, parse_settings(settings))
    if len(os.sched_getaffinity(0)) == 1:
        sys.stderr.write("all processes share the only core that this command may use\n")
    supervisor = Supervisor(path, settings)

    def show_output() -> None:
        """Show the output of the processes since the last call; raise if one has ended."""
        while (line := supervisor.poll(0.0)) is not None:
            sys.stderr.write(f"{line.text}\n")

    with ExitStack() as stack:
        stack.callback(supervisor.stop)
        supervisor.start_router()
        bus, trajectory = stack.enter_context(_collector(scenario))
        for process in scenario.process_plan:
            if COLLECTOR not in process.services:
                supervisor.start(process)
        scored = _scored(name, trajectory, _samples(bus, trajectory, show_output), progress)
        # a node may fail so late, or end so slowly, that the run is complete before
        supervisor.stop()
        supervisor.refuse_failed()
        return scored


def collect(
    scenario: Scenario, name: str, progress: Progress = lambda _: None
) -> tuple[Result, Trajectory]:
    """Collect a lockstep run of services that were started elsewhere with this scenario.

    Raises:
        MecazenError: The services run another scenario, or one of them ended too early.
    """
    if scenario.sim.mode != "lockstep" or COLLECTOR not in scenario.services:
        raise ConfigError(
            f"to collect, the services and this need sim.mode=lockstep, and {COLLECTOR!r} "
            "among `services`"
        )
    seen: set[str] = set()

    def refuse_missing() -> None:
        alive = bus.presence.names & {join_key(*part) for part in scenario.parts}
        seen.update(alive)
        if missing := sorted(seen - alive):
            raise MecazenError(f"{', '.join(missing)}: gone after {trajectory.done} ticks")

    with _collector(scenario) as (bus, trajectory):
        return _scored(name, trajectory, _samples(bus, trajectory, refuse_missing), progress)


@contextmanager
def _collector(scenario: Scenario) -> Iterator[tuple[ZenohBus, Trajectory]]:
    """Take part in a run as its collector, whose trajectory is still empty."""
    bus = ZenohBus(scenario.bus, name=COLLECTOR, renamed=scenario.renamed)
    with closing(bus):
        trajectory = Trajectory(bus, scenario)
        bus.declare_alive(COLLECTOR)
        declare_every(bus, COLLECTOR)
        announce_readiness(bus, COLLECTOR, "", scenario)
        yield bus, trajectory


def _samples(bus: ZenohBus, trajectory: Trajectory, check: Callable[[], None]) -> Iterator[None]:
    """Take samples until the run is complete; `check` raises if the run can't continue."""
    while not trajectory.complete:
        bus.spin_once(PATIENCE_S)
        check()
        yield


def _scored(
    name: str, trajectory: Trajectory, steps: Iterable[None], progress: Progress
) -> tuple[Result, Trajectory]:
    """Make all steps of a run; return its result.

    Raises:
        MecazenError: The run is incomplete.
        InterruptedRun: Ctrl-C ended the run after its first tick.
    """
    begin, reported, interrupted = time.perf_counter(), 0, False
    try:
        for _ in steps:
            if trajectory.done == 0:
                begin = time.perf_counter()
            if trajectory.done >= reported + PROGRESS_TICKS:
                reported = trajectory.done
                progress(reported)
        progress(trajectory.done)
        trajectory.refuse_incomplete()
    except KeyboardInterrupt:
        if trajectory.done == 0:
            raise
        interrupted = True
    wall_s, shown = time.perf_counter() - begin, summary(trajectory)
    result = Result(
        **asdict(shown),
        scenario=name,
        ticks=trajectory.done,
        wall_s=wall_s,
        rtf=shown.duration_s / wall_s,
        trajectory_sha256=trajectory.sha256(),
    )
    if interrupted:
        raise InterruptedRun(result, trajectory)
    return result, trajectory


def summary(trajectory: Trajectory) -> Summary:
    """Return what the finished ticks of a run show."""
    scenario = trajectory.scenario
    scores = {robot: trajectory.scores(robot) for robot in scenario.names}
    contacts = [trajectory.contacts(robot) for robot in scenario.names]
    return Summary(
        seed=scenario.seed,
        duration_s=trajectory.done * scenario.sim.tick_ns / NS_PER_S,
        d_err_m=_mean(score.d_err_m for score in scores.values()),
        theta_err_deg=_mean(score.theta_err_deg for score in scores.values()),
        contacts_persons=sum(counts.persons for counts in contacts),
        contacts_obstacles=sum(counts.obstacles for counts in contacts),
        lost={} if scenario.robots else trajectory.lost(),
        robots=scores if scenario.robots else {},
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None
