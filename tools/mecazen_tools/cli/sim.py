"""`mecazen sim`, `mecazen param` and `mecazen world`: queries to the clock of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import msgspec.inspect as mi
import typer
from mecazen import keys
from mecazen.config.people import Passerby
from mecazen.config.world import Box
from mecazen.errors import BusError, ConfigError
from mecazen.keys import AnswerT, Call, RequestT
from mecazen.loading import override, parse_settings
from mecazen.messages import (
    Empty,
    Message,
    Parameter,
    ParameterNames,
    Parameters,
    ResetRequest,
    SimState,
    SpeedRequest,
    StepRequest,
)
from mecazen.parameters import ADDED, to_text
from mecazen.text import printable
from mecazen.wire import NS_PER_S
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from mecazen_tools.cli.options import console, tool_bus

STEP_TIMEOUT_S = 3600.0

NEGATIVE_NUMBERS = {"ignore_unknown_options": True}
"""Makes -3 a number out of range, not an unknown option."""

app = typer.Typer(no_args_is_help=True, help="Pause, resume, step, reset or speed up a simulation.")
param_app = typer.Typer(
    no_args_is_help=True, help="Show and change settings while a simulation runs."
)
world_app = typer.Typer(
    no_args_is_help=True, help="Add boxes and people to a running simulation, and remove them."
)


def _show_state(
    context: typer.Context, call: Call[Any, SimState], request: Message, timeout_s: float = 10.0
) -> None:
    with tool_bus(context) as bus:
        typer.echo(msgspec.json.encode(bus.call(call, request, timeout_s)).decode())


@app.command()
def pause(context: typer.Context) -> None:
    """Pause simulated time."""
    _show_state(context, keys.SIM_PAUSE, Empty())


@app.command()
def resume(context: typer.Context) -> None:
    """Continue simulated time."""
    _show_state(context, keys.SIM_RESUME, Empty())


@app.command(context_settings=NEGATIVE_NUMBERS)
def step(
    context: typer.Context,
    ticks: Annotated[int, Argument(min=1, max=10**9, help="Ticks to simulate.")] = 1,
) -> None:
    """Simulate some ticks while paused, and wait for them."""
    _show_state(context, keys.SIM_STEP, StepRequest(ticks=ticks), STEP_TIMEOUT_S)


@app.command()
def reset(
    context: typer.Context,
    seed: Annotated[
        int | None, Option(min=0, max=2**32 - 1, help="A new seed.", show_default="the old one")
    ] = None,
) -> None:
    """Return robot, person and time to the start; processes continue."""
    _show_state(context, keys.SIM_RESET, ResetRequest(seed=seed))


@app.command(context_settings=NEGATIVE_NUMBERS)
def speed(
    context: typer.Context,
    factor: Annotated[
        float, Argument(min=0.01, max=1000.0, help="Simulated seconds per wall second.")
    ],
) -> None:
    """Run faster or slower than real time."""
    _show_state(context, keys.SIM_SPEED, SpeedRequest(speed=factor))


@app.command()
def state(context: typer.Context) -> None:
    """Print the state of simulated time."""
    _show_state(context, keys.SIM_STATE, Empty())


def ask(context: typer.Context, call: Call[RequestT, AnswerT], request: RequestT) -> AnswerT:
    """Query the clock; raises ConfigError with the reason of a refusal."""
    with tool_bus(context) as bus:
        try:
            return bus.call(call, request)
        except BusError as error:
            # the reason names its subject
            raise ConfigError(printable(str(error).removeprefix(f"{call.key}: "))) from None


@param_app.command(name="list")
def list_(
    context: typer.Context,
    section: Annotated[
        str, Argument(metavar="[SECTION]", help="One section only, e.g. follower.")
    ] = "",
    as_json: Annotated[bool, Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Show settings that can be changed: value, unit and allowed values.

    Examples: mecazen param list · mecazen param list controller.limits.x
    """
    answer = ask(context, keys.GET_PARAMETERS, ParameterNames())
    begin = f"{section}." if section else ""
    parameters = tuple(p for p in answer.parameters if f"{p.name}.".startswith(begin))
    if not parameters:
        raise ConfigError(f"nothing that can be changed begins with {section!r}")
    if as_json:
        answer = msgspec.structs.replace(answer, parameters=parameters)
        typer.echo(msgspec.json.format(msgspec.json.encode(answer)).decode())
        return
    table = Table("parameter", "value", "unit", "allowed")
    for parameter in parameters:
        value = parameter.value or "left out"
        cells = parameter.name, value, parameter.unit, parameter.allowed
        table.add_row(*(Text(printable(cell)) for cell in cells))
    console(160).print(table)


