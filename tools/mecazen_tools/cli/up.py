"""`mecazen up`: all processes of a scenario, and their state, in one terminal."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from mecazen import keys
from mecazen.bus.ports import free_port, is_free
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.commands import FOLLOWER
from mecazen.config import BusConfig, Process, Scenario
from mecazen.config.bus import ROUTER, SECURE_ROUTER
from mecazen.config.people import Driven
from mecazen.config.services import ViewerConfig
from mecazen.errors import BusError, ConfigError, is_installed
from mecazen.files import to_value
from mecazen.graph import OBSERVERS, WORLDS
from mecazen.loading import load_scenario, parse_settings, scenario_path, with_settings
from mecazen.programs import refuse_missing
from mecazen.robots import join_key
from mecazen.runtime.process import refuse_missing_ros
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from typer import Option

from mecazen_tools.cli.options import ScenarioArgument, Settings, warn
from mecazen_tools.cli.status import LATE_S, WARNING, Diagnostics, Report, number
from mecazen_tools.forking import STOPPING
from mecazen_tools.processes import Supervisor

REFRESH_S = 0.25
QUIET_REPORT_S = 5.0
"""Simulated time between two lines of status if the output is not a terminal [s]."""

VIEWER = "viewer"


def up(
    scenario: ScenarioArgument,
    viewer: Annotated[
        Literal["web", "native"],
        Option(help="Show the run on a web page, or also in Rerun's own window."),
    ] = "web",
    no_viewer: Annotated[
        bool, Option("--no-viewer", help="Start no viewer, which saves processor time.")
    ] = False,
    without: Annotated[
        list[str] | None,
        Option(metavar="SERVICE", help="Leave out a service, such as follower. Repeatable."),
    ] = None,
    restart: Annotated[
        bool, Option("--restart", help="Restart a process that fails or is killed.")
    ] = False,
    processes: Annotated[
        int | None,
        Option(min=1, max=1, help="1: all services in one process.", show_default="the scenario's"),
    ] = None,
    ros2: Annotated[
        bool, Option("--ros2", help="The services are ROS 2 nodes as well, for rmw_zenoh.")
    ] = False,
    settings: Settings = None,
) -> None:
    """Start a scenario's services as processes, in real time, until Ctrl-C.

    A router for services and tools listens on tcp/127.0.0.1:7447, or on a free port if another
    run uses that port. If a process fails, its error is shown and all processes end. With
    --restart, the process starts again. If viewer or recorder fails, the others continue.

    Examples: mecazen up back · mecazen up teleop --no-viewer · mecazen up back --without follower
    """
    path, overrides = scenario_path(scenario), list(settings or ())
    has_viewer = not no_viewer and is_installed(VIEWER)
    if viewer == "native" and not no_viewer:
        if not has_viewer:
            raise ConfigError("--viewer native: pip install 'mecazen[viewer]'")
        overrides.append("viewer.native=true")
    if ros2:
        overrides.append("bus.ros2=true")
    loaded = load_scenario(path, parse_settings(overrides))
    overrides += settings_without(loaded, without or ())
    loaded = load_scenario(path, parse_settings(overrides))
    if processes == 1:
        group = [part for part in loaded.services if part not in OBSERVERS]
        overrides.append(f"processes={to_value([group])}")
    shares_router = _shares_router(loaded.bus)
    moved = moved_ports(loaded, shares_router=shares_router)
    overrides += moved
    loaded = load_scenario(path, parse_settings(overrides))
    for part in loaded.services:
        refuse_missing(part, loaded)
    refuse_missing_ros(loaded.bus)
    plan = [(process, process.services[0] not in OBSERVERS) for process in loaded.process_plan]
    if has_viewer and VIEWER not in loaded.services:
        plan.append((Process((VIEWER,)), False))
    console = Console()
    supervisor = Supervisor(path, overrides, restart=restart)
    interrupted = interrupt_on_signals()
    ports = "; the usual ports are taken, so it takes free ones" if moved else ""
    begin = f"[bold]mecazen[/] starts scenario [bold]{escape(path.stem)}[/] ({escape(str(path))})"
    try:
        console.print(begin + ports, soft_wrap=True)
        warn(loaded)
        if not shares_router:
            supervisor.start_router()
        with closing(ZenohBus(loaded.bus, "client", renamed=loaded.renamed)) as bus:
            diagnostics = Diagnostics(bus)
            for process, needed in plan:
                supervisor.start(process, needed=needed)
            _introduce(console, loaded, supervisor.pids)
            _watch(console, supervisor, bus, partial(overview, diagnostics, loaded), interrupted)
    except KeyboardInterrupt:
        pass
    finally:
        with suppress(OSError):  # all processes end even if the output is closed
            if interrupted.is_set():
                console.print("stopping …")
        for name in supervisor.stop():
            console.print(f"{name} did not end in time and was killed")
    console.print("all processes have ended")


def settings_without(scenario: Scenario, without: Sequence[str]) -> list[str]:
    """Return the settings that leave out services.

    Raises:
        ConfigError: The scenario has no such service, or its sensors need it.
    """
    if not without:
        return []
    left = [name for name in scenario.services if name not in without]
    groups = [[name for name in group if name in left] for group in scenario.processes]
    settings = {"services": left, "processes": [group for group in groups if group]}
    for name in without:
        if name not in scenario.services:
            names = ", ".join(scenario.services)
            raise ConfigError(f"--without {name}: no such service; services: {names}")
        if name in with_settings(scenario, settings).services:
            raise ConfigError(
                f"--without {name}: sensor.kind = {scenario.sensor.kind!r} needs it; a program "
                "that publishes cmd_vel takes over from it"
            )
    return [f"{key}={to_value(names)}" for key, names in settings.items()]


def _shares_router(bus: BusConfig) -> bool:
    """Return whether a router of another run exists, which this namespace can share."""
    if bus.namespace is not None:
        with suppress(BusError):
            ZenohBus(bus, "client").close()
            return True
    return False


def moved_ports(scenario: Scenario, *, shares_router: bool) -> list[str]:
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
        if getattr(scenario.viewer, name) == port and not is_free(port, scenario.viewer.listen):
            moved.append(f"viewer.{name}=0")
    return moved


def interrupt_on_signals() -> threading.Event:
    """Raise KeyboardInterrupt at each signal that asks this process to end, and set an event.

    Python drops an exception that is raised in a destructor or a callback; the event stays.
    """
    interrupted = threading.Event()

    def interrupt(*_: object) -> None:
        interrupted.set()
        raise KeyboardInterrupt

    for stopping in STOPPING:
        signal.signal(stopping, interrupt)
    return interrupted


def _watch(
    console: Console,
    supervisor: Supervisor,
    bus: ZenohBus,
    state: Callable[[], tuple[float, str]],
    interrupted: threading.Event,
) -> None:
    """Show the lines of processes, and below them the state, until a signal.

    Outside a terminal the state is a line every `QUIET_REPORT_S`.
    """
    reported_s = -QUIET_REPORT_S
    with Live(console=console, auto_refresh=False, transient=True) as live:
        while not interrupted.is_set():
            line = supervisor.poll(REFRESH_S)
            while line is not None:
                text = escape(line.text)
                text = f"Watch it at [bold]{text}[/]" if line.is_address else text
                console.print(text, highlight=False, soft_wrap=True)
                line = supervisor.poll(0.0)
            bus.drain()
            time_s, text = state()
            if console.is_terminal:
                live.update(text, refresh=True)
            elif abs(time_s - reported_s) >= QUIET_REPORT_S:
                reported_s = time_s
                console.print(text, soft_wrap=True)


def overview(diagnostics: Diagnostics, scenario: Scenario) -> tuple[float, str]:
    """Return simulated time [s], and the state as Rich markup, a line for each robot.

    Diagnostics come once a second. A subscription to samples of the loop, through the router, would
    cost their publishers as much as another service does.
    """
    name = next((part for part in scenario.services if part in WORLDS), "")
    world = diagnostics.reports.get(name, {})
    late_s = 1.0 / (number(world, "rtf") or 1.0) + LATE_S
    robots = [_overview_of(robot, diagnostics, late_s) for robot in scenario.names]
    if "rtf" in world:
        robots[0].append(f"{world['rtf']} × real time, {world.get('missed_deadlines', '?')} missed")
    drives = diagnostics.drives()
    for robot, parts in zip(scenario.names, robots, strict=True):
        if (driver := drives.get(robot)) not in (None, "", FOLLOWER):
            parts.append(f"driven by {driver}")
    robots[0] += [f"warning: {world[name]}" for name in world if name.startswith(WARNING)]
    robots[0] += [f"warning: {contest}" for contest in diagnostics.contests()]
    lines = "\n".join("  ·  ".join(parts) for parts in robots)
    time_s = diagnostics.time_s
    return time_s, f"[bold]t = {time_s:.1f} s[/]  {escape(lines)}"


def _overview_of(robot: str, diagnostics: Diagnostics, late_s: float) -> list[str]:
    """Return the state of a robot, its person and its follower."""
    target, follower = join_key("target", robot), join_key("follower", robot)
    texts = {
        "physics": _place(robot or "robot", diagnostics.reports.get("physics", {}), robot),
        target: _place("person", diagnostics.reports.get(target, {})),
        follower: diagnostics.followed(robot),
    }
    parts = []
    for service, text in texts.items():
        if text:
            ended = "walk_ended" in diagnostics.reports[service]
            age_s = diagnostics.age_s(service)
            age = f" (stale, {age_s:.1f} s old)" if age_s > late_s else ""
            parts.append(text + (", the walk has ended" if ended else "") + age)
    return parts


def _place(name: str, report: Report, robot: str = "") -> str:
    x, y = (number(report, join_key(key, robot)) for key in ("x_m", "y_m"))
    return "" if x is None or y is None else f"{name} ({x:+.2f}, {y:+.2f})"


def _introduce(console: Console, scenario: Scenario, pids: Mapping[str, int]) -> None:
    """Show the processes of a scenario, and commands to attach to it."""
    table = Table("process", "pid", title="running", title_justify="left")
    for process, pid in pids.items():
        table.add_row(process, str(pid))
    console.print(table)
    console.print("In another terminal:")
    for line in hints(scenario):
        console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)
    console.print("Ctrl-C ends all of it.")


def hints(scenario: Scenario) -> list[str]:
    """Return commands for another terminal that act on a scenario."""
    bus = scenario.bus
    default = SECURE_ROUTER if bus.keys else ROUTER
    endpoint = (bus.router_endpoints or (default,))[0]
    options = {
        "connect": endpoint if endpoint != default else None,
        "namespace": bus.namespace,
        "tls": os.path.relpath(bus.keys) if bus.keys else None,
    }
    pairs = [f" --{key} {shlex.quote(value)}" for key, value in options.items() if value]
    tool = f"mecazen{''.join(pairs)}"
    robot = scenario.names[0]
    odom = join_key(keys.ODOM.key, robot)
    lines = [
        f"{tool} status   # all services",
        f"{tool} echo {scenario.renamed.get(odom, odom)}",
        f"{tool} sim pause   # also: resume, reset, step, speed",
    ]
    teleop = f"{tool} teleop{f' --robot {robot}' if robot else ''}"
    lines.append(f"{teleop}   # drives the robot by keyboard or gamepad")
    if isinstance(scenario.target.path, Driven):
        lines.append(f"{teleop} --person   # walks the person")
    if shutil.which("mecazen") is None:
        activate = Path(sys.prefix) / "bin" / "activate"
        lines.insert(0, f". {os.path.relpath(activate)}   # once")
    return lines
