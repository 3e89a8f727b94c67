"""`mecazen status`: the state of all services on one screen."""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Iterable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Annotated, Any

import msgspec
import typer
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import BusError
from mecazen.graph import SHARED, WORLDS
from mecazen.messages import DiagnosticArray, Empty, SimState
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import NS_PER_S, RefusedError, decode
from rich.console import Group
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text

from mecazen_tools.cli.options import Connect, Namespace, Tls, console, fitting, tool_bus
from mecazen_tools.strays import report_strays

REFRESH_S = 0.5
ANSWER_S = 0.5
"""Timeout of queries to the clock; a physics that is gone does not answer [s]."""
SCREEN_WIDTH = 120
"""Width of the output outside a terminal [characters]."""
PATIENCE_S = 3.0
"""Timeout for a report of every service, in output that is shown once [s]. A service reports every
simulated second."""

LATE_S = 0.25
"""Time by which a report may be late before its service is stale [s]."""

REPORTS = 1000
"""Maximum number of services whose reports are kept; any client can invent names."""

IGNORED, WARNING = "ignored/", "warning/"
"""Beginnings of the names of values that are warnings."""
WARNINGS = 20
"""Maximum number of warnings shown."""


class Input(msgspec.Struct, frozen=True):
    """Statistics of the samples that a service receives on one key."""

    hz: float
    """Samples per simulated second."""
    age_s: float | None
    """Simulated time since the newest sample; None if there is none in this run."""


class ServiceStatus(msgspec.Struct, frozen=True):
    """The state of one service."""

    state: str
    """`gone`, `alive` while it waits for the others, `ready`, or `stale` if it does not report."""
    inputs: dict[str, Input] = {}
    refused: int = 0
    """Number of payloads whose type does not match their key."""
    missed: int = 0
    """Number of missed deadlines of physics; of other services, ticks that they did not receive."""
    restarts: int = 0
    """Number of times it has gone and come back, as reported by other services."""
    age_s: float | None = None
    """Wall time since the newest report of a service of the scenario."""


class Status(msgspec.Struct, frozen=True):
    """The output of `mecazen status --json`."""

    sim: SimState | None
    """None if no simulation runs."""
    services: dict[str, ServiceStatus]
    warnings: tuple[str, ...] = ()
    """Warnings of services, and samples without effect: an unknown field, or a key that resembles
    another one."""


Reports = dict[str, dict[str, str]]
"""The newest report of each service, by name."""


class Diagnostics:
    """The newest report of each service, by the name in its key, which access control guards."""

    def __init__(self, bus: ZenohBus, *robots: str) -> None:
        self._bus = bus
        self.reports: Reports = {}
        self.time_s = 0.0
        """Simulated time of the newest report [s]."""
        self._begin_s = time.monotonic()
        self._arrived_s: dict[str, float] = {}
        for robot in dict.fromkeys(robots):
            self.subscribe(robot)

    def subscribe(self, robot: str) -> None:
        """Subscribe to the reports of a robot's services; without a name, of shared ones."""
        key = join_key(keys.diagnostics("*").key, robot)
        self._bus.subscribe_bytes(key, partial(self._take, robot))

    def age_s(self, service: str) -> float:
        """Return the wall time since a service's newest report, or without one since the start."""
        return time.monotonic() - self._arrived_s.get(service, self._begin_s)

    def _take(
        self, robot: str, key: str, payload: bytes, encoding: str, attachment: bytes | None
    ) -> None:
        del attachment
        try:
            report = decode(payload, DiagnosticArray, encoding)
        except RefusedError as refusal:
            self._bus.refuse(key, str(refusal))
            return
        name = join_key(key.removeprefix(join_key(keys.diagnostics("").key, robot)), robot)
        if name in self.reports or len(self.reports) < REPORTS:
            self.reports[name] = {
                pair.key: pair.value for status in report.status for pair in status.values
            }
            self._arrived_s[name] = time.monotonic()
            self.time_s = report.header.stamp.ns / NS_PER_S


