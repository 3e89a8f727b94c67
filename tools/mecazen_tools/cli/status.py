"""`mecazen status`: the state of all services on one screen, from their diagnostics."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated

import msgspec
import typer
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import BusError
from mecazen.graph import SHARED, WORLDS
from mecazen.loading import robots_in, tables_in
from mecazen.messages import DiagnosticArray, Empty, SimState
from mecazen.robots import join_key
from mecazen.runtime.observer import PUBLISHERS
from mecazen.text import printable
from mecazen.wire import NS_PER_S, RefusedError, decode
from rich.console import Group
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text
from typer import Option

from mecazen_tools.cli.options import console, receive, scenario_at, tool_bus
from mecazen_tools.publishers import Programs

REFRESH_S = 0.5
UNREAD_S = 5.0
"""Time between looks for commands that no service reads, and for which one is remembered [s]."""
ANSWER_S = 0.5
"""Timeout of a query to the clock; a physics that is gone does not answer [s]."""
SCREEN_WIDTH = 120
"""Width of the output outside a terminal [characters]."""
PATIENCE_S = 3.0
"""Timeout for a report of every service, in output that is shown once [s]. A service reports every
simulated second."""
LATE_S = 0.25
"""Time by which a report may be late before its service is stale [s]."""

HZ, AGE, WARNING = "hz/", "age_s/", "warning/"
"""Beginnings of the names of values: of an input's rate and age, and of warnings."""
WARNINGS = 20
"""Maximum number of warnings shown."""

Report = Mapping[str, str]
"""The values that a service reports, by name."""


class InputStatus(msgspec.Struct, frozen=True):
    """Statistics of the samples that a service receives on one key."""

    hz: float
    """Samples per simulated second."""
    age_s: float | None
    """Simulated time since the newest sample; None if there is none in this run."""


class ServiceStatus(msgspec.Struct, frozen=True):
    """The state of one service."""

    state: str
    """`gone`, `alive` while it waits for the others, `ready`, or `stale` if it does not report."""
    inputs: dict[str, InputStatus] = {}
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
    followed: dict[str, str] = {}
    """How each robot with a follower follows, by its name; empty for a single robot."""
    drives: dict[str, str] = {}
    """The driver of each robot, by its name."""
    warnings: tuple[str, ...] = ()
    """Warnings of services."""


