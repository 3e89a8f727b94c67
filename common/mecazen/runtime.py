"""Runs one service as a process: configuration, bus, liveliness, signals, errors."""

from __future__ import annotations

import argparse
import gc
import importlib
import importlib.util
import logging
import os
import signal
import sys
import threading
import zlib
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from mecazen import log
from mecazen.bus.base import Bus, StoppedError
from mecazen.bus.zenoh_bus import ZenohBus, open_session
from mecazen.config import OBSERVERS, SHARED, BusConfig, Scenario, join_key
from mecazen.errors import BusError, ConfigError, MecazenError
from mecazen.loading import load_scenario, scenario_path
from mecazen.service import NS_PER_S, Service

logger = logging.getLogger(__name__)

SAMPLES_PER_TICK = 10
"""In real time a router takes so many from each of its links, on one key; more is a flood."""


def installed_services() -> list[str]:
    """Return the names of the services that are installed here."""
    return sorted(entry.name for entry in entry_points(group="mecazen.services"))


def find_service(name: str, scenario: Scenario) -> type[Service]:
    """Return the class that plays the part `name` in a scenario.

    Args:
        name: A part of the scenario, an installed service, or `file.py:Class` of one's own.
        scenario: Its `programs` may put another class in a part's place.

    Raises:
        ConfigError: There is no such class.
    """
    program = scenario.programs.get(name, name)
    for entry in entry_points(group="mecazen.services"):
        if entry.name == program:
            return _checked(entry.load(), program)
    place, colon, attribute = program.partition(":")
    if not colon:
        known = ", ".join(installed_services()) or "none"
        raise ConfigError(
            f"{program}: no such service; installed: {known}; or file.py:Class of your own"
        )
    return _checked(getattr(_import(place), attribute, None), program)


def _import(place: str) -> ModuleType:
    try:
        if not place.endswith(".py"):
            if not all(part.isidentifier() for part in place.split(".")):
                raise ConfigError(f"{place or repr(place)}: neither file.py nor a module's name")
            return importlib.import_module(place)
        spec = importlib.util.spec_from_file_location(Path(place).stem, place)
        if spec is None or spec.loader is None:
            raise ConfigError(f"{place}: can't be imported")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except (ImportError, OSError, SyntaxError) as error:
        raise ConfigError(f"{place}: can't be imported: {error}") from None
    return module


def _checked(found: object, program: str) -> type[Service]:
    if not (isinstance(found, type) and issubclass(found, Service)):
        raise ConfigError(f"{program}: not a subclass of mecazen.service.Service")
    return found


def run_service(kind: type[Service], scenario: Scenario, robot: str = "") -> None:
    """Run a service on Zenoh until a signal ends it; with a name, that of one of several robots.

    Raises:
        MecazenError: Its name is taken, the bus can't be opened, or the service failed.
    """
    scenario = part_of(kind.NAME, scenario, robot)
    service: Service | None = None
    name = join_key(kind.NAME, robot)
    log.set_up(name, lambda: service.stamp.time_ns / NS_PER_S if service else 0.0)
    _refuse_taken_name(kind.NAME, scenario.bus)
    bus = ZenohBus(scenario.bus, lossless=scenario.sim.mode == "lockstep", name=kind.NAME)
    stop_on_signals(bus.stop)
    try:
        service = kind(bus, scenario)
        declare_alive(bus, kind.NAME, scenario)
        announce_readiness(bus, kind.NAME, scenario)
        # what is loaded stays: the garbage collector need not look through it in mid-tick
        gc.collect()
        gc.freeze()
        _set_real_time_priority(kind, scenario)
        logger.info("msg=started mode=%s", scenario.sim.mode)
        service.run()
    except StoppedError:
        logger.info("msg=stopped")
    finally:
        if service is not None:
            service.close()
        bus.close()


def part_of(name: str, scenario: Scenario, robot: str) -> Scenario:
    """Return the scenario as the part `name` sees it: whole, or as one of several robots does.

    Raises:
        ConfigError: There is no such robot, or a robot must be named, or none.
    """
    if name in SHARED and robot:
        raise ConfigError(f"--robot {robot}: there is one {name} for all robots")
    if name not in SHARED and scenario.robots and not robot:
        raise ConfigError(f"{name}: of which robot? --robot takes {' or '.join(scenario.names)}")
    return scenario if name in SHARED else scenario.of(robot)


