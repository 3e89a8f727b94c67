"""Runs services, or the router, as a process: bus, driver, liveliness, priority and signals."""

from __future__ import annotations

import logging
import os
import signal
import threading
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from contextlib import suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from mecazen import log
from mecazen.bus import Bus, StoppedError
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus, next_of
from mecazen.config import BusConfig, Process, Scenario
from mecazen.errors import BusError, ConfigError
from mecazen.extras import is_installed
from mecazen.graph import OBSERVERS, SHARED
from mecazen.programs import classes, graph_of
from mecazen.robots import join_key
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host, Part, part_of
from mecazen.runtime.observer import Observer
from mecazen.runtime.readiness import announce_readiness
from mecazen.runtime.report import Report, Reporter
from mecazen.runtime.worker import Worker
from mecazen.wire import NS_PER_S

logger = logging.getLogger(__name__)

SAMPLES_PER_TICK = 10
"""In real time, the number of samples per tick that a router accepts on a key from each link."""


def run_process(process: Process, scenario: Scenario, reporter: Reporter) -> None:
    """Run the services of a process on Zenoh until a signal ends them.

    Raises:
        ConfigError: A service is named twice.
        MecazenError: A name is taken, the bus can't be opened, or a service failed.
    """
    refuse_missing_ros(scenario.bus)
    if len(set(process.services)) < len(process.services):
        raise ConfigError(f"{process.name}: each service at most once")
    named = (process.robot,)  # `part_of` refuses a robot's name for a shared service
    robots = scenario.names if {*process.services} & {*SHARED} else named
    parts = [
        (service, robot)
        for service in process.services
        for robot in (named if service in SHARED else robots)
    ]
    for service, robot in parts:
        part_of(service, scenario, robot)
    members: list[Host | Observer] = []
    log.set_up(
        process.name,
        lambda: members[0].stamp.time_ns / NS_PER_S if members else 0.0,
        reporter.log_level,
    )
    _refuse_taken_names(parts, scenario.bus)
    bus = ZenohBus(scenario.bus, name=process.services[0], renamed=scenario.renamed)
    stop_on_signals(bus.stop)
    ros = None
    try:
        driver = drive(parts, bus, scenario)
        put: Callable[..., None] = lambda *_: None  # noqa: E731  # an observer gets no commands
        if isinstance(driver, Observer):
            driver.announce = lambda url: reporter.tell(Report("serving", url))
            members.append(driver)
        else:
            members.append(driver.host)
            put = driver.host.put
        if scenario.bus.ros2:
            from mecazen_ros.node import RosNode, RosSession  # noqa: PLC0415  # optional

            ros = RosSession(scenario.bus, process.services[0], bus, put)
            for service, robot in parts:
                RosNode(ros, service, robot, part_of(service, scenario, robot))
        for service, robot in parts:
            bus.declare_alive(service, robot)
        for service, robot in parts:
            announce_readiness(bus, service, robot, scenario)
        _set_real_time_priority(process, scenario)
        logger.info("msg=started mode=%s", scenario.sim.mode)
        reporter.tell(Report("started"))
        driver.run()
    except StoppedError:
        logger.info("msg=stopped")
    finally:
        for member in members:
            member.close()
        if ros is not None:
            ros.close()
        bus.close()


def refuse_missing_ros(config: BusConfig) -> None:
    """Check that the extra for ROS 2 is installed, if the settings ask for it.

    Raises:
        BusError: It is not.
    """
    if config.ros2 and not is_installed("ros2"):
        raise BusError("bus.ros2 needs pip install 'mecazen[ros2]'")


def drive(parts: Sequence[Part], bus: Bus, scenario: Scenario) -> Clock | Worker | Observer:
    """Return the driver of a process's services, ready to run.

    Raises:
        ConfigError: A service does not exist, or the scenario does not suit it.
    """
    if parts[0][0] in OBSERVERS:
        return observe(parts[0][0], bus, scenario)
    host = Host(parts, bus, scenario)
    return Worker(host) if host.clock is None else Clock(host)


def observe(service: str, bus: Bus, scenario: Scenario) -> Observer:
    """Return an observer, ready to run; raises as `drive`."""
    (kind,) = classes(service, scenario).values()
    assert issubclass(kind, Observer)  # `classes` refuses other types
    observer = kind(service, bus, scenario)
    observer.reset(scenario.seed)
    return observer


def run_router(scenario: Scenario, reporter: Reporter) -> None:
    """Run the router until a signal ends it.

    Raises:
        BusError: The port is taken, or an endpoint is insecure.
    """
    refuse_missing_ros(scenario.bus)
    log.set_up("router", lambda: 0.0, reporter.log_level)
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
        reporter.tell(Report("started"))
        next_of(stopped)


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGINT, SIGTERM and SIGHUP."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop())


def _set_real_time_priority(process: Process, scenario: Scenario) -> None:
    """Give the process real-time priority and a core of its stack, if the system permits it.

    ros2_control's controller manager does the same. The processes of a stack share one core: they
    take turns anyway, and waking a process on another core takes longer than waiting. Threads
    that start later inherit both settings. In lockstep, or faster than real time, a process may
    never sleep and would block all others, so it gets no priority.
    """
    table = graph_of(scenario).services
    priority = max((row.priority for s in process.services for row in table.get(s, ())), default=0)
    if not priority or scenario.sim.mode == "lockstep" or scenario.sim.speed > 1.0:
        return
    core = _core_of(scenario.bus)
    for path in Path("/proc/self/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):  # a thread may just have ended
            os.sched_setscheduler(int(path.name), os.SCHED_RR, os.sched_param(priority))
            os.sched_setaffinity(int(path.name), {core})


def _core_of(bus: BusConfig) -> int:
    """Return the core of a stack.

    The order of the cores is by a hash of the stack's endpoints and namespace. So processes that
    look at the same time, or do not see each other, choose the same core.
    """
    cores = sorted(os.sched_getaffinity(0))
    first = zlib.crc32(f"{bus.router_endpoints} {bus.namespace}".encode()) % len(cores)
    return choose_core(cores[first:] + cores[:first], _real_time_processes(), os.getppid())


def choose_core(cores: Sequence[int], others: Iterable[tuple[int, Set[int]]], parent: int) -> int:
    """Return the core of the processes with the same parent, else the first of the freest cores.

    Args:
        cores: Cores to choose from.
        others: Parent and cores of each other process with real-time priority.
        parent: Parent of this process.
    """
    taken: Counter[int] = Counter()
    for other, its_cores in others:
        if other == parent and len(its_cores) == 1 and its_cores <= set(cores):
            return next(iter(its_cores))
        taken.update(its_cores)
    return min(cores, key=taken.__getitem__)


def _real_time_processes() -> Iterator[tuple[int, Set[int]]]:
    """Yield parent and cores of each process with real-time priority."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it may just have ended
            if os.sched_getscheduler(int(folder.name)) == os.SCHED_RR:
                parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
                yield int(parent), os.sched_getaffinity(int(folder.name))


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
    try:
        alive = bus.alive()
        for name in (join_key(*part) for part in parts):
            if name in alive:
                raise BusError(f"another {name} is already running on this bus")
    finally:
        bus.close()


def end_with_stdin() -> None:
    """Send SIGTERM to this process when standard input closes.

    Standard input also closes when the parent process dies, for any reason.
    """

    def wait() -> None:
        # a thread that waits in sys.stdin would hold its lock at the process's exit
        while os.read(0, 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()
