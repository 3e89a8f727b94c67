"""`mecazen echo` and `mecazen pub`: samples on the bus, read and written by hand."""

from __future__ import annotations

import time
from typing import Annotated, Any

import msgspec
import typer
from mecazen.bus.session import includes
from mecazen.errors import ConfigError
from mecazen.keys import topic_of
from mecazen.text import printable
from mecazen.wire import JSON_ENCODING, RefusedError, decode
from typer import Argument, Option

from mecazen_tools.cli.options import receive, tool_bus

SILENCE_S = 2.0
"""Time without a sample after which `echo` warns."""


def echo(
    context: typer.Context,
    key: Annotated[str, Argument(help="A key, or an expression such as 'target/**'.")],
    count: Annotated[
        int | None,
        Option(min=1, help="End after this number of samples.", show_default="until Ctrl-C"),
    ] = None,
) -> None:
    """Print the samples of a key, in any encoding, as JSON: one per line.

    Examples: mecazen echo odom --count 1 · mecazen echo 'diagnostics/*'
    """
    shown = 0

    def show(key: str, payload: bytes, encoding: str, _: bytes | None) -> None:
        nonlocal shown
        try:
            text = msgspec.json.encode(_read(key, payload, encoding)).decode()
            typer.echo(printable(text))
        except (RefusedError, msgspec.MsgspecError) as error:
            problem = f"{key}: {len(payload)} bytes that are no message: {error}"
            typer.echo(printable(problem), err=True)
        shown += 1

    _warn_unknown(key)
    with tool_bus(context) as bus:
        bus.subscribe_bytes(key, show)
        if not bus.spin_once(SILENCE_S):
            _warn(f"{key}: no sample for {SILENCE_S:g} s; `mecazen topics --live` shows all rates")
        while count is None or shown < count:
            bus.spin_once()


def pub(
    context: typer.Context,
    key: Annotated[str, Argument(help="A key, e.g. cmd_vel.")],
    message: Annotated[
        str, Argument(metavar="JSON", help='The message, e.g. \'{"linear":{"x":0.2}}\'.')
    ],
    rate: Annotated[
        float | None,
        Option(metavar="HZ", min=0.01, max=1000, help="Publish at this rate.", show_default="once"),
    ] = None,
    duration: Annotated[
        float | None,
        Option(metavar="S", min=0, help="Stop after this time.", show_default="until Ctrl-C"),
    ] = None,
) -> None:
    """Publish a message given in JSON, once or at a rate.

    Example: mecazen pub cmd_vel '{"linear":{"x":0.3}}' --rate 20 --duration 3
    """
    if includes(key, key) and "*" in key:
        raise ConfigError(f"{key}: an expression; a message goes to one key, such as cmd_vel")
    payload = message.encode()
    try:
        _read(key, payload, JSON_ENCODING)
    except (RefusedError, msgspec.MsgspecError) as error:
        raise ConfigError(f"{key}: {error}") from None
    if duration is not None and rate is None:
        raise ConfigError("--duration needs --rate")
    _warn_unknown(key)
    with tool_bus(context) as bus:
        begin_s, sent = time.monotonic(), 0
        while True:
            bus.put_bytes(key, payload, JSON_ENCODING)
            sent += 1
            if rate is None or (duration is not None and sent >= duration * rate):
                break
            receive(bus, begin_s + sent / rate - time.monotonic())


def _warn_unknown(key: str) -> None:
    """Warn of a key that the table does not have: a user's own, or a typo."""
    if includes(key, key) and "*" not in key and topic_of(key) is None:
        _warn(f"{key}: not among `mecazen topics`")


def _read(key: str, payload: bytes, encoding: str) -> Any:
    """Decode a payload: a message if the table has the key, else any JSON."""
    topic = topic_of(key)
    return msgspec.json.decode(payload) if topic is None else decode(payload, topic.type, encoding)


def _warn(warning: str) -> None:
    typer.echo(printable(f"warning: {warning}"), err=True)
