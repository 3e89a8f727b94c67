"""`mecazen up`: all processes of a scenario, and their state, in one terminal."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from mecazen import keys
from mecazen.bus.ports import free_port, is_free
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, Process, Scenario
from mecazen.config.bus import ROUTER, SECURE_ROUTER
from mecazen.config.people import Driven
from mecazen.config.services import ViewerConfig
from mecazen.errors import BusError, ConfigError
from mecazen.extras import is_installed
from mecazen.files import to_value
from mecazen.graph import OBSERVERS, WORLDS, rows, services
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.programs import graph_of, refuse_missing
from mecazen.robots import join_key
from mecazen.row import Row
from mecazen.runtime.process import refuse_missing_ros
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from mecazen_tools.cli.options import ScenarioArgument, Settings
from mecazen_tools.cli.status import LATE_S, WARNING, Diagnostics, number
from mecazen_tools.forking import STOPPING
from mecazen_tools.processes import Line, Supervisor
from mecazen_tools.strays import report_strays

REFRESH_S = 0.25
QUIET_REPORT_S = 5.0
"""Simulated time between two lines of status if the output is not a terminal [s]."""

VIEWER = "viewer"
VIEWER_START_S = 5.0
"""Longest wait for the viewer's address before the rest is printed [s]."""


def up(
    scenario: ScenarioArgument,
    viewer: Annotated[
        Literal["web", "native"],
        typer.Option(help="Where it is shown: a page for the browser, or Rerun's own window too."),
    ] = "web",
    no_viewer: Annotated[
        bool, typer.Option("--no-viewer", help="Show it nowhere; a viewer takes processor time.")
    ] = False,
    restart: Annotated[
        bool, typer.Option("--restart", help="Start a process again that fails or is killed.")
    ] = False,
    processes: Annotated[
        int | None,
        typer.Option(
            min=1, max=1, help="1: all services in one process.", show_default="the scenario's"
        ),
    ] = None,
    ros2: Annotated[
        bool, typer.Option("--ros2", help="The services are ROS 2 nodes as well, for rmw_zenoh.")
    ] = False,
    settings: Settings = None,
) -> None:
    """Start a scenario's services as processes, in real time, until Ctrl-C.

    A router for them and for tools listens on tcp/127.0.0.1:7447, or on a free port if another
    run has that one. If a process fails, its error is shown and all processes end. With --restart
    it is started again. The other processes continue without the viewer or the recorder.

    Examples: mecazen up back · mecazen up side --set sim.speed=2 · mecazen up teleop --no-viewer
    """
    path, overrides = scenario_path(scenario), tuple(settings or ())
    shown = not no_viewer and is_installed(VIEWER)
    if viewer == "native" and not no_viewer:
        if not shown:
            raise ConfigError("--viewer native: pip install 'mecazen[viewer]'")
        overrides = (*overrides, "viewer.native=true")
    if ros2:
        overrides = (*overrides, "bus.ros2=true")
    loaded = load_scenario(path, parse_settings(overrides))
    if processes == 1:
        group = [part for part in loaded.services if part not in OBSERVERS]
        overrides = (*overrides, f"processes={to_value([group])}")
    shares_router = _shares_router(loaded.bus)
    moved = _moved_ports(loaded, shares_router=shares_router)
    overrides = (*overrides, *moved)
    loaded = load_scenario(path, parse_settings(overrides))
    for part in loaded.services:
        refuse_missing(part, loaded)
    refuse_missing_ros(loaded.bus)
    console = Console()
    supervisor = Supervisor(path, overrides, loaded, restart=restart)
    interrupts = Interrupts()
    try:
        name, where = escape(path.stem), escape(str(path))
        ports = "; the usual ports are taken, so it takes free ones" if moved else ""
        begin = f"[bold]mecazen[/] starts scenario [bold]{name}[/] ({where}){ports}"
        console.print(begin, soft_wrap=True)
        if not shares_router:
            supervisor.start_router()
        with closing(ZenohBus(loaded.bus, "client", renamed=loaded.renamed)) as bus:
            overview = Overview(bus, loaded)
            graph = graph_of(loaded)
            given = [topic.key for topic in keys.TOPICS if graph.giver(topic.key) is not None]
            report_strays(bus, loaded.names, given, partial(_warn, console))
            for process in loaded.process_plan:
                supervisor.start(process, needed=process.services[0] not in OBSERVERS)
            if shown and VIEWER not in loaded.services:
                supervisor.start(Process((VIEWER,)), needed=False)
            if shown:
                _await_viewer(console, supervisor)
            _introduce(console, loaded, scenario, supervisor.pids)
            _watch(console, supervisor, bus, overview, interrupts)
    except KeyboardInterrupt:
        console.print("stopping …")
    finally:
        killed = supervisor.stop()
        for name in killed:
            console.print(f"{name} did not end in time and was killed")
    console.print("all processes have ended")


