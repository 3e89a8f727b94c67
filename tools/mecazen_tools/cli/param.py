"""`mecazen param`: settings that can be changed while a simulation runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from mecazen import keys
from mecazen.errors import BusError, ConfigError
from mecazen.explain import one_line
from mecazen.keys import Call
from mecazen.messages import Message, Parameter, ParameterNames, Parameters
from rich.table import Table
from rich.text import Text

from mecazen_tools.cli.options import Connect, Namespace, Tls, console, fitting, tool_bus

AsJson = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]
Names = Annotated[list[str], typer.Argument(metavar="NAME...", help="E.g. follower.standoff_m.")]

app = typer.Typer(no_args_is_help=True, help="Show and change settings while a simulation runs.")


def _ask(
    call: Call[Any, Any],
    request: Message,
    connect: str | None,
    namespace: str | None,
    tls: Path | None,
) -> Any:
    with tool_bus(connect, namespace, tls) as bus:
        try:
            return bus.call(call, request)
        except BusError as error:
            # the reason names its subject
            raise ConfigError(one_line(str(error).removeprefix(f"{call.key}: "))) from None


def _print(message: Message) -> None:
    typer.echo(msgspec.json.format(msgspec.json.encode(message)).decode())


@app.command(name="list")
def list_(
    section: Annotated[
        str, typer.Argument(metavar="[SECTION]", help="One section only, e.g. follower.")
    ] = "",
    as_json: AsJson = False,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Show what can be changed: value, unit, and what is allowed.

    Examples: mecazen param list · mecazen param list controller.limits.x
    """
    answer = _ask(keys.GET_PARAMETERS, ParameterNames(), connect, namespace, tls)
    found = [p for p in answer.parameters if f"{p.name}.".startswith(f"{section}." * bool(section))]
    if not found:
        raise ConfigError(f"nothing that can be changed begins with {section!r}")
    if as_json:
        _print(msgspec.structs.replace(answer, parameters=tuple(found)))
        return
    table = Table("parameter", "value", "unit", "allowed")
    for one in found:
        cells = one.name, one.value or "left out", one.unit, one.allowed
        table.add_row(*(Text(one_line(cell)) for cell in cells))
    shown = console(160)
    shown.print(fitting(table, shown.width))


@app.command()
def get(
    names: Names,
    as_json: AsJson = False,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Print values, as --set takes them.

    Example: mecazen param get follower.standoff_m
    """
    request = ParameterNames(names=tuple(names))
    answer = _ask(keys.GET_PARAMETERS, request, connect, namespace, tls)
    if as_json:
        _print(answer)
        return
    for one in answer.parameters:
        typer.echo(one_line(f"{one.name}={one.value}"))


@app.command(name="set")
def set_(
    settings: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME=VALUE...",
            help="A parameter and its value as --set takes them; an empty value leaves it out. "
            "Several are changed together, or none of them.",
        ),
    ],
    as_json: AsJson = False,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Change settings from the next tick on, until the simulation ends; a reset keeps them.

    Examples: mecazen param set follower.standoff_m=1.5 ·
    mecazen param set follower.bearing_deg=120 follower.heading_deg=-60
    """
    changes = []
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise ConfigError(f"{setting}: must be NAME=VALUE, such as follower.standoff_m=1.5")
        changes.append(Parameter(name=name.strip(), value=value.strip()))
    request = Parameters(parameters=tuple(changes))
    answer = _ask(keys.SET_PARAMETERS, request, connect, namespace, tls)
    if as_json:
        _print(answer)
        return
    begins_s = answer.header.stamp.ns / 1e9
    for one in answer.parameters:
        typer.echo(one_line(f"{one.name}={one.value} from t = {begins_s:g} s on"))