def _set_real_time_priority(kind: type[Service], scenario: Scenario) -> None:
    """Let a service of real time go before what else the machine does, where that is allowed.

    As ros2_control's controller manager does. The parts of a stack then share one core: they
    take turns anyway, and to wake on another takes longer than to wait. Threads that are started
    later do likewise. Faster than real time a service may never rest, and would lock out all
    others.
    """
    if not kind.PRIORITY or scenario.sim.mode == "lockstep" or scenario.sim.speed > 1.0:
        return
    core = _core_of(scenario.bus)
    for path in Path("/proc/self/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):  # a thread may just have ended
            os.sched_setscheduler(int(path.name), os.SCHED_RR, os.sched_param(kind.PRIORITY))
            os.sched_setaffinity(int(path.name), {core})


def _core_of(bus: BusConfig) -> int:
    """Return the core of a stack: of several, each has one by chance, and always the same."""
    cores = sorted(os.sched_getaffinity(0))
    stack = f"{bus.router_endpoints} {bus.namespace}"
    return cores[zlib.crc32(stack.encode()) % len(cores)]


def _refuse_taken_name(name: str, config: BusConfig) -> None:
    """Raise BusError if a service of this name is alive.

    It asks as a client, since only a client's session begins with its link to the router.
    """
    try:
        bus = ZenohBus(config, "client", name=name)
    except BusError:
        return  # no router yet, so nobody is to be met there either
    try:
        if name in bus.alive():
            raise BusError(f"another {name} is already running on this bus")
    finally:
        bus.close()


def run_router(scenario: Scenario) -> None:
    """Run the Zenoh router where processes and tools meet, until a signal ends it."""
    log.set_up("router", lambda: 0.0)
    stopped = _StopFlag()
    stop_on_signals(stopped.set)
    sim = scenario.sim
    # in lockstep nobody keeps time: what is lost there is waited for
    most_hz = SAMPLES_PER_TICK * sim.speed / sim.tick_s if sim.mode == "real_time" else None
    with open_session(scenario.bus, "router", "router", most_hz=most_hz, robots=scenario.names):
        logger.info("msg=started endpoints=%s", ",".join(scenario.bus.router_endpoints or ()))
        stopped.wait()


class _StopFlag:
    """Waits for signals without a poll.

    A signal that comes just before `signal.pause` is not waited for by it; a byte in a pipe
    stays there.
    """

    def __init__(self) -> None:
        self._out, self._in = os.pipe()
        os.set_blocking(self._in, False)
        signal.set_wakeup_fd(self._in)
        self._stopped = False

    def set(self) -> None:
        self._stopped = True

    def wait(self) -> None:
        while not self._stopped:
            os.read(self._out, 1)


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on Ctrl-C, and when the process is told to end."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop())


def declare_alive(bus: Bus, name: str, scenario: Scenario) -> None:
    """Hold a part's token: of one that several robots share, also in the namespace of each."""
    for robot in _namespaces(scenario):
        bus.namespaced(robot).declare_alive(name)


def _namespaces(scenario: Scenario) -> tuple[str, ...]:
    return tuple(dict.fromkeys(("", *scenario.names)))


def announce_readiness(bus: Bus, name: str, scenario: Scenario) -> None:
    """Declare `<name>/ready` once every other service of the scenario is seen alive.

    In real time onlookers are not waited for: they are never needed.

    A service that sees another's token has a link to it, and the other's subscriptions are
    known on it. When all are ready, all links of the loop stand, so no first sample is lost.
    """
    others = set(scenario.services) - {name}
    if scenario.sim.mode == "real_time":
        others -= set(OBSERVERS)
    for robot in _namespaces(scenario):
        # where there are several robots, only what they share is in no one's namespace
        here = others & set(SHARED) if scenario.robots and not robot else others
        _announce_readiness(bus.namespaced(robot), name, here)


def _announce_readiness(bus: Bus, name: str, others: set[str]) -> None:
    def check() -> None:
        if others <= bus.presence.names:
            bus.presence.on_change = lambda: None
            bus.declare_alive(f"{name}/ready")

    bus.presence.on_change = check
    check()


def run_named(
    name: str, scenario: Scenario, robot: str = "", *, until_orphaned: bool = False
) -> None:
    """Run a service, of one of several robots, or the `router`, by name; see `find_service`.

    With `until_orphaned` it also ends when standard input closes, as it does when the
    process that started it dies in whatever way.
    """
    if until_orphaned:
        threading.Thread(target=_end_with_stdin, daemon=True).start()
    if name == "router":
        run_router(scenario)
    else:
        run_service(find_service(name, scenario), scenario, robot)


def _end_with_stdin() -> None:
    # not through sys.stdin, whose lock a thread that waits would hold at the process's exit
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def main(name: str | None = None) -> None:
    """Run a service from the command line: `python -m mecazen_<name> SCENARIO [--set K=V]`."""
    parser = argparse.ArgumentParser(description="Run one mecazen service.")
    if name is None:
        parser.add_argument("service", help="an installed service, router, or file.py:Class")
    parser.add_argument("scenario", help="a scenario's name or its TOML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    parser.add_argument("--robot", default="", metavar="NAME", help="of several, whose service")
    parser.add_argument("--until-orphaned", action="store_true", help="end with standard input")
    options = parser.parse_args()

    def run() -> None:
        scenario = load_scenario(scenario_path(options.scenario), tuple(options.settings))
        part = name or options.service
        run_named(part, scenario, options.robot, until_orphaned=options.until_orphaned)

    exit_with(run)


def exit_with(run: Callable[[], None]) -> None:
    """Run something, and end the process with one line where it fails as it may."""
    try:
        run()
    except MecazenError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