class Diagnostics:
    """The newest report of each service, by the name in its key, which access control guards."""

    def __init__(self, bus: ZenohBus, *, closely: bool = False) -> None:
        """Subscribe; `closely` to commands with any prefix too, at a cost if there is a guard."""
        self._bus = bus
        self.reports: dict[str, Report] = {}
        self.time_s = 0.0
        """Simulated time of the newest report [s]."""
        self._begin_s = time.monotonic()
        self._arrived_s: dict[str, float] = {}
        self._parts: Sequence[str] = ()
        """The services of the scenario, once its clock answers `status`."""
        self._network, self._asked_s = Programs(), -math.inf
        """The programs at the router, and the time of its answer [s]."""
        self._strangers: set[str] = set()
        """Programs and keys for which the router has been asked."""
        self._heard: dict[str, float] = {}
        """Time of the newest command on a key with a prefix [s], whether it is read or not."""
        bus.subscribe_bytes(f"**/{keys.diagnostics('*').key}", self._take)
        command = keys.CMD_VEL.key
        strange = [f"rt/**/{command}", *([command] if bus.prefix else [])]
        for expression in [*strange, *([f"{bus.prefix}*/**/{command}"] if closely else [])]:
            bus.subscribe_bytes(expression, self._hear, outside=True)

    def age_s(self, service: str) -> float:
        """Return the wall time since a service's newest report, or without one since the start."""
        return time.monotonic() - self._arrived_s.get(service, self._begin_s)

    def status(self) -> Status:
        """Return the present state of all services."""
        alive = self._bus.alive()
        sim = None
        if alive.intersection(WORLDS):
            with suppress(BusError):  # physics is starting, gone or frozen
                sim = self._bus.call(keys.SIM_STATE, Empty(), ANSWER_S)
        if sim is not None and not self._parts:
            scenario = scenario_at(self._bus)
            self._parts = [
                join_key(part, robot)
                for part in tables_in(scenario).get("services", ())
                for robot in (("",) if part in SHARED else robots_in(scenario))
            ]
        self._bus.drain()
        names = {name for name in (*alive, *self.reports) if not name.endswith("/ready")}
        services = {
            name: self._service(name, alive, _stale_s(sim))
            for name in dict.fromkeys((*self._parts, *sorted(names)))
        }
        owners = (name.rpartition("/")[0] for name in services if name.endswith("follower"))
        followed = {robot: text for robot in owners if (text := self.followed(robot))}
        warnings = [
            f"{service}: {name.removeprefix(WARNING)} {text}"
            for service, report in self.reports.items()
            for name, text in report.items()
            if name.startswith(WARNING)
        ][:WARNINGS]
        return Status(sim, services, followed, self.drives(), (*self.contests(), *warnings))

    def followed(self, robot: str) -> str:
        """Return tracking state, reason and distance error as text; empty if not reported.

        The error is the true one, or without the truth that of the follower's estimate.
        """
        report = self.reports.get(join_key("follower", robot), {})
        target = self.reports.get(join_key("target", robot), {})
        text = ": ".join(filter(None, (report.get("tracking"), report.get("reason"))))
        for error_m, kind in (
            (number(target, "true_distance_error_m"), "true"),
            (number(report, "distance_error_m"), "estimated"),
        ):
            if text and error_m is not None:
                return printable(f"{text}, {error_m:+.3f} m off ({kind})")
        return printable(text)

    def programs(self) -> dict[str, list[str]]:
        """Return the names of the programs that have just published, by open key."""
        senders: defaultdict[str, set[str]] = defaultdict(set)
        for report in self.reports.values():
            for name, ids in report.items():
                if name.startswith(PUBLISHERS):
                    senders[name.removeprefix(PUBLISHERS)].update(ids.split())
        strangers = {*self._heard, *(program for ids in senders.values() for program in ids)}
        is_due = time.monotonic() - self._asked_s > UNREAD_S
        if strangers and (is_due or not strangers <= self._strangers):
            self._asked_s, self._strangers = time.monotonic(), strangers
            with suppress(BusError):  # the router is starting or gone
                self._network = Programs(self._bus)
        return {key: self._network.on(key, ids) for key, ids in senders.items()}

    def contests(self) -> tuple[str, ...]:
        """Return warnings about keys that several programs publish on, or that no service reads."""
        programs, now_s = self.programs().items(), time.monotonic()
        contests = [
            f"{key}: {len(names)} programs publish, and the robot obeys each: {' and '.join(names)}"
            for key, names in programs
            if len(names) > 1
        ]
        self._heard = {k: at_s for k, at_s in self._heard.items() if now_s - at_s < UNREAD_S}
        return (*contests, *self._network.in_vain(self._heard))[:WARNINGS]

    def drives(self) -> dict[str, str]:
        """Return who drives each robot, by its name; empty for a robot at rest."""
        programs, drives = self.programs(), {}
        for service in ("controller", "guard"):  # a guard chooses in place of the controller
            for name, report in self.reports.items():
                robot, _, part = name.rpartition("/")
                if part == service and (source := report.get("drives")) is not None:
                    names = programs.get(join_key(source, robot), [])
                    drives[robot] = f"{source} ({names[0]})" if len(names) == 1 else source
        return drives

    def is_complete(self, status: Status) -> bool:
        """Return whether each service of the scenario that is alive has reported."""
        alive = [part for part in self._parts if status.services[part].state != "gone"]
        return self.reports.keys() >= set(alive)

    def _hear(self, key: str, *_: object) -> None:
        if len(self._heard) < WARNINGS:
            self._heard[key] = time.monotonic()

    def _take(self, key: str, payload: bytes, encoding: str, _: bytes | None) -> None:
        try:
            array = decode(payload, DiagnosticArray, encoding)
        except RefusedError as refusal:
            self._bus.refuse(key, str(refusal))
            return
        service = key.replace(keys.diagnostics("").key, "")  # with the robot's name before it
        self.reports[service] = {
            pair.key: pair.value for status in array.status for pair in status.values
        }
        self._arrived_s[service] = time.monotonic()
        self.time_s = array.header.stamp.ns / NS_PER_S

    def _service(self, name: str, alive: set[str], stale_s: float) -> ServiceStatus:
        report = self.reports.get(name, {})
        age_s = self.age_s(name) if name in self._parts else None
        state = "gone" if name not in alive else "ready" if f"{name}/ready" in alive else "alive"
        if state == "ready" and age_s is not None and age_s > stale_s:
            state = "stale"
        inputs = [key.removeprefix(HZ) for key in report if key.startswith(HZ)]
        restarts = (number(seen, f"restarts/{name}") or 0 for seen in self.reports.values())
        missed = (number(report, key) or 0 for key in ("missed_deadlines", "missed_ticks"))
        return ServiceStatus(
            state,
            inputs={
                key: InputStatus(number(report, HZ + key) or 0.0, number(report, AGE + key))
                for key in inputs
            },
            refused=int(number(report, "refused_payloads") or 0),
            missed=int(sum(missed)),
            restarts=int(max(restarts, default=0)),
            age_s=age_s,
        )


