"""Options that several commands share."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import typer
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import BusError
from mecazen.keys import SIM_SCENARIO
from mecazen.loading import (
    SCENARIO_VARIABLE,
    SETTINGS_VARIABLE,
    load_scenario,
    parse_settings,
    scenario_path,
)
from mecazen.messages import Empty
from rich.console import Console
from typer import Argument, Option

ScenarioArgument = Annotated[
    str,
    Argument(
        metavar="SCENARIO",
        envvar=SCENARIO_VARIABLE,
        help="A scenario's name in configs/scenarios (back, side, teleop, …) or a TOML file.",
    ),
]
Settings = Annotated[
    list[str] | None,
    Option(
        "--set",
        metavar="KEY=VALUE",
        envvar=SETTINGS_VARIABLE,
        help="Override one setting, e.g. physics.dt_s=0.002; values are TOML, bare words are "
        "strings. Repeatable.",
    ),
]
Duration = Annotated[
    float | None,
    Option("--duration", min=0, help="Simulated seconds.", show_default="the scenario's"),
]

RecordingFile = Annotated[
    Path,
    Argument(metavar="FILE", help="A recording: MCAP, db3 or CSV, or a rosbag2."),
]
Topics = Annotated[
    str,
    Option(
        "--topics",
        metavar="KEY=TOPIC,…",
        help="In recordings of other programs: each key's topic, e.g. joint_states=/robot/joints; "
        "/tf:FRAME is a frame's pose. In CSV: KEY=PREFIX of the key's columns.",
    ),
]
RecordedScenario = Annotated[
    str | None,
    Option(
        "--scenario",
        metavar="SCENARIO",
        help="The scenario of a recording that lacks its configuration.",
    ),
]

ANSWER_S = 1.0
"""Timeout of a query for the running scenario [s]."""


def output(content: str, default: str = "") -> Any:
    """Return the option of the file that a command writes, by its content and its default name."""
    return Option("-o", "--output", metavar="FILE", help=content, show_default=default or False)


def console(width: int) -> Console:
    """Return the terminal, or else a console of a `width` [characters] for tables."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=width)


def load(scenario: str, settings: list[str] | None) -> Scenario:
    """Load a scenario by name or path."""
    return load_scenario(scenario_path(scenario), parse_settings(settings or ()))


def warn(scenario: Scenario) -> None:
    """Print what the robots of a scenario can't do with their persons."""
    from mecazen_tools.suitability import warnings  # noqa: PLC0415  # help needs no NumPy

    for line in warnings(scenario):
        typer.echo(f"warning: {line}", err=True)


@contextmanager
def tool_bus(context: typer.Context) -> Iterator[ZenohBus]:
    """Open a bus as a client of the router that the options of `mecazen` name.

    Ctrl-C ends the context quietly.
    """
    with closing(ZenohBus(context.obj, "client")) as bus, suppress(KeyboardInterrupt):
        yield bus


def receive(bus: ZenohBus, duration_s: float) -> None:
    """Deliver samples for a duration [s]."""
    end_s = time.monotonic() + duration_s
    while (left_s := end_s - time.monotonic()) > 0.0:
        bus.spin_once(left_s)


def scenario_at(bus: ZenohBus) -> str:
    """Return the running scenario in TOML; empty if no service answers."""
    try:
        return bus.call(SIM_SCENARIO, Empty(), ANSWER_S).data
    except BusError:
        return ""
