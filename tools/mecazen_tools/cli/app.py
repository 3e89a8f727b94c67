"""The commands of `mecazen`, and the options of all that connect to a simulation."""

from __future__ import annotations

import errno
import sys
from importlib import import_module, metadata
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from mecazen.config import BusConfig, Process
from mecazen.config.bus import ROUTER, SECURE_ROUTER
from mecazen.errors import ConfigError, MecazenError, is_installed
from mecazen.loading import to_toml
from mecazen.runtime import process
from mecazen.schema import Folder
from mecazen.text import printable
from typer import Argument, Option

from mecazen_tools.cli import graph, new, sim, simulate, status, talk, teleop, up
from mecazen_tools.cli.options import ScenarioArgument, Settings, load, warn

COMMANDS = (
    *(up.up, simulate.simulate, simulate.collect, simulate.compare, graph.graph, graph.topics),
    *(new.new, new.scenarios),
    *(status.status, talk.echo, talk.pub, teleop.teleop),
)
EXTRAS = {
    "hardware": {"hardware": "mecazen_tools.cli.hardware:app"},
    "recorder": {
        "record": "mecazen_tools.cli.recording:record",
        "replay": "mecazen_tools.cli.recording:replay",
        "info": "mecazen_tools.cli.recording:info",
        "score": "mecazen_tools.cli.recording:score",
        "plot": "mecazen_tools.cli.recording:plot",
    },
    "robots": {"robot": "mecazen_tools.cli.robot:app"},
    "target": {"people": "mecazen_tools.cli.people:app"},
    "viewer": {"view": "mecazen_tools.cli.view:view"},
    "studies": {
        "experiment": "mecazen_experiments.cli:app",
        "identify": "mecazen_experiments.identify.cli:identify",
        "gait": "mecazen_experiments.gait.cli:gait",
    },
    "bench": {"bench": "mecazen_bench.cli:app"},
}
"""Commands of extras: a function or a group of commands, by extra and by name."""
CONNECTED = "topics, status, echo, pub, teleop, sim, param, world, record, replay"
"""Commands that connect to a simulation."""
CONNECTION = ("--connect", "--namespace", "--tls")
"""Their options, which come before the command."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk."""

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="mecazen simulates a mecanum robot with all rollers, which follows a person. Services "
    "over Zenoh give the same result as one process."
    "\n\nStart with [bold]mecazen up back[/], or [bold]mecazen simulate back[/]; "
    "[bold]mecazen scenarios[/] lists all scenarios.",
)
certificates_app = typer.Typer(
    no_args_is_help=True, help="Certificates, for TLS and access control."
)
for command in COMMANDS:
    app.command()(command)
app.add_typer(sim.app, name="sim")
app.add_typer(sim.param_app, name="param")
app.add_typer(sim.world_app, name="world")
app.add_typer(certificates_app, name="keys")
for extra in filter(is_installed, EXTRAS):
    for name, place in EXTRAS[extra].items():
        module, _, attribute = place.partition(":")
        command = getattr(import_module(module), attribute)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mecazen {metadata.version('mecazen')}")
        raise typer.Exit


