"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, Scenario
from mecazen.config.bus import ROUTER, SECURE_ROUTER
from mecazen.errors import ConfigError
from mecazen.loading import (
    SCENARIO_VARIABLE,
    SETTINGS_VARIABLE,
    load_scenario,
    parse_settings,
    scenario_path,
)
from mecazen.schema import Folder
from rich.console import Console
from rich.table import Table
from rich.text import Text

ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        envvar=SCENARIO_VARIABLE,
        help="A scenario's name in configs/scenarios (back, side, teleop, …) or a TOML file.",
        show_default=False,
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        envvar=SETTINGS_VARIABLE,
        help="Override one setting, e.g. physics.dt_s=0.002; the value as in TOML, a bare word "
        "is a string. Repeatable.",
        show_default=False,
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        metavar="ENDPOINT",
        help="The Zenoh router to connect to.",
        show_default=f"{ROUTER}, or {SECURE_ROUTER} with --tls",
    ),
]
Tls = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="A folder of `mecazen keys create`: connect by TLS, as the operator.",
        show_default=False,
    ),
]
Namespace = Annotated[
    str | None, typer.Option(help="The robot's Zenoh namespace.", show_default=False)
]


TABLE_WIDTH = 80
"""Least width of a terminal in which tables of many columns are readable [characters]."""


def console(width: int) -> Console:
    """Return the terminal, or else a console of a `width` [characters] for tables."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=width)


def fitting(table: Table, width: int) -> Table | Text:
    """Return a table, or its rows as lines `column: value` if the terminal is too narrow for it."""
    if width >= TABLE_WIDTH:
        return table
    heads = [Text.from_markup(str(column.header)) for column in table.columns]
    lines = []
    for row in zip(*(column.cells for column in table.columns), strict=True):
        first, *others = (cell if isinstance(cell, Text) else Text(str(cell)) for cell in row)
        lines.append(Text(" ").join(first.split("\n")))
        for head, cell in zip(heads[1:], others, strict=True):
            if cell:
                lines.append(Text.assemble("  ", head, ": ", Text(", ").join(cell.split("\n"))))
    return Text("\n").join(lines)


def load(scenario: str, settings: list[str] | None) -> Scenario:
    """Load a scenario by name or path."""
    return load_scenario(scenario_path(scenario), parse_settings(settings or ()))


@contextmanager
def tool_bus(
    connect: str | None = None, namespace: str | None = None, tls: Path | None = None
) -> Iterator[ZenohBus]:
    """Open a bus as a client of a router; Ctrl-C ends the context quietly."""
    try:
        config = msgspec.convert(
            {
                "connect": None if connect is None else [connect],
                "namespace": namespace,
                "keys": None if tls is None else Folder(tls),
            },
            BusConfig,
        )
    except msgspec.ValidationError as error:
        raise ConfigError(f"--namespace {namespace}: {error}") from None
    bus = ZenohBus(config, "client")
    try:
        yield bus
    except KeyboardInterrupt:
        pass
    finally:
        bus.close()