@param_app.command()
def get(
    context: typer.Context,
    names: Annotated[list[str], Argument(metavar="NAME...", help="E.g. follower.standoff_m.")],
) -> None:
    """Print settings in the format of --set.

    Example: mecazen param get follower.standoff_m
    """
    answer = ask(context, keys.GET_PARAMETERS, ParameterNames(names=tuple(names)))
    for parameter in answer.parameters:
        typer.echo(printable(f"{parameter.name}={parameter.value}"))


@param_app.command(name="set")
def set_(
    context: typer.Context,
    settings: Annotated[
        list[str],
        Argument(
            metavar="NAME=VALUE...",
            help="A setting and its value, as in --set; an empty value removes the setting. "
            "All are changed, or none.",
        ),
    ],
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
    answer, begin = _set(context, changes)
    for parameter in answer.parameters:
        typer.echo(printable(f"{parameter.name}={parameter.value} {begin}"))


def _set(context: typer.Context, changes: Sequence[Parameter]) -> tuple[Parameters, str]:
    """Set parameters; return the answer, and the time of the change as text."""
    answer = ask(context, keys.SET_PARAMETERS, Parameters(parameters=tuple(changes)))
    return answer, f"from t = {answer.header.stamp.ns / NS_PER_S:g} s on"


@world_app.command()
def add(
    context: typer.Context,
    kind: Literal["box", "person"],
    name: Annotated[str, Argument(metavar="NAME", help="A new name, e.g. crate.")],
    at: Annotated[
        tuple[float, float], Option("--at", metavar="X Y", help="Place in the world in metres.")
    ],
    yaw: Annotated[float, Option(metavar="DEG", help="Heading in the world.")] = 0.0,
    size: Annotated[
        tuple[float, float, float],
        Option(metavar="X Y Z", help="Length, width and height of a box in metres."),
    ] = (0.5, 0.5, 0.5),
    settings: Annotated[
        list[str] | None,
        Option(
            "--set", metavar="KEY=VALUE", help="A setting, e.g. a person's path.kind. Repeatable."
        ),
    ] = None,
) -> None:
    """Add a box or a standing person, from the next tick on until the run ends.

    Examples: mecazen world add box crate --at 2 0 --size 0.4 0.4 0.6 --yaw 30 ·
    mecazen world add person bob --at 3 -2 --yaw 90 --set path.kind=straight
    """
    box = {"size_m": size, "position_m": at, "yaw_deg": yaw}
    path = {"kind": "standing", "x_m": at[0], "y_m": at[1], "yaw_deg": yaw}
    thing: dict[str, Any] = {"kind": kind, **(box if kind == "box" else {"path": path})}
    for key, value in parse_settings(settings or ()).items():
        override(thing, mi.type_info(Box if kind == "box" else Passerby), key, value)
    _change(context, {name: thing})


@world_app.command()
def remove(
    context: typer.Context,
    names: Annotated[
        list[str], Argument(metavar="NAME...", help="The names that `mecazen world add` gave.")
    ],
) -> None:
    """Remove all named boxes and people, or none.

    Example: mecazen world remove crate bob
    """
    _change(context, dict.fromkeys(names))


@world_app.command(name="list")
def list_added(context: typer.Context) -> None:
    """Show added boxes and people with their settings."""
    for thing in ask(context, keys.GET_PARAMETERS, ParameterNames()).parameters:
        if thing.name.startswith(ADDED):
            typer.echo(printable(f"{thing.name.removeprefix(ADDED)} = {thing.value}"))


def _change(context: typer.Context, things: dict[str, Any]) -> None:
    """Add things by name, and remove those that are None; print the time of the change."""
    changes = [Parameter(ADDED + name, to_text(thing)) for name, thing in things.items()]
    _, begin = _set(context, changes)
    for name, thing in things.items():
        change = "removed" if thing is None else "added"
        typer.echo(printable(f"{name} {change} {begin}"))
