"""One whole lockstep run: in this process, or as processes over Zenoh, with one result."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import msgspec
from mecazen.bus import Bus, LocalBus
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import to_value
from mecazen.graph import COLLECTOR, OBSERVERS
from mecazen.keys import ODOM
from mecazen.loading import load_scenario, parse_settings
from mecazen.programs import graph_of
from mecazen.robots import join_key
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen.runtime.pace import declare_every
from mecazen.runtime.process import observe
from mecazen.runtime.readiness import announce_readiness
from mecazen.wire import NS_PER_S

from mecazen_tools.processes import Supervisor, beside_that_core, on_one_core, private_router
from mecazen_tools.trajectory import Scores, Trajectory

Progress = Callable[[int], None]
"""Function that is called regularly with the number of finished ticks."""

PROGRESS_TICKS = 100
PATIENCE_S = 0.25
"""Time to wait for a sample before checking whether all processes are alive [s]."""


class Result(msgspec.Struct, frozen=True, omit_defaults=True):
    """The output of `mecazen simulate --json`."""

    scenario: str
    seed: int
    ticks: int
    duration_s: float
    wall_s: float
    rtf: float
    """Real-time factor: simulated over wall time, without the start."""
    d_err_m: float | None
    theta_err_deg: float | None
    """With several robots, both measures are means over the robots."""
    contacts_persons: int
    """Number of contacts that begin with followed persons, and in the next with obstacles; with
    several robots, sums over the robots."""
    contacts_obstacles: int
    trajectory_sha256: str
    robots: dict[str, Scores] = {}
    """The measures of each of several robots, by its name."""


class InterruptedRun(KeyboardInterrupt):
    """Ctrl-C has ended a run; the arguments are its result and its trajectory until then."""


def in_lockstep(scenario: Scenario) -> Scenario:
    """Return the scenario with simulated time in lockstep."""
    sim = msgspec.structs.replace(scenario.sim, mode="lockstep")
    return msgspec.structs.replace(scenario, sim=sim)


class InProcess:
    """All services of a scenario in this process, in lockstep: `step` makes a tick.

    Raises:
        ConfigError: The scenario does not suit a service, or nothing in it owns time.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = in_lockstep(scenario)
        self.bus = LocalBus(scenario.renamed)
        self.trajectory = _trajectory(self.bus, self.scenario, self.scenario.services)
        observing = [part for part in self.scenario.parts if part[0] in OBSERVERS]
        self.host = Host(
            [part for part in self.scenario.parts if part not in observing],
            self.bus,
            self.scenario,
        )
        self.clock = Clock(self.host)
        self.observers = [observe(part, self.bus, self.scenario) for part, _ in observing]
        for service, robot in self.scenario.parts:
            self.bus.declare_alive(service, robot)

    def begin(self) -> None:
        """Make the first tick of the run."""
        self.clock.begin()

    def reset(self, seed: int) -> None:
        """Return everything to the start, with noise from `seed`; `begin` makes the first tick."""
        self.scenario = msgspec.structs.replace(self.scenario, seed=seed)
        self.trajectory.reset()
        self.clock.reset(seed)

    def step(self) -> None:
        """Make the next tick."""
        self.clock.step()

    def ticks(self) -> Iterator[None]:
        """Make the whole run; yield after each tick but the last."""
        self.begin()
        for _ in range(1, self.scenario.sim.ticks):
            yield
            self.step()

    def close(self) -> None:
        """End the services' work."""
        self.host.close()
        for observer in self.observers:
            observer.close()


def simulate(
    scenario: Scenario, name: str, progress: Progress = lambda _: None
) -> tuple[Result, Trajectory]:
    """Run the services of a scenario on the bus within this process.

    Raises:
        MecazenError: A service failed.
    """
    with closing(InProcess(scenario)) as run, _keeping(run.scenario, name, run.trajectory):
        begin = time.perf_counter()
        for tick, _ in enumerate(run.ticks(), 1):
            if tick % PROGRESS_TICKS == 0:
                progress(tick)
    wall_s = time.perf_counter() - begin
    progress(scenario.sim.ticks)
    return result(run.scenario, name, run.trajectory, wall_s), run.trajectory


@contextmanager
def _keeping(scenario: Scenario, name: str, trajectory: Trajectory) -> Iterator[None]:
    """Let a Ctrl-C within this context keep the run: raise `InterruptedRun`, once a tick is done.

    A library that calls this module meets a KeyboardInterrupt, as it expects.
    """
    begin = time.perf_counter()
    try:
        yield
    except KeyboardInterrupt:
        if trajectory.done == 0:
            raise
        wall_s = time.perf_counter() - begin
        raise InterruptedRun(_scored(scenario, name, trajectory, wall_s), trajectory) from None


