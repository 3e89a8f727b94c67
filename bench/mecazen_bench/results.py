"""What a run of the bench has found, and the file that keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from mecazen.errors import MecazenError
from rich.table import Table

from mecazen_bench.figures import Group
from mecazen_bench.machine import Machine, OtherWork

FOLDER = Path(__file__).parents[1] / "results"
SCHEMA = 1
"""Raised when files of before no longer say the same."""


class ResultsError(MecazenError):
    """A file of results that can't be used; the exit code 1 says that something became worse."""

    exit_code = 2


class Results(msgspec.Struct, frozen=True):
    """All figures of a run."""

    schema: int
    machine: Machine
    others: OtherWork
    seconds: dict[str, float]
    """How long each part was measured."""
    groups: tuple[Group, ...]

    def table(self) -> Table:
        """Return one table of all figures, a line for each."""
        table = Table("", "", "median", "quartiles", "target")
        for group in self.groups:
            table.add_section()
            table.add_row(f"[bold]{group.title}[/]")
            for row in group.rows:
                for number, (title, figure) in enumerate(row.figures.items()):
                    colour = {True: "green", False: "red", None: "default"}[figure.met]
                    value, quartiles, target = figure.texts()
                    subject = row.subject if number == 0 else ""
                    table.add_row(subject, title, value, quartiles, f"[{colour}]{target}[/]")
        return table

    def text(self) -> str:
        """Return what the figures depend on, in two lines."""
        return f"{self.machine.text()};\n{self.others.text()}."

    def markdown(self) -> str:
        """Return the figures as tables of a document."""
        return "\n".join([f"{self.text()}\n", *(group.markdown() for group in self.groups)])


def default_path(machine: Machine, only: Sequence[str]) -> Path:
    """Return where figures of the whole bench, or of some parts alone, are kept."""
    return FOLDER / f"{'-'.join([machine.name, *only])}.json"


def write(results: Results, path: Path) -> None:
    """Write the file, and its folder where there is none.

    Raises:
        ResultsError: It can't be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(msgspec.json.format(msgspec.json.encode(results)) + b"\n")
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror}") from error


def read(path: Path) -> Results:
    """Return what `write` has written.

    Raises:
        ResultsError: There is no such file, or it holds something else.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror}") from error
    try:
        schema = msgspec.json.decode(content, type=dict[str, msgspec.Raw])["schema"]
        found = msgspec.json.decode(schema, type=int)
    except (msgspec.MsgspecError, KeyError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: no results of mecazen bench") from error
    if found != SCHEMA:
        raise ResultsError(f"{path}: results of schema {found}, not of {SCHEMA}: measure again")
    try:
        return msgspec.json.decode(content, type=Results)
    except msgspec.MsgspecError as error:
        raise ResultsError(f"{path}: no results of mecazen bench: {error}") from error
