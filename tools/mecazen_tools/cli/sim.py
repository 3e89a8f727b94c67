"""`mecazen sim` and `mecazen param`: queries to the clock of a running simulation."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import typer
from mecazen import keys
from mecazen.errors import BusError, ConfigError
from mecazen.keys import AnswerT, Call, RequestT
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


def _show_state(
    context: typer.Context, call: Call[Any, SimState], request: Message, timeout_s: float = 10.0
) -> None:
    with tool_bus(context) as bus:
        typer.echo(msgspec.json.encode(bus.call(call, request, timeout_s)).decode())


@app.command()
def pause(context: typer.Context) -> None:
    """Hold simulated time."""
    _show_state(context, keys.SIM_PAUSE, Empty())


@app.command()
def resume(context: typer.Context) -> None:
    """Let simulated time go on."""
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
    """Put robot, person and time back to the start, in place."""
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
    """Print what simulated time does."""
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
    """Show what can be changed: value, unit, and what is allowed.

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
    """Print values, as --set takes them.

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
            help="A parameter and its value as --set takes them; an empty value leaves it out. "
            "Several are changed together, or none of them.",
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
    answer = ask(context, keys.SET_PARAMETERS, Parameters(parameters=tuple(changes)))
    begin_s = answer.header.stamp.ns / NS_PER_S
    for parameter in answer.parameters:
        typer.echo(printable(f"{parameter.name}={parameter.value} from t = {begin_s:g} s on"))
