"""Runs services, or the router, as a process: bus, driver, liveliness, priority and signals."""

from __future__ import annotations

import logging
import os
import signal
import sys
import zlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from mecazen.bus import Bus, StoppedError
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus, next_of
from mecazen.config import BusConfig, Process, Scenario
from mecazen.errors import BusError, ConfigError, MecazenError, is_installed, set_up_log
from mecazen.graph import OBSERVERS, SHARED
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.programs import classes, graph_of
from mecazen.robots import join_key
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host, part_of
from mecazen.runtime.observer import Observer
from mecazen.runtime.pace import announce_readiness
from mecazen.runtime.worker import Worker
from mecazen.wire import NS_PER_S

logger = logging.getLogger(__name__)

SAMPLES_PER_TICK = 10
"""In real time, the number of samples per tick that a router accepts on a key from each link."""

ROUTER = Process(("router",))
"""The Zenoh router."""

FAILED = "error: "
"""Begin of the line with the error of a process."""


def run_to_exit(process: Process, scenario: str, settings: Sequence[str]) -> None:
    """Run a process of a scenario, given by its name or file; exit with an error in one line."""
    try:
        run(process, load_scenario(scenario_path(scenario), parse_settings(settings)))
    except MecazenError as error:
        sys.stderr.write(f"{FAILED}{error}\n")
        sys.exit(error.exit_code)


def run(process: Process, scenario: Scenario) -> None:
    """Run the services of a process, or the router, on Zenoh until a signal ends them.

    Raises:
        ConfigError: A service does not exist, is named twice, or the scenario does not suit it.
        MecazenError: A name or a port is taken, the bus can't be opened, or a service failed.
    """
    refuse_missing_ros(scenario.bus)
    if process.services == ROUTER.services:
        _run_router(scenario)
    else:
        _run_services(process, scenario)


def _run_services(process: Process, scenario: Scenario) -> None:
    first = process.services[0]
    if len(set(process.services)) < len(process.services):
        raise ConfigError(f"{process.name}: each service at most once")
    named = (process.robot,)  # `part_of` refuses a robot's name for a shared service
    robots = scenario.names if {*process.services} & {*SHARED} else named
    parts = [
        (service, robot)
        for service in process.services
        for robot in (named if service in SHARED else robots)
    ]
    configs = [part_of(service, scenario, robot) for service, robot in parts]
    members: list[Host | Observer] = []
    set_up_log(process.name, lambda: members[0].stamp.time_ns / NS_PER_S if members else 0.0)
    _refuse_taken_names(parts, scenario.bus)
    bus = ZenohBus(scenario.bus, name=first, renamed=scenario.renamed)
    stop_on_signals(bus.stop)
    try:
        with ExitStack() as exits:
            exits.callback(bus.close)
            driver: Observer | Clock | Worker
            put: Callable[..., None] = lambda *_: None  # noqa: E731  # of an observer
            if first in OBSERVERS:
                driver = observe(first, bus, scenario)
                members.append(driver)
                exits.callback(driver.close)
            else:
                host = Host(parts, bus, scenario)
                members.append(host)
                exits.callback(host.close)
                driver = Worker(host) if host.clock is None else Clock(host)
                put = host.put
            if scenario.bus.ros2:
                from mecazen_ros.node import RosNode, RosSession  # noqa: PLC0415  # optional

                ros = exits.enter_context(closing(RosSession(scenario.bus, first, bus, put)))
                for (service, robot), config in zip(parts, configs, strict=True):
                    RosNode(ros, service, robot, config)
            for service, robot in parts:
                bus.declare_alive(service, robot)
            for service, robot in parts:
                announce_readiness(bus, service, robot, scenario)
            _schedule(process, scenario)
            logger.info("msg=started mode=%s", scenario.sim.mode)
            driver.run()
    except StoppedError:
        logger.info("msg=stopped")


def _run_router(scenario: Scenario) -> None:
    set_up_log("router", lambda: 0.0)
    stopped: SimpleQueue[None] = SimpleQueue()
    stop_on_signals(partial(stopped.put, None))
    sim = scenario.sim
    # lockstep has no rate: ticks may be fast, and a dropped sample would be awaited in vain
    most_hz = SAMPLES_PER_TICK * sim.speed / sim.tick_s if sim.mode == "real_time" else None
    with open_session(
        scenario.bus,
        "router",
        "router",
        most_hz=most_hz,
        robots=scenario.names,
        renamed=scenario.renamed,
    ):
        logger.info("msg=started endpoints=%s", ",".join(scenario.bus.router_endpoints or ()))
        next_of(stopped)


def refuse_missing_ros(config: BusConfig) -> None:
    """Check that the extra for ROS 2 is installed, if the settings ask for it.

    Raises:
        BusError: It is not.
    """
    if config.ros2 and not is_installed("ros2"):
        raise BusError("bus.ros2 needs pip install 'mecazen[ros2]'")


def observe(service: str, bus: Bus, scenario: Scenario) -> Observer:
    """Return an observer, ready to run.

    Raises:
        ConfigError: Its class does not exist, or is no observer.
    """
    (kind,) = classes(service, scenario).values()
    assert issubclass(kind, Observer)  # `classes` refuses other types
    observer = kind(service, bus, scenario)
    with ExitStack() as failed:
        failed.callback(observer.close)
        observer.reset(scenario.seed)
        failed.pop_all()
    return observer


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGINT, SIGTERM and SIGHUP."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop())


def _schedule(process: Process, scenario: Scenario) -> None:
    """Give all threads a scheduling policy and the core of their stack, if the system permits it.

    The processes of a stack take turns anyway, and waking one on another core takes longer than
    waiting. On one core, `mecazen up back` takes 23 % less processor time, and a distributed run
    makes 22 % more ticks a second. Stacks choose cores by a hash of their endpoints and namespace.

    In real time the policy is real-time priority, as for ros2_control's controller manager. Faster
    than real time, a process may never sleep and would block all others. In lockstep the policy for
    batch processes lets a sender finish before a receiver takes over, for 12 % more ticks.
    """
    table = graph_of(scenario).services
    priority = max((row.priority for s in process.services for row in table.get(s, ())), default=0)
    if not priority or (scenario.sim.mode == "real_time" and scenario.sim.speed > 1.0):
        return
    policy = os.SCHED_RR
    if scenario.sim.mode == "lockstep":
        policy, priority = os.SCHED_BATCH, 0
    cores = sorted(os.sched_getaffinity(0))
    stack = f"{scenario.bus.router_endpoints} {scenario.bus.namespace}"
    core = cores[zlib.crc32(stack.encode()) % len(cores)]
    done: set[Path] = set()
    while threads := {*Path("/proc/self/task").iterdir()} - done:  # a thread may start another
        for thread in threads:
            with suppress(PermissionError, ProcessLookupError):  # a thread may just have ended
                os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
                os.sched_setaffinity(int(thread.name), {core})
        done |= threads


def _refuse_taken_names(parts: list[tuple[str, str]], config: BusConfig) -> None:
    """Check that no service with one of these names is alive.

    The query uses a client session, since only a client's session begins with its link to the
    router.
    """
    try:
        bus = ZenohBus(config, "client", name=parts[0][0])
    except BusError:
        if config.mode == "client":  # it has waited for the router
            raise
        return  # without a router there is no other service
    with closing(bus):
        alive = bus.alive()
    for name in (join_key(*part) for part in parts):
        if name in alive:
            raise BusError(f"another {name} is already running on this bus")