def number(report: Report, name: str) -> float | None:
    """Return a value, or None if it is not a number, as for an input that never came."""
    try:
        value = float(report[name])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _stale_s(sim: SimState | None) -> float:
    """Return the wall time without a report after which a service is stale [s].

    Services report every simulated second.
    """
    if sim is None:
        return 1.0 + LATE_S
    if sim.paused or sim.mode == "lockstep":
        return math.inf  # simulated time may stand still
    return 1.0 / (min(sim.speed, sim.rtf) or sim.speed) + LATE_S


def screen(status: Status) -> Group:
    """Return a status as a table with a headline."""
    hears = Column("hears [Hz]", overflow="fold")  # else a narrow terminal cuts keys off
    table = Table("service", "state", hears, r"oldest \[s]", "refused", "missed", "restarts")
    for name, service in status.services.items():
        inputs = "  ".join(f"{key} {statistics.hz:g}" for key, statistics in service.inputs.items())
        ages_s = [i.age_s for i in service.inputs.values() if i.age_s is not None]
        colour = {"ready": "green", "alive": "yellow"}.get(service.state, "red")
        state = service.state
        if state == "stale" and service.age_s is not None:
            state += f" for {service.age_s:.1f} s"
        counts = (service.refused, service.missed, service.restarts)
        table.add_row(
            Text(printable(name)),
            Text(state, colour),
            Text(printable(inputs)),
            f"{max(ages_s):.2f}" if ages_s else "",
            *(Text(str(count), "yellow" if count else "") for count in counts),
        )
    warnings = [Text(f"warning: {printable(text)}", "yellow") for text in status.warnings]
    followed = [
        Text(f"{printable(name) or 'robot'}: {text}") for name, text in status.followed.items()
    ]
    return Group(Text(_headline(status), "bold"), *followed, table, *warnings)


def _headline(status: Status) -> str:
    sim = status.sim
    if sim is None:
        worlds = status.services.keys() & WORLDS
        silent = [name for name in worlds if status.services[name].state != "gone"]
        return f"{silent[0]} does not answer" if silent else "nobody simulates"
    pace = "paused" if sim.paused else f"{sim.rtf:.2f} × real time"
    if sim.mode == "real_time":
        pace += f" (speed {sim.speed:g})"
    mode = sim.mode.replace("_", " ")
    time_s = sim.clock.ns / NS_PER_S
    drives = [f"{robot} driven by {name}".strip() for robot, name in status.drives.items() if name]
    parts = (f"t = {time_s:.1f} s", pace, mode, f"seed {sim.seed}", *drives)
    return printable("  ·  ".join(parts))


def status(
    context: typer.Context,
    as_json: Annotated[bool, Option("--json", help="Print one JSON object, and end.")] = False,
) -> None:
    """Show state, inputs and problems of all services, until Ctrl-C.

    Rates and ages are in simulated time. A pipe or a file gets the state once.

    Examples: mecazen status · mecazen status --json
    """
    out = console(SCREEN_WIDTH)
    with tool_bus(context) as bus:
        diagnostics = Diagnostics(bus, closely=True)
        newest = diagnostics.status()
        if not newest.services:
            where = (context.obj.connect or ("the router",))[0]
            raise BusError(f"no service is alive at {where}: is `mecazen up` running?")
        if out.is_terminal and not as_json:
            with Live(screen(newest), console=out, auto_refresh=False) as live:
                while True:
                    receive(bus, REFRESH_S)
                    live.update(screen(diagnostics.status()), refresh=True)
        end_s = time.monotonic() + PATIENCE_S
        while not diagnostics.is_complete(newest) and time.monotonic() < end_s:
            receive(bus, REFRESH_S)
            newest = diagnostics.status()
        if as_json:
            typer.echo(printable(msgspec.json.encode(newest).decode()))
        else:
            out.print(screen(newest))
