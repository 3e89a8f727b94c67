"""`mecazen up`: all processes of a scenario, and what they do, in one terminal."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections.abc import Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Literal

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import ROUTER, SECURE_ROUTER, Process, Scenario, join_key
from mecazen.errors import ConfigError
from mecazen.graph import OBSERVERS, Row, services
from mecazen.loading import load_scenario
from mecazen.messages import DiagnosticArray
from mecazen.programs import classes, installed_nodes
from mecazen.wire import NS_PER_S, Stamp
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from mecazen_tools.processes import Supervisor

REFRESH_S = 0.25
QUIET_REPORT_S = 5.0
"""Simulated time between two lines of status where the output is no terminal."""
REPORTING = {"physics", "target", "follower"}
"""Parts of whose health the status tells."""

VIEWER = "viewer"
Viewer = Literal["web", "native"]


def run_up(
    path: Path, settings: tuple[str, ...], viewer: Viewer | None, *, restart: bool, together: bool
) -> None:
    """Run a scenario until Ctrl-C or until one of its processes fails.

    With `restart` a process that fails is started again instead. All services but the
    observers are `together` in one process, or in those of the scenario. The viewer, where it is
    installed, is started beside them; observers may fail in any case.

    Raises:
        MecazenError: What is wrong with the scenario, or the error of the process that failed.
    """
    shown = viewer is not None and VIEWER in installed_nodes()
    if viewer == "native":
        if not shown:
            raise ConfigError("--viewer native: the viewer is not installed")
        settings = (*settings, "viewer.native=true")
    scenario = load_scenario(path, settings)
    if together:
        group = [part for part in scenario.services if part not in OBSERVERS]
        settings = (*settings, f"processes={json.dumps([group])}")
        scenario = load_scenario(path, settings)
    for part in scenario.services:
        classes(part, scenario)
    console = Console()
    supervisor = Supervisor(path, settings, restart=restart)
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGHUP, _interrupt)
    try:
        console.print(f"[bold]mecazen[/] starts scenario [bold]{path.stem}[/] ({path})")
        supervisor.start_router()
        with closing(ZenohBus(scenario.bus, "client")) as bus:
            status = Status(bus, scenario)
            for process in scenario.process_plan:
                supervisor.start(process, needed=process.services[0] not in OBSERVERS)
            if shown and VIEWER not in scenario.services:
                supervisor.start(Process((VIEWER,)), needed=False)
            _introduce(console, scenario, supervisor, path)
            _watch(console, supervisor, bus, status)
    except KeyboardInterrupt:
        console.print("stopping …")
    finally:
        killed = supervisor.stop()
        for name in killed:
            console.print(f"{name} did not end in time and was killed")
    console.print("all processes have ended")


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _watch(console: Console, supervisor: Supervisor, bus: ZenohBus, status: Status) -> None:
    with Live(status.text, console=console, auto_refresh=False, transient=True) as live:
        while True:
            line = supervisor.poll(REFRESH_S)
            while line is not None:
                if line.is_address:
                    text = f"Watch it at [bold]{escape(line.text)}[/]"
                    console.print(text, highlight=False, soft_wrap=True)
                else:
                    console.print(line.text, markup=False, highlight=False, soft_wrap=True)
                line = supervisor.poll(0.0)
            bus.drain()
            if console.is_terminal:
                live.update(status.text, refresh=True)
            elif status.due():
                console.print(status.text, soft_wrap=True)


class Status:
    """What the simulation does, from its services' health: a line, or one for each robot.

    What they say of themselves once a second is enough for it: each sample of the loop on its way
    here, through the router, costs its publisher as much as one to another service.
    """

    def __init__(self, bus: ZenohBus, scenario: Scenario) -> None:
        self._time_s = 0.0
        self._reported_s = -QUIET_REPORT_S
        self._robots = scenario.names
        self._health: dict[str, Mapping[str, str]] = {}
        for part, robot in scenario.parts:
            if part in REPORTING:
                hear = partial(self._on_report, join_key(part, robot))
                bus.namespaced(robot).subscribe(keys.diagnostics(part), hear)

    @property
    def text(self) -> str:
        """The lines."""
        physics = self._health.get("physics", {})
        first, *others = [self._of(robot) for robot in self._robots]
        if physics:
            missed = physics.get("missed_deadlines", "?")
            first.append(f"{physics.get('rtf', '?')} × real time, {missed} missed")
        lines = "\n".join("  ·  ".join(words) for words in (first, *others))
        return f"[bold]t = {self._time_s:.1f} s[/]  {escape(lines)}"

    def due(self) -> bool:
        """Return whether enough simulated time has passed for another report."""
        if abs(self._time_s - self._reported_s) < QUIET_REPORT_S:
            return False
        self._reported_s = self._time_s
        return True

    def _of(self, robot: str) -> list[str]:
        """Return what a robot, its person and its follower do."""
        physics, person, follower = (
            self._health.get(part, {})
            for part in ("physics", join_key("target", robot), join_key("follower", robot))
        )
        x, y = (_number(physics, join_key(name, robot)) for name in ("x_m", "y_m"))
        person_x, person_y = _number(person, "x_m"), _number(person, "y_m")
        error = _number(follower, "distance_error_m")
        said = []
        if x is not None and y is not None:
            said.append(f"{robot or 'robot'} ({x:+.2f}, {y:+.2f})")
        if person_x is not None and person_y is not None:
            said.append(f"person ({person_x:+.2f}, {person_y:+.2f})")
        if error is not None:
            said.append(f"{follower.get('tracking', '?')}, {error:+.3f} m off")
        return said

    def _on_report(self, part: str, report: DiagnosticArray, stamp: Stamp | None) -> None:
        if stamp is not None:
            self._time_s = stamp.time_ns / NS_PER_S
        self._health[part] = {
            pair.key: pair.value for status in report.status for pair in status.values
        }


def _number(values: Mapping[str, str], name: str) -> float | None:
    """Return a value that is a number, as whoever reports need not make it."""
    try:
        return float(values[name])
    except (KeyError, ValueError):
        return None


def _work(process: str, scenario: Scenario) -> str:
    """Return what a process does, by the nodes of its services."""
    if process == "router":
        return "connects processes and tools"
    table = services()
    rows = [row for part in process.split("+") for row in table.get(part) or (Row(part),)]
    if "+" in process:
        return ", ".join(row.name for row in rows)
    return "; ".join(scenario.programs.get(row.name, row.summary) for row in rows)


def _introduce(console: Console, scenario: Scenario, supervisor: Supervisor, path: Path) -> None:
    table = Table("process", "pid", "what it does", title="running", title_justify="left")
    for name, pid in supervisor.pids.items():
        table.add_row(name, str(pid), _work(name.rpartition("/")[2], scenario))
    console.print(table)
    folder = scenario.bus.keys
    endpoint = (scenario.bus.router_endpoints or (SECURE_ROUTER if folder else ROUTER,))[0]
    tls = f" --tls {os.path.relpath(folder)}" if folder else ""
    console.print(f"Tools attach at [bold]{endpoint}[/]. In another terminal:")
    drive = '{"linear":{"x":0.3}}'
    odom, cmd_vel, walk = (
        join_key(topic.key, scenario.names[0])
        for topic in (keys.ODOM, keys.CMD_VEL, keys.TARGET_CMD_VEL)
    )
    lines = [
        f"mecazen echo {odom}{tls}",
        f"mecazen sim pause|resume|reset{tls}",
        f"mecazen topics --live{tls}",
    ]
    if "follower" in scenario.services:
        lines.append("mecazen up teleop   # instead of this: you drive the robot")
    else:
        lines.insert(0, f"mecazen pub {cmd_vel} '{drive}' --rate 20{tls}   # drives the robot")
        if not tls:
            zenoh = f"zenoh --mode client --connect {endpoint}"
            lines.insert(1, f"{zenoh} put -k {cmd_vel} -v '{drive}'")
    if hasattr(getattr(scenario.sections.get("target"), "path", None), "timeout_s"):
        lines.insert(0, f"mecazen pub {walk} '{drive}' --rate 20{tls}   # walks the person")
    else:
        driven = "--set target.path=\"{kind='driven'}\""
        lines.append(f"mecazen up {path.stem} {driven}   # instead: you walk the person")
    if shutil.which("mecazen") is None:
        activate = Path(sys.prefix) / "bin" / "activate"
        lines.insert(0, f". {os.path.relpath(activate)}   # once")
    for line in lines:
        console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)
    console.print("Ctrl-C ends all of it.")