def status_of(
    sim: SimState | None,
    parts: Iterable[str],
    alive: set[str],
    reports: Reports,
    strays: Iterable[str] = (),
    ages_s: Mapping[str, float] = MappingProxyType({}),
) -> Status:
    """Return the state of the expected services `parts`, and of all others.

    `alive` are liveliness tokens; a token `<name>/ready` marks readiness. `strays` are warnings
    about samples on keys that no service takes. `ages_s` are those of reports, by service.
    """
    stale_s = _stale_s(sim)
    here = {name for name in alive if not name.endswith("/ready")}
    names = [*parts, *sorted(here | reports.keys())]
    ignored = (
        f"{name.removeprefix(IGNORED)}: {told}"
        for said in reports.values()
        for name, told in said.items()
        if name.startswith(IGNORED)
    )
    warned = (
        f"{service}: {name.removeprefix(WARNING)} {told}"
        for service, said in reports.items()
        for name, told in said.items()
        if name.startswith(WARNING)
    )
    return Status(
        sim,
        {
            name: _service(name, alive, reports, ages_s.get(name), stale_s)
            for name in dict.fromkeys(names)
        },
        tuple(dict.fromkeys((*warned, *strays, *ignored)))[
            :WARNINGS
        ],  # several services receive one key
    )


def _stale_s(sim: SimState | None) -> float:
    """Return the wall time without a report after which a service is stale [s].

    Services report every simulated second.
    """
    if sim is None:
        return 1.0 + LATE_S
    if sim.paused or sim.mode == "lockstep":
        return math.inf  # simulated time may stand still
    return 1.0 / (min(sim.speed, sim.rtf) or sim.speed) + LATE_S


def _service(
    name: str, alive: set[str], reports: Reports, age_s: float | None, stale_s: float
) -> ServiceStatus:
    said = reports.get(name, {})
    state = "gone" if name not in alive else "ready" if f"{name}/ready" in alive else "alive"
    if state == "ready" and age_s is not None and age_s > stale_s:
        state = "stale"
    return ServiceStatus(
        state,
        inputs={
            name.removeprefix("hz/"): Input(
                number(said, name) or 0.0, number(said, name.replace("hz/", "age_s/", 1))
            )
            for name in said
            if name.startswith("hz/")
        },
        refused=_count(said, "refused_payloads"),
        missed=_count(said, "missed_deadlines") + _count(said, "missed_ticks"),
        restarts=max((_count(of, f"restarts/{name}") for of in reports.values()), default=0),
        age_s=age_s,
    )


