"""Commands that show the graph, and read and write samples on the bus."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Annotated, Any

import msgspec
import typer
from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import ConfigError, MecazenError
from mecazen.graph import GRAPH, Graph
from mecazen.keys import TOPICS, resolve, topic_of
from mecazen.limits import refuse_implausible
from mecazen.loop import turns_of
from mecazen.messages import Message
from mecazen.programs import graph_of
from mecazen.text import printable, unknown_fields
from mecazen.wire import JSON_ENCODING, STAMPED, RefusedError, decode
from rich.table import Column, Table
from rich.text import Text

from mecazen_tools import graph_views
from mecazen_tools.cli.options import (
    Connect,
    Namespace,
    Settings,
    Tls,
    console,
    fitting,
    load,
    tool_bus,
)
from mecazen_tools.strays import absent, ignored, mistake, unknown_to

LIVE_S = 1.0
WIDE = 160
"""Width of a terminal that has room for whole names of message types [characters]."""
SILENCE_S = 2.0
"""Time without a sample after which `echo` warns."""


def graph(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="Its nodes; left out, all that there are."),
    ] = None,
    settings: Settings = None,
) -> None:
    """Show the nodes in the order in which they run: what they take and give, and their processes.

    Example: mecazen graph back
    """
    loaded: Any = graph_views.DEFAULTS
    if scenario is None:
        nodes, order = Graph(GRAPH), [row.name for row in GRAPH]
        process_of = {row.name: row.part_of for row in GRAPH}
    else:
        loaded = load(scenario, settings)
        nodes = graph_of(loaded)
        process_of = {
            row.name: process.name
            for process in loaded.process_plan
            if process.robot in ("", loaded.names[0])
            for service in process.services
            for row in nodes.services[service]
        }
        turns = [turn.row.name for turn in turns_of(loaded, nodes)]
        last = [row.name for row in nodes.rows if row.observes]  # observers take no turn
        order = list(dict.fromkeys([*turns, *last]))
    table = Table("node", "takes", "gives, answers?", show_lines=True)
    for name in order:
        row = nodes.row(name)
        process = process_of.get(name, name)  # the collector is in none of the listed processes
        place = name if process == name else f"{name}\nin {process}"
        given = graph_views.gives(row, "\n", loaded)
        table.add_row(*map(Text, (place, graph_views.takes(row, "\n"), given)))
    shown = console(160)
    shown.print(fitting(table, shown.width))


def topics(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="Whose nodes, with their own topics as well."),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help=f"Measure the rates for {LIVE_S:g} s.")
    ] = False,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Show the table of keys: message, rate, who publishes, and what answers queries."""
    loaded: Any = graph_views.DEFAULTS if scenario is None else load(scenario, None)
    nodes = Graph(GRAPH) if scenario is None else graph_of(loaded)
    renamed = {} if scenario is None else loaded.of(loaded.names[0]).renamed
    topics = {topic.key: topic for topic in (*nodes.topics, *TOPICS)}.values()
    known = [replace(topic, key=renamed.get(topic.key, topic.key)) for topic in topics]
    rates: dict[str, Counter[str]] = defaultdict(Counter)
    """Number of samples by key, without the robot's name, and by robot."""

    def count(key: str, *_: object) -> None:
        robot, topic = resolve(key, known)
        if topic is not None:
            rates[topic.key][robot] += 1

    if live:
        with tool_bus(connect, namespace, tls) as bus:
            bus.subscribe_bytes("**", count)
            end = time.monotonic() + LIVE_S
            while (left := end - time.monotonic()) > 0:
                bus.spin_once(left)
    shown = console(200)
    names = ["message", "rate", "from", "meaning", *(["Hz now"] if live else [])]
    table = Table(Column("key", no_wrap=True), *(Column(name, overflow="fold") for name in names))

    def add(key: str, message: str, *others: str) -> None:
        if shown.width < WIDE:  # without their packages
            message = " → ".join(part.rpartition("/")[2] for part in message.split(" → "))
        table.add_row(*map(Text, (key, message, *others)))  # Text: a unit in brackets is not markup

    for key, message, rate, *others in graph_views.topic_rows(nodes, renamed):
        by_robot = sorted(rates[key].items()) or [("", 0)]
        now = "\n".join(f"{robot} {number / LIVE_S:.0f}".strip() for robot, number in by_robot)
        add(key, message, graph_views.in_hz(rate, loaded), *others, *([now] if live else []))
    table.add_section()
    for cells in graph_views.call_rows(nodes):
        add(*cells)
    shown.print(fitting(table, shown.width))


