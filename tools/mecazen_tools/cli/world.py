"""`mecazen world`: boxes and people that are added to a running simulation, and removed."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec.inspect as mi
import typer
from mecazen import keys
from mecazen.config.people import Passerby
from mecazen.config.world import Box
from mecazen.loading import override, parse_settings
from mecazen.messages import Parameter, ParameterNames, Parameters
from mecazen.parameters import ADDED, to_text
from mecazen.text import printable
from mecazen.wire import NS_PER_S
from typer import Argument, Option

from mecazen_tools.cli.sim import ask

app = typer.Typer(
    no_args_is_help=True, help="Add boxes and people to a running simulation, and remove them."
)


@app.command()
def add(
    context: typer.Context,
    kind: Literal["box", "person"],
    name: Annotated[str, Argument(metavar="NAME", help="A new name, e.g. crate.")],
    at: Annotated[
        tuple[float, float], Option("--at", metavar="X Y", help="Its place in the world in metres.")
    ],
    yaw: Annotated[float, Option(metavar="DEG", help="Its heading in the world.")] = 0.0,
    size: Annotated[
        tuple[float, float, float],
        Option(metavar="X Y Z", help="Length, width and height of a box in metres."),
    ] = (0.5, 0.5, 0.5),
    settings: Annotated[
        list[str] | None,
        Option("--set", metavar="KEY=VALUE", help="E.g. a person's path.kind. Repeatable."),
    ] = None,
) -> None:
    """Add a box, or a person who stands, from the next tick on until the run ends.

    Examples: mecazen world add box crate --at 2 0 --size 0.4 0.4 0.6 --yaw 30 ·
    mecazen world add person bob --at 3 -2 --yaw 90 --set path.kind=straight
    """
    box = {"size_m": size, "position_m": at, "yaw_deg": yaw}
    path = {"kind": "standing", "x_m": at[0], "y_m": at[1], "yaw_deg": yaw}
    thing: dict[str, Any] = {"kind": kind, **(box if kind == "box" else {"path": path})}
    for key, value in parse_settings(settings or ()).items():
        override(thing, mi.type_info(Box if kind == "box" else Passerby), key, value)
    _set(context, {name: thing})


@app.command()
def remove(
    context: typer.Context,
    names: Annotated[
        list[str], Argument(metavar="NAME...", help="The names that `mecazen world add` gave.")
    ],
) -> None:
    """Remove what was added, all or nothing.

    Example: mecazen world remove crate bob
    """
    _set(context, dict.fromkeys(names))


@app.command(name="list")
def list_(context: typer.Context) -> None:
    """Show what was added, with its settings."""
    for thing in ask(context, keys.GET_PARAMETERS, ParameterNames()).parameters:
        if thing.name.startswith(ADDED):
            typer.echo(printable(f"{thing.name.removeprefix(ADDED)} = {thing.value}"))


def _set(context: typer.Context, things: dict[str, Any]) -> None:
    """Add things by name, and remove those that are None; print the time of the change."""
    changes = tuple(Parameter(ADDED + name, to_text(thing)) for name, thing in things.items())
    answer = ask(context, keys.SET_PARAMETERS, Parameters(parameters=changes))
    time_s = answer.header.stamp.ns / NS_PER_S
    for name, thing in things.items():
        change = "removed" if thing is None else "added"
        typer.echo(printable(f"{name} {change} from t = {time_s:g} s on"))