def _shares_router(bus: BusConfig) -> bool:
    """Return whether a router of another run exists, which this namespace can share."""
    if bus.namespace is None:
        return False
    try:
        ZenohBus(bus, "client").close()
    except BusError:
        return False
    return True


def _moved_ports(scenario: Scenario, *, shares_router: bool) -> list[str]:
    """Return settings with a free port in place of each default port that is taken."""
    moved = []
    endpoints = scenario.bus.router_endpoints
    if endpoints in {(ROUTER,), (SECURE_ROUTER,)} and not shares_router:
        begin, _, port = endpoints[0].rpartition(":")
        if not is_free(int(port)):
            moved.append(f'bus.connect=["{begin}:{free_port()}"]')
    default = ViewerConfig()
    for name in ("web_port", "data_port"):
        port = getattr(default, name)
        if getattr(scenario.viewer, name) == port and not is_free(port):
            moved.append(f"viewer.{name}=0")
    return moved


class Interrupts:
    """Raises KeyboardInterrupt at each signal that asks this process to end; stores the signal.

    Python drops an exception that is raised in a destructor or a callback. `check` raises the
    KeyboardInterrupt of such a Ctrl-C again.
    """

    def __init__(self) -> None:
        self._has_come = False
        for asks_to_end in STOPPING:
            signal.signal(asks_to_end, self._interrupt)

    def _interrupt(self, *_: object) -> None:
        self._has_come = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self._has_come:
            raise KeyboardInterrupt


def _warn(console: Console, told: str) -> None:
    console.print(f"warning: {told}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def _show(console: Console, line: Line) -> None:
    text = f"Watch it at [bold]{escape(line.text)}[/]" if line.is_address else escape(line.text)
    console.print(text, highlight=False, soft_wrap=True)


def _await_viewer(console: Console, supervisor: Supervisor) -> None:
    """Show lines up to the viewer's first, its address, so that the address precedes all else."""
    end_s = time.monotonic() + VIEWER_START_S
    while (line := supervisor.poll(end_s - time.monotonic())) is not None:
        _show(console, line)
        if line.name == VIEWER:
            return


def _watch(
    console: Console,
    supervisor: Supervisor,
    bus: ZenohBus,
    overview: Overview,
    interrupts: Interrupts,
) -> None:
    with Live(overview.text, console=console, auto_refresh=False, transient=True) as live:
        while True:
            interrupts.check()
            line = supervisor.poll(REFRESH_S)
            while line is not None:
                _show(console, line)
                line = supervisor.poll(0.0)
            bus.drain()
            if console.is_terminal:
                live.update(overview.text, refresh=True)
            elif overview.due():
                console.print(overview.text, soft_wrap=True)


class Overview:
    """The state of the simulation from its services' health: one line for each robot.

    It needs only the diagnostics that services publish once a second. A subscription to samples of
    the loop, through the router, would cost their publishers as much as another service does.
    """

    def __init__(self, bus: ZenohBus, scenario: Scenario) -> None:
        self._diagnostics = Diagnostics(bus, "", *scenario.names)
        self._reported_s = -QUIET_REPORT_S
        self._robots = scenario.names
        self._world = next((part for part in scenario.services if part in WORLDS), "")

    @property
    def text(self) -> str:
        """The lines as Rich markup."""
        world = self._diagnostics.reports.get(self._world, {})
        first, *others = [self._of(robot) for robot in self._robots]
        if "rtf" in world:
            missed = world.get("missed_deadlines", "?")
            first.append(f"{world['rtf']} × real time, {missed} missed")
        first += [f"warning: {world[name]}" for name in world if name.startswith(WARNING)]
        lines = "\n".join("  ·  ".join(words) for words in (first, *others))
        return f"[bold]t = {self._diagnostics.time_s:.1f} s[/]  {escape(lines)}"

    def due(self) -> bool:
        """Return whether enough simulated time has passed for another report."""
        if abs(self._diagnostics.time_s - self._reported_s) < QUIET_REPORT_S:
            return False
        self._reported_s = self._diagnostics.time_s
        return True

    def _of(self, robot: str) -> list[str]:
        """Return the state of a robot, its person and its follower."""
        parts = ("physics", join_key("target", robot), join_key("follower", robot))
        physics, person, follower = (self._diagnostics.reports.get(part, {}) for part in parts)
        physics_age, person_age, follower_age = map(self._age, parts)
        x, y = (number(physics, join_key(name, robot)) for name in ("x_m", "y_m"))
        person_x, person_y = number(person, "x_m"), number(person, "y_m")
        error = number(follower, "distance_error_m")
        said = []
        if x is not None and y is not None:
            said.append(f"{robot or 'robot'} ({x:+.2f}, {y:+.2f}){physics_age}")
        if person_x is not None and person_y is not None:
            ended = ", the walk has ended" if "walk_ended" in person else ""
            said.append(f"person ({person_x:+.2f}, {person_y:+.2f}){ended}{person_age}")
        if error is not None:
            said.append(f"{follower.get('tracking', '?')}, {error:+.3f} m off{follower_age}")
        return said

    def _age(self, part: str) -> str:
        """Return in words how old the newest report of a service is; empty while it is new."""
        age_s = self._diagnostics.age_s(part)
        rtf = number(self._diagnostics.reports.get(self._world, {}), "rtf") or 1.0
        return f" (stale, {age_s:.1f} s old)" if age_s > 1.0 / rtf + LATE_S else ""


def _work(process: str, scenario: Scenario) -> str:
    """Return a summary of a process from the nodes of its services."""
    if process == "router":
        return "connects processes and tools"
    known = services(rows(scenario.features))
    nodes = [row for part in process.split("+") for row in known.get(part) or (Row(part),)]
    if "+" in process:
        return ", ".join(row.name for row in nodes)
    return "; ".join(scenario.programs.get(row.name, row.summary) for row in nodes)


def _introduce(console: Console, scenario: Scenario, given: str, pids: Mapping[str, int]) -> None:
    """Show the processes of a scenario, given by a name or file, and commands to attach to it."""
    table = Table("process", "pid", "what it does", title="running", title_justify="left")
    for name, pid in pids.items():
        table.add_row(name, str(pid), escape(_work(name.rpartition("/")[2], scenario)))
    console.print(table)
    endpoint = _endpoints(scenario.bus)[0]
    console.print(f"Tools attach at [bold]{escape(endpoint)}[/]. In another terminal:")
    for line in hints(scenario, given):
        console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)
    console.print("Ctrl-C ends all of it.")


