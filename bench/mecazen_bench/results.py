"""The results of a run of the bench, the file that keeps them, and docs/performance.md.

A block of the document that is generated from results begins with `<!-- bench: NAME -->` and ends
with `<!-- /bench -->`. NAME is a benchmark or `machine`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
from mecazen.errors import MecazenError
from mecazen_tools import files
from rich.table import Table

from mecazen_bench.figures import Group
from mecazen_bench.machine import Machine, OtherLoad

FOLDER = Path(__file__).parents[1] / "results"
DOCUMENT = FOLDER.parents[1] / "docs" / "performance.md"
MACHINE = "intel-xeon-processor-2-cores"
"""The machine whose results are in the document."""
BLOCK = re.compile(r"(<!-- bench: (\S+) -->\n).*?(<!-- /bench -->)", re.DOTALL)
SCHEMA = 2
"""Raised when older files no longer mean the same."""


class ResultsError(MecazenError):
    """A results file that can't be used; exit code 1 means that a figure became worse."""

    exit_code = 2


class Measured(msgspec.Struct, frozen=True):
    """The results of one benchmark."""

    seconds: float
    """How long it was measured."""
    groups: tuple[Group, ...]


class Results(msgspec.Struct, frozen=True):
    """All figures of a run."""

    schema: int
    machine: Machine
    others: OtherLoad
    benchmarks: dict[str, Measured]

    @property
    def groups(self) -> list[Group]:
        return [group for measured in self.benchmarks.values() for group in measured.groups]

    def table(self) -> Table:
        """Return one table of all figures, a line for each."""
        table = Table("", "", "median", "quartiles", "target")
        for group in self.groups:
            table.add_section()
            table.add_row(f"[bold]{group.title}[/]")
            for row in group.rows:
                subject = row.subject
                for title, figure in row.figures.items():
                    colour = {True: "green", False: "red", None: "default"}[figure.met]
                    value, quartiles, target = figure.texts()
                    table.add_row(subject, title, value, quartiles, f"[{colour}]{target}[/]")
                    subject = ""
        return table

    def context(self) -> str:
        """Return what the figures depend on, in two lines."""
        return f"{self.machine};\n{self.others}."


def default_path(machine: str, only: Sequence[str], folder: Path = FOLDER) -> Path:
    """Return the file for the default benchmarks, or for some of them."""
    return folder / f"{'-'.join([machine, *only])}.json"


def write(results: Results, path: Path) -> None:
    """Write the file, and create its folder.

    Raises:
        ResultsError: It can't be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultsError(f"{path.parent}: {error.strerror}") from None
    files.write(path, msgspec.json.format(msgspec.json.encode(results)) + b"\n")


def read(path: Path) -> Results:
    """Return what `write` has written.

    Raises:
        ResultsError: There is no such file, or its content is something else.
    """
    try:
        content = path.read_bytes()
        found = msgspec.json.decode(content, type=dict[str, msgspec.Raw]).get("schema", b"null")
        schema = msgspec.json.decode(found, type=int)
        if schema != SCHEMA:
            raise ResultsError(f"{path}: schema {schema} instead of {SCHEMA}: measure again")
        return msgspec.json.decode(content, type=Results)
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: no results of mecazen bench: {error}") from error


def updated(document: str, folder: Path = FOLDER) -> str:
    """Return a document with its blocks generated anew from the results in `folder`.

    Raises:
        ResultsError: A results file can't be used.
    """
    return BLOCK.sub(lambda found: f"{found[1]}{_block(found[2], folder)}{found[3]}", document)


def _block(name: str, folder: Path) -> str:
    main = read(default_path(MACHINE, [], folder))
    if name == "machine":
        return f"{main.context()}\n"
    # a benchmark by itself may be of another machine, which its table names
    own = sorted(folder.glob(f"*-{name}.json"))
    results = read(own[0]) if own else main
    if name not in results.benchmarks:
        return f"Not measured yet: `mecazen bench run --only {name}`.\n"
    tables = [group.markdown() for group in results.benchmarks[name].groups]
    if results is not main:
        tables.append(f"{results.context()}\n")
    return "\n".join(tables)
