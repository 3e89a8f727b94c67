"""`mecazen new` and `mecazen scenarios`: small files that run, and what can be run."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from typing import Annotated, Literal

import typer
from mecazen.errors import ConfigError
from mecazen.loading import scenario_path
from rich.table import Column, Table
from rich.text import Text
from typer import Argument

from mecazen_tools import files
from mecazen_tools.cli.options import console

TEMPLATES = Path(__file__).parents[1] / "templates"
"""Folder of the templates: examples/new in a clone."""
WIDTH = 100


Kind = Literal["follower", "sensor", "robot", "process", "study"]
"""The kinds of files that `mecazen new` writes."""
COMMANDS: dict[Kind, tuple[str, ...]] = {
    "follower": (
        "mecazen up back --set programs.follower={file}:{type}",
        "mecazen compare back {file}:{type} default",
    ),
    "sensor": ("mecazen simulate back --set programs.{name}={file}:{type} --record {name}.mcap",),
    "robot": ("mecazen simulate back --set robot={file}",),
    "process": ("mecazen up back --without follower", "python {file}"),
    "study": ("mecazen experiment run {file}",),
}
"""The commands that use each file."""


def new(
    kind: Annotated[Kind, Argument(help="The kind of file.")],
    name: Annotated[str, Argument(help="Its name, such as lead or my_robot.")],
) -> None:
    """Write a small working file to start from: a follower, sensor, robot, process or study.

    Examples: mecazen new follower my_follower · mecazen new study gains
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise ConfigError(f"{name!r}: a name has small letters, digits and _, such as my_{kind}")
    (template,) = TEMPLATES.glob(f"my_{kind}.*")
    file = Path(f"{name}{template.suffix}")
    if file.exists():
        raise ConfigError(f"{file}: exists already, and is not overwritten")
    pascal = name.title().replace("_", "")
    text = template.read_text().replace(f"my_{kind}", name).replace(f"My{kind.title()}", pascal)
    files.write(file, text.encode())
    typer.echo(f"{file}: written; next:")
    for command in COMMANDS[kind]:
        typer.echo(f"  {command.format(name=name, file=file, type=pascal)}")


def scenarios() -> None:
    """List the named scenarios, and what happens in each.

    Example: mecazen scenarios
    """
    table = Table(Column("scenario", no_wrap=True), "what happens")
    for file in sorted(scenario_path("back").parent.glob("*.toml")):
        (comment,) = re.findall(r"\A((?:#.*\n)*)", file.read_text())
        words = " ".join(line.lstrip("# ") for line in comment.splitlines())
        sentence = re.split(r"(?<=\.) ", words)[0]
        table.add_row(*map(Text, (file.stem, sentence)))
    console(WIDTH).print(table)