def echo(
    key: Annotated[str, typer.Argument(help="A key, or an expression such as 'target/**'.")],
    count: Annotated[
        int | None,
        typer.Option(min=1, help="End after so many samples.", show_default="until Ctrl-C"),
    ] = None,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Print the samples of a key as JSON, one a line, whatever encoding they came in.

    Examples: mecazen echo odom --count 1 · mecazen echo 'diagnostics/*'
    """
    shown = 0

    def show(key: str, payload: bytes, encoding: str, attachment: bytes | None) -> None:
        nonlocal shown
        del attachment
        try:
            text = msgspec.json.encode(_read(key, payload, encoding)).decode()
            typer.echo(printable(text))
        except (RefusedError, msgspec.MsgspecError) as error:
            problem = f"{key}: {len(payload)} bytes that are no message: {error}"
            typer.echo(printable(problem), err=True)
        shown += 1

    with _bus_for(key, connect, namespace, tls) as bus:
        bus.subscribe_bytes(key, show)
        if not bus.spin_once(SILENCE_S):
            _warn(f"{key}: no sample for {SILENCE_S:g} s: {absent(bus, key)}")
        while count is None or shown < count:
            bus.spin_once()


def pub(
    key: Annotated[str, typer.Argument(help="A key, e.g. cmd_vel.")],
    message: Annotated[
        str, typer.Argument(metavar="JSON", help='Its message, e.g. \'{"linear":{"x":0.2}}\'.')
    ],
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", min=0.01, max=1000, help="Repeat.", show_default="once"),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", min=0, help="Stop repeating.", show_default="until Ctrl-C"),
    ] = None,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Publish a message given in JSON, once or at a rate.

    Example: mecazen pub cmd_vel '{"linear":{"x":0.3}}' --rate 20 --duration 3
    """
    if includes(key, key) and "*" in key:
        raise ConfigError(f"{key}: an expression; a message goes to one key, such as cmd_vel")
    payload = message.encode()
    try:
        read = _read(key, payload, JSON_ENCODING)
        if (topic := topic_of(key)) is not None:
            refuse_implausible(topic.key, read)
    except (RefusedError, msgspec.MsgspecError) as error:
        raise ConfigError(f"{key}: {error}") from None
    if isinstance(read, Message):
        given = msgspec.json.decode(payload)
        for problem in unknown_fields(given.get(STAMPED.get(type(read)), given), read):
            _warn(f"{key}: {problem}")
    if duration is not None and rate is None:
        raise ConfigError("--duration needs --rate")
    with _bus_for(key, connect, namespace, tls) as bus:
        _warn(ignored(bus, key))
        begin, sent = time.monotonic(), 0
        while True:
            bus.put_bytes(key, payload, JSON_ENCODING)
            sent += 1
            if rate is None or (duration is not None and sent >= duration * rate):
                break
            while (left := begin + sent / rate - time.monotonic()) > 0:
                bus.spin_once(left)


@contextmanager
def _bus_for(key: str, connect: Connect, namespace: Namespace, tls: Tls) -> Iterator[ZenohBus]:
    """Open the bus; warn of a key that neither mecazen nor the running scenario names."""
    warning = mistake(key)
    with ExitStack() as stack:
        try:
            bus = stack.enter_context(tool_bus(connect, namespace, tls))
        except MecazenError:
            _warn(warning)
            raise
        _warn(unknown_to(bus, key, warning))
        yield bus


def _read(key: str, payload: bytes, encoding: str) -> Any:
    """Decode a payload: a message if the table has the key, else any JSON."""
    topic = topic_of(key)
    return msgspec.json.decode(payload) if topic is None else decode(payload, topic.type, encoding)


def _warn(told: str | None) -> None:
    """Print a warning, if there is one, on standard error."""
    if told is not None:
        typer.echo(f"warning: {told}", err=True)