@app.callback()
def connect_to(
    context: typer.Context,
    connect: Annotated[
        str | None,
        Option(
            metavar="ENDPOINT",
            help="The Zenoh router to connect to.",
            show_default=f"{ROUTER}, or {SECURE_ROUTER} with --tls",
        ),
    ] = None,
    namespace: Annotated[str | None, Option(help="The robot's Zenoh namespace.")] = None,
    tls: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Connect by TLS as the operator, with a folder of `mecazen keys create`.",
        ),
    ] = None,
    version: Annotated[
        bool, Option("--version", help="Print the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Keep where the command finds a simulation; the help of `mecazen` is the application's."""
    settings = {
        "connect": None if connect is None else [connect],
        "namespace": namespace,
        "keys": None if tls is None else Folder(tls),
    }
    if any(settings.values()) and context.invoked_subcommand not in CONNECTED.split(", "):
        raise ConfigError(
            f"{', '.join(CONNECTION)} are for {CONNECTED}; scenarios have settings instead, as in "
            "--set bus.namespace=lab"
        )
    try:
        context.obj = msgspec.convert(settings, BusConfig)
    except msgspec.ValidationError as error:
        raise ConfigError(f"--namespace {namespace}: {error}") from None


@app.command()
def run(
    service: Annotated[
        str,
        Argument(
            help="A service of the scenario (physics, controller, …), several joined by +, "
            "or router."
        ),
    ],
    scenario: ScenarioArgument,
    robot: Annotated[str, Option(metavar="NAME", help="The robot, if there are several.")] = "",
    settings: Settings = None,
) -> None:
    """Run one process in this terminal, until Ctrl-C.

    Examples: mecazen run router back · mecazen run physics back ·
    mecazen run controller+follower back
    """
    loaded, services = load(scenario, settings), tuple(service.split("+"))
    if "follower" in services:
        warn(loaded)
    process.run(Process(services, robot), loaded)


@app.command()
def config(scenario: ScenarioArgument, settings: Settings = None) -> None:
    """Print the whole effective configuration of a scenario, as TOML that can be loaded."""
    typer.echo(to_toml(load(scenario, settings)), nl=False)


@certificates_app.command()
def create(
    folder: Annotated[Path, Argument(metavar="DIR", help="A new folder; keep it secret.")] = Path(
        "keys"
    ),
    host: Annotated[
        list[str] | None,
        Option(
            metavar="NAME_OR_IP",
            help="A host that services listen on, besides loopback. Repeatable.",
        ),
    ] = None,
) -> None:
    """Create a certificate authority, and a certificate and a key for each service.

    Tools use the operator's certificate and key: `mecazen --tls DIR`.

    Examples: mecazen keys create · mecazen keys create keys --host robot.local --host 192.168.1.7
    """
    try:
        from mecazen_tools import certificates  # noqa: PLC0415  # an extra
    except ImportError:
        install = "pip install 'mecazen[keys]'"
        raise MecazenError(f"keys need the library cryptography: {install}") from None
    certificates.create(folder, host or ())
    typer.echo(f"{folder}: the authority and {len(certificates.NAMES)} certificates with keys")


def main(commands: typer.Typer = app) -> None:
    """Run a command line; print an expected error in one line."""
    arguments = sys.argv[1:]
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    try:
        for argument in arguments:
            if argument != argument.encode(errors="replace").decode():
                raise ConfigError(f"{argument!r}: not UTF-8, as all arguments must be")
        sys.exit(commands(arguments, standalone_mode=False))
    except typer.TyperException as error:
        sys.stderr.write(_usage_error(error))
        sys.exit(error.exit_code)
    except MecazenError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(error.exit_code)
    except typer.Abort:  # a question without a yes
        sys.stderr.write("error: not confirmed\n")
        sys.exit(1)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        sys.stderr.write(f"error: the output is incomplete: {error.strerror}\n")
        sys.exit(1)


def _usage_error(error: typer.TyperException) -> str:
    """Return the error of a command line in one line; empty if help was shown."""
    problem = printable(error.format_message().strip()).rstrip(".")
    if not problem:
        return ""
    context = getattr(error, "ctx", None)  # set for an error in the usage of a command
    hint = f"`{context.command_path} --help` tells what is allowed" if context else ""
    if context and context.command_path.endswith(" run") and problem.startswith("Missing"):
        hint = "`run` starts one process, as in `mecazen run physics back`; `mecazen up back` "
        hint += "and `mecazen simulate back` start all of them"
    for option in CONNECTION:
        if problem.startswith(f"No such option: {option}"):
            problem = f"No such option: {option}"
            hint = f"it comes before the command, as in `mecazen {option} … status`"
    for extra, names in EXTRAS.items():
        for name in names:
            if problem.startswith(f"No such command '{name}'"):
                problem = f"No such command '{name}'"
                hint = f"it needs pip install 'mecazen[{extra}]'"
    mark = " " if problem.endswith("?") else "; "
    return f"error: {problem}{mark + hint if hint else ''}\n"