def number(said: Mapping[str, str], name: str) -> float | None:
    """Return a value, or None if it is not a number, as for an input that never came."""
    try:
        number = float(said[name])
    except (KeyError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _count(said: dict[str, str], name: str) -> int:
    return int(number(said, name) or 0)


def screen(status: Status, width: int = SCREEN_WIDTH) -> Group:
    """Return a status as a table with a headline, for a terminal of a width [characters]."""
    hears = Column("hears [Hz]", overflow="fold")  # else a narrow terminal cuts keys off
    table = Table("service", "state", hears, r"oldest \[s]", "refused", "missed", "restarts")
    for name, service in status.services.items():
        inputs = "  ".join(f"{key} {heard.hz:g}" for key, heard in service.inputs.items())
        ages = [heard.age_s for heard in service.inputs.values() if heard.age_s is not None]
        numbers = (service.refused, service.missed, service.restarts)
        colour = {"ready": "green", "alive": "yellow"}.get(service.state, "red")
        state = service.state
        if state == "stale" and service.age_s is not None:
            state += f" for {service.age_s:.1f} s"
        table.add_row(
            Text(printable(name)),
            Text(state, colour),
            Text(printable(inputs)),
            f"{max(ages):.2f}" if ages else "",
            *(Text(str(number), "yellow" if number else "") for number in numbers),
        )
    warnings = [Text(f"warning: {printable(told)}", "yellow") for told in status.warnings]
    return Group(Text(_headline(status), "bold"), fitting(table, width), *warnings)


def _headline(status: Status) -> str:
    sim = status.sim
    if sim is None:
        here = (name for name in WORLDS if name in status.services)
        silent = [name for name in here if status.services[name].state != "gone"]
        return f"{silent[0]} does not answer" if silent else "nobody simulates"
    pace = "paused" if sim.paused else f"{sim.rtf:.2f} × real time"
    if sim.mode == "real_time":
        pace += f" (speed {sim.speed:g})"
    mode = sim.mode.replace("_", " ")
    time_s = sim.clock.ns / 1e9
    return printable(f"t = {time_s:.1f} s  ·  {pace}  ·  {mode}  ·  seed {sim.seed}")


class _Listener:
    """Queries and collects the state of all services."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self._parts: tuple[str, ...] = ()
        self._robots: tuple[str, ...] = ()
        self._alive: set[str] = set()
        self.diagnostics = Diagnostics(bus, "")
        self._strays: list[str] = []

    def listen(self, duration_s: float) -> None:
        """Receive reports for a duration [s]."""
        end = time.monotonic() + duration_s
        while (left_s := end - time.monotonic()) > 0:
            self._bus.spin_once(left_s)

    @property
    def awaited(self) -> set[str]:
        """Services of the scenario that are alive but have not reported yet."""
        return (set(self._parts) & self._alive) - self.diagnostics.reports.keys()

    def status(self) -> Status:
        """Return the present state of all services."""
        self._alive = self._bus.alive()
        sim = None
        if self._alive.intersection(WORLDS):
            try:
                sim = self._bus.call(keys.SIM_STATE, Empty(), ANSWER_S)
                if not self._parts:
                    toml = self._bus.call(keys.SIM_SCENARIO, Empty(), ANSWER_S).data
                    self._take_part(tomllib.loads(toml))
                    return self.status()
            except BusError:
                pass  # physics is starting, gone or frozen
        self._bus.drain()
        reports = self.diagnostics.reports
        ages_s = {part: self.diagnostics.age_s(part) for part in self._parts}
        return status_of(sim, self._parts, self._alive, reports, self._strays, ages_s)

    def _take_part(self, scenario: dict[str, Any]) -> None:
        """Read robots and services from a scenario's tables."""
        self._robots = tuple(robot["name"] for robot in scenario["robots"])
        self._parts = tuple(
            join_key(part, robot)
            for part in scenario["services"]
            for robot in (("",) if part in SHARED else self._robots or ("",))
        )
        for robot in self._robots:
            self.diagnostics.subscribe(robot)
        given = {keys.CMD_VEL.key} if "follower" in scenario["services"] else ()
        report_strays(self._bus, self._robots or ("",), given, self._strays.append)


def status(
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object, and end.")
    ] = False,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Show how all services are, until Ctrl-C: who is alive, what each hears, what went wrong.

    Rates and ages are in simulated time. Into a pipe or a file it is shown once.

    Examples: mecazen status · mecazen status --json
    """
    out = console(SCREEN_WIDTH)
    with tool_bus(connect, namespace, tls) as bus:
        listener = _Listener(bus)
        now = listener.status()
        if not now.services:
            where = connect or "the router"
            raise BusError(f"no service is alive at {where}: is `mecazen up` running?")
        if as_json or not out.is_terminal:
            end = time.monotonic() + PATIENCE_S
            while listener.awaited and time.monotonic() < end:
                bus.spin_once(PATIENCE_S / 10)
            now = listener.status()
            if as_json:
                typer.echo(printable(msgspec.json.encode(now).decode()))
            else:
                out.print(screen(now, out.width))
            return
        with Live(screen(now, out.width), console=out, auto_refresh=False) as live:
            while True:
                listener.listen(REFRESH_S)
                live.update(screen(listener.status(), out.width), refresh=True)