def _trajectory(bus: Bus, scenario: Scenario, parts: Sequence[str]) -> Trajectory:
    """Return a trajectory that collects the samples of a run."""
    sim = scenario.sim
    rate = graph_of(scenario).rate(ODOM.key)
    per_odom = {robot: scenario.of(robot).ticks_per(rate) for robot in scenario.names}
    return Trajectory(bus, sim.tick_ns, sim.ticks, parts, per_odom)


def result(scenario: Scenario, name: str, trajectory: Trajectory, wall_s: float) -> Result:
    """Return the result of a finished run.

    Raises:
        MecazenError: The run is incomplete.
    """
    if not trajectory.complete:
        raise MecazenError(f"the run ended after {trajectory.done} of {scenario.sim.ticks} ticks")
    return _scored(scenario, name, trajectory, wall_s)


def _scored(scenario: Scenario, name: str, trajectory: Trajectory, wall_s: float) -> Result:
    """Return the result of the finished ticks of a run."""
    scores = {
        robot: trajectory.scores(scenario.of(robot).follower.standoff, robot)
        for robot in scenario.names
    }
    contacts = [trajectory.contacts(scenario, robot) for robot in scenario.names]
    duration_s = trajectory.done * scenario.sim.tick_ns / NS_PER_S
    return Result(
        scenario=name,
        seed=scenario.seed,
        ticks=trajectory.done,
        duration_s=duration_s,
        wall_s=wall_s,
        rtf=duration_s / wall_s,
        d_err_m=_mean(of.d_err_m for of in scores.values()),
        theta_err_deg=_mean(of.theta_err_deg for of in scores.values()),
        contacts_persons=sum(each.persons for each in contacts),
        contacts_obstacles=sum(each.obstacles for each in contacts),
        trajectory_sha256=trajectory.sha256(),
        robots=scores if scenario.robots else {},
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None


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
    supervisor = Supervisor(path, settings, scenario)
    try:
        with on_one_core():
            supervisor.start_router()
        with beside_that_core():
            bus = _collector_bus(scenario)
        with closing(bus):
            trajectory = _join(bus, scenario)
            for process in scenario.process_plan:
                if COLLECTOR in process.services:
                    continue
                # observers, for which no tick waits, avoid the core of the others
                observes = process.services[0] in OBSERVERS
                with beside_that_core() if observes else on_one_core():
                    supervisor.start(process)
            with beside_that_core(), _keeping(scenario, name, trajectory):
                wall_s = _collect(trajectory, bus, partial(_pass_on, supervisor), progress)
    finally:
        supervisor.stop()
    return result(scenario, name, trajectory, wall_s), trajectory


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
    parts = {join_key(*part) for part in scenario.parts}

    def check() -> None:
        alive = bus.presence.names & parts
        seen.update(alive)
        if gone := sorted(seen - alive):
            raise MecazenError(f"{', '.join(gone)}: gone after {trajectory.done} ticks")

    bus = _collector_bus(scenario)
    with closing(bus):
        trajectory = _join(bus, scenario)
        with _keeping(scenario, name, trajectory):
            wall_s = _collect(trajectory, bus, check, progress)
    return result(scenario, name, trajectory, wall_s), trajectory


def _pass_on(supervisor: Supervisor) -> None:
    """Show the output of the processes since the last call.

    Raises:
        ProcessError: A process has ended.
    """
    while (line := supervisor.poll(0.0)) is not None:
        sys.stderr.write(f"{line.text}\n")


def _collector_bus(scenario: Scenario) -> ZenohBus:
    return ZenohBus(scenario.bus, name=COLLECTOR, renamed=scenario.renamed)


def _join(bus: ZenohBus, scenario: Scenario) -> Trajectory:
    """Take part in a run as its collector; return the trajectory, which is still empty."""
    parts = [part for part in scenario.services if part != COLLECTOR]
    trajectory = _trajectory(bus, scenario, parts)
    bus.declare_alive(COLLECTOR)
    declare_every(bus, COLLECTOR)
    announce_readiness(bus, COLLECTOR, "", scenario)
    return trajectory


def _collect(
    trajectory: Trajectory, bus: ZenohBus, check: Callable[[], object], progress: Progress
) -> float:
    """Take samples until the run is complete; return the wall time since its first tick [s].

    `check` is called repeatedly, and raises if the run can't continue.
    """
    begin, reported = time.perf_counter(), 0
    while not trajectory.complete:
        bus.spin_once(PATIENCE_S)
        if trajectory.done == 0:
            begin = time.perf_counter()
        if trajectory.done >= reported + PROGRESS_TICKS:
            reported = trajectory.done
            progress(reported)
        check()
    progress(trajectory.done)
    return time.perf_counter() - begin
