"""`mecazen sim`: simulated time at run time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.keys import Call
from mecazen.messages import Message, SimState

from mecazen_tools.cli.options import Connect, Namespace, Tls, tool_bus

STEP_TIMEOUT_S = 3600.0

NEGATIVE_NUMBERS = {"ignore_unknown_options": True}
"""Makes -3 a number out of range, not an unknown option."""

app = typer.Typer(no_args_is_help=True, help="Pause, resume, step, reset or speed up a simulation.")


def _ask(
    call: Call[Any, SimState],
    connect: str | None,
    namespace: str | None,
    tls: Path | None,
    timeout_s: float = 10.0,
    **fields: Any,
) -> None:
    try:
        request: Message = msgspec.convert(fields, call.request)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{call.key}: {error}") from None
    with tool_bus(connect, namespace, tls) as bus:
        state = bus.call(call, request, timeout_s)
        typer.echo(msgspec.json.encode(state).decode())


@app.command()
def pause(connect: Connect = None, namespace: Namespace = None, tls: Tls = None) -> None:
    """Hold simulated time."""
    _ask(keys.SIM_PAUSE, connect, namespace, tls)


@app.command()
def resume(connect: Connect = None, namespace: Namespace = None, tls: Tls = None) -> None:
    """Let simulated time go on."""
    _ask(keys.SIM_RESUME, connect, namespace, tls)


@app.command(context_settings=NEGATIVE_NUMBERS)
def step(
    ticks: Annotated[int, typer.Argument(min=1, max=10**9, help="Ticks to simulate.")] = 1,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Simulate some ticks while paused, and wait for them."""
    _ask(keys.SIM_STEP, connect, namespace, tls, STEP_TIMEOUT_S, ticks=ticks)


@app.command()
def reset(
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=2**32 - 1, help="A new seed.", show_default="the old one"),
    ] = None,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Put robot, person and time back to the start, in place."""
    _ask(keys.SIM_RESET, connect, namespace, tls, **({} if seed is None else {"seed": seed}))


@app.command(context_settings=NEGATIVE_NUMBERS)
def speed(
    factor: Annotated[
        float, typer.Argument(min=0.01, max=1000.0, help="Simulated seconds per wall second.")
    ],
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Run faster or slower than real time."""
    _ask(keys.SIM_SPEED, connect, namespace, tls, speed=factor)


@app.command()
def state(connect: Connect = None, namespace: Namespace = None, tls: Tls = None) -> None:
    """Print what simulated time does."""
    _ask(keys.SIM_STATE, connect, namespace, tls)