def _endpoints(bus: BusConfig) -> tuple[str, str]:
    """Return the endpoint for tools, and the one that they take by default."""
    default = SECURE_ROUTER if bus.keys else ROUTER
    return (bus.router_endpoints or (default,))[0], default


def hints(scenario: Scenario, name: str) -> list[str]:
    """Return commands for another terminal that act on a scenario, given by its name or file."""
    bus = scenario.bus
    endpoint, default = _endpoints(bus)
    options = {
        "connect": endpoint if endpoint != default else None,
        "namespace": bus.namespace,
        "tls": os.path.relpath(bus.keys) if bus.keys else None,
    }
    there = "".join(f" --{key} {shlex.quote(value)}" for key, value in options.items() if value)
    drive = '{"linear":{"x":0.3}}'
    odom, cmd_vel, walk = (
        scenario.renamed.get(key := join_key(topic.key, scenario.names[0]), key)
        for topic in (keys.ODOM, keys.CMD_VEL, keys.TARGET_CMD_VEL)
    )
    lines = [
        f"mecazen echo {odom}{there}",
        f"mecazen sim pause{there}   # also: resume, reset, step, speed",
        f"mecazen topics --live{there}",
    ]
    if "follower" in scenario.services:
        lines.append("mecazen up teleop   # instead of this: you drive the robot")
    else:
        whose = f" --robot {scenario.names[0]}" if scenario.robots else ""
        lines.insert(0, f"mecazen teleop{whose}{there}   # drives the robot by keyboard")
        lines.insert(1, f"mecazen pub {cmd_vel} '{drive}' --rate 20{there}   # drives the robot")
        if not bus.keys:
            zenoh = f"zenoh --mode client --connect {endpoint}"
            lines.insert(2, f"{zenoh} put -k {join_key(cmd_vel, bus.namespace or '')} -v '{drive}'")
    if isinstance(scenario.target.path, Driven):
        lines.insert(0, f"mecazen pub {walk} '{drive}' --rate 20{there}   # walks the person")
    else:
        driven = "--set target.path=\"{kind='driven'}\""
        lines.append(f"mecazen up {shlex.quote(name)} {driven}   # instead: you walk the person")
    if scenario.bus.ros2:
        domain = scenario.bus.ros_domain_id
        environment = f"RMW_IMPLEMENTATION=rmw_zenoh_cpp ROS_DOMAIN_ID={domain}"
        lines.append(f"{environment} ros2 topic list   # and rviz2, see docs/ros2.md")
    if shutil.which("mecazen") is None:
        activate = Path(sys.prefix) / "bin" / "activate"
        lines.insert(0, f". {os.path.relpath(activate)}   # once")
    return lines
