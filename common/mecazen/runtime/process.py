"""Runs services as a process: bus, liveliness, priority, signals."""

from __future__ import annotations

import logging
import os
import signal
import threading
import zlib
from contextlib import suppress
from pathlib import Path

from mecazen import log
from mecazen.bridges import Put, bridge_of
from mecazen.bus.base import StoppedError
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, Process, Scenario
from mecazen.errors import BusError
from mecazen.graph import SHARED
from mecazen.programs import graph_of
from mecazen.robots import join_key
from mecazen.runtime.drivers import drive
from mecazen.runtime.host import Host, part_of
from mecazen.runtime.observer import Observer
from mecazen.runtime.readiness import announce_readiness
from mecazen.runtime.report import Report, Reporter
from mecazen.runtime.router import stop_on_signals
from mecazen.wire import NS_PER_S

logger = logging.getLogger(__name__)


def run_process(process: Process, scenario: Scenario, reporter: Reporter) -> None:
    """Run the services of a process on Zenoh until a signal ends them.

    Raises:
        MecazenError: A name is taken, the bus can't be opened, or a service failed.
    """
    shared = set(process.services) & set(SHARED)
    parts = [
        (service, robot)
        for service in process.services
        for robot in _robots(service, process, scenario, all_robots=bool(shared))
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
    bus = ZenohBus(scenario.bus, name=process.services[0])
    stop_on_signals(bus.stop)
    side = None
    try:
        driver = drive(parts, bus, scenario)
        put: Put = _put_nowhere
        if isinstance(driver, Observer):
            driver.announce = lambda url: reporter.tell(Report("serving", url))
            members.append(driver)
        else:
            members.append(driver.host)
            put = driver.host.put
        bridge = bridge_of(scenario.bus)
        if bridge is not None:
            side = bridge.open_side(scenario.bus, process.services[0])
            for service, robot in parts:
                seen = part_of(service, scenario, robot)
                side.show(service, robot, bus, put, seen, graph_of(seen))
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
        if side is not None:
            side.close()
        bus.close()


def _put_nowhere(*_: object) -> None:
    """Publish nothing: an observer takes no commands."""


def _robots(
    service: str, process: Process, scenario: Scenario, *, all_robots: bool
) -> tuple[str, ...]:
    if service in SHARED:
        # a robot that is named for what all share is refused, see `part_of`
        return (process.robot,)
    return scenario.names if all_robots else (process.robot,)


def _set_real_time_priority(process: Process, scenario: Scenario) -> None:
    """Let a process of real time go before what else the machine does, where that is allowed.

    As ros2_control's controller manager does. The processes of a stack then share one core: they
    take turns anyway, and to wake on another takes longer than to wait. Threads that are started
    later do likewise. Faster than real time a process may never rest, and would lock out all
    others.
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
    """Return the core of a stack: of several, each has one by chance, and always the same."""
    cores = sorted(os.sched_getaffinity(0))
    stack = f"{bus.router_endpoints} {bus.namespace}"
    return cores[zlib.crc32(stack.encode()) % len(cores)]


def _refuse_taken_names(parts: list[tuple[str, str]], config: BusConfig) -> None:
    """Raise BusError if a service of one of these names is alive.

    It asks as a client, since only a client's session begins with its link to the router.
    """
    try:
        bus = ZenohBus(config, "client", name=parts[0][0])
    except BusError:
        return  # no router yet, so nobody is to be met there either
    try:
        alive = bus.alive()
        for name in (join_key(*part) for part in parts):
            if name in alive:
                raise BusError(f"another {name} is already running on this bus")
    finally:
        bus.close()


def end_with_stdin() -> None:
    """End this process as a signal does when standard input closes.

    So it does when the process that has started this one dies, in whatever way.
    """

    def wait() -> None:
        # not through sys.stdin, whose lock a thread that waits would hold at the process's exit
        while os.read(0, 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()
