"""Result files of stages, and their tables and figures in documents.

A stage of results/stages.toml is a command of `mecazen` that writes JSON. Its result file is
results/STAGE.json. A document shows the stage's tables between `<!-- results: STAGE -->` and `<!--
/results -->`, or the table with a title: `<!-- results: STAGE TITLE -->`. With `csv` instead of
`results` the document links to files in docs/tables. Tables and pictures of other origin have a
line `<!-- by hand: REASON -->` before them.
"""

from __future__ import annotations

import ast
import csv
import hashlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
from mecazen_experiments.jobs import PACKAGES
from mecazen_tools import files

from mecazen_bench.harness import MarkdownTable, ResultsError, machine

ROOT = Path(__file__).parents[2]
RUNS = "experiments"
"""The input that stands for all packages that a run loads."""
TABLES = "docs/tables"
"""The folder of the tables that documents link to; it contains no other files."""
BLOCK = re.compile(
    r"(?P<begin><!-- (?P<form>results|csv): (?P<stage>\S+)(?: (?P<title>[^\n]+))? -->\n)"
    r"(?P<shown>.*?)(?P<end><!-- /(?P=form) -->)",
    re.DOTALL,
)
GRAPH = re.compile(r"<!-- graph: \w+ -->\n.*?<!-- /graph -->", re.DOTALL)
FENCE = re.compile(r"^ *```.*?^ *```", re.DOTALL | re.MULTILINE)
BY_HAND = re.compile(r"<!-- by hand: \S.* -->")
DELIMITER = re.compile(r"\|( *:?-+:? *\|)+")
PICTURE = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")


class Stage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A command whose result is shown in documents."""

    command: str
    """The words after `mecazen`. The command has the option --json, and --figures if there are
    figures. $NAME is a variable of the environment."""
    inputs: tuple[str, ...]
    """Files and folders that the result depends on; `experiments` stands for what a run loads."""
    figures: tuple[str, ...] = ()


class Result(msgspec.Struct, frozen=True):
    """The result of a stage, with its machine and version."""

    version: str
    commit: str
    date: str
    machine: str
    command: str
    seeds: tuple[int, ...]
    inputs: str
    """The hash of the stage's inputs; empty if they are not known."""
    figures: dict[str, str]
    """Drawn files, and their hashes."""
    tables: tuple[MarkdownTable, ...]

    @property
    def origin(self) -> str:
        """The origin of the tables, as text."""
        seeds = f", {_ranges(self.seeds)}" if self.seeds else ""
        return f"Commit {self.commit} of version {self.version}, {self.date}{seeds}: {self.machine}"


def stages(root: Path) -> dict[str, Stage]:
    """Return the stages by name."""
    path = root / "results" / "stages.toml"
    try:
        return msgspec.convert(tomllib.loads(path.read_text()), dict[str, Stage])
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise ResultsError(f"{path}: {error}") from None


def find(name: str, root: Path) -> Result | None:
    """Return the result of a stage, if it has one."""
    path = root / "results" / f"{name}.json"
    try:
        return msgspec.json.decode(path.read_bytes(), type=Result)
    except FileNotFoundError:
        return None
    except msgspec.MsgspecError as error:
        raise ResultsError(f"{path}: {error}") from None


def inputs_sha256(stage: Stage, root: Path) -> str:
    """Return the hash of all files that the result of a stage depends on."""
    found = set()
    for name in stage.inputs:
        if name == RUNS:
            patterns = (f"{above}/{name}" for above in ("*", "services/*") for name in PACKAGES)
            found |= {folder for pattern in patterns for folder in root.glob(pattern)}
        elif (path := root / name).exists():
            found.add(path)
        else:
            raise ResultsError(f"results/stages.toml: {name}: no such input")
    return files.sha256_of(root, found, _content)


def _content(file: Path) -> bytes:
    return _code(file.read_text()).encode() if file.suffix == ".py" else file.read_bytes()


@cache  # stages share most of their inputs
def _code(text: str) -> str:
    """Return Python code without docstrings, comments and blank lines: they change no result."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    statements = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr)]
    for node in statements:
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            for row in range(node.lineno, (node.end_lineno or 0) + 1):
                lines[row - 1] = ""
    return "\n".join(line.rstrip() for line in lines if line.strip())


def run(
    root: Path, only: Collection[str], options: Mapping[str, str], report: Callable[[str], object]
) -> None:
    """Run the stages that are not up to date; write their results, figures and tables.

    Args:
        root: The folder of the project.
        only: Names of the stages; all stages if empty.
        options: Options for commands of `mecazen experiment`, by name.
        report: Called with a line on the progress of each stage.
    """
    known = stages(root)
    if unknown := sorted(set(only) - set(known)):
        raise ResultsError(f"{unknown[0]}: no such stage; there are {', '.join(known)}")
    failed = []
    for name, stage in known.items():
        if only and name not in only:
            continue
        inputs, result = inputs_sha256(stage, root), find(name, root)
        if result is not None and (result.inputs, result.command) == (inputs, stage.command):
            report(f"{name}: up to date")
            continue
        report(f"{name}: mecazen {stage.command}")
        try:
            _run(root, name, stage, inputs, options)
        except ResultsError as error:
            failed.append(name)
            report(str(error))
            continue
        write_tables(root)
    if failed:
        raise ResultsError(f"no result of {', '.join(failed)}")


def _run(root: Path, name: str, stage: Stage, inputs: str, options: Mapping[str, str]) -> None:
    try:
        words = [Template(word).substitute(os.environ) for word in shlex.split(stage.command)]
    except KeyError as missing:
        raise ResultsError(f"{name}: needs {missing.args[0]} in the environment") from None
    if words[0] == "experiment":
        words += [word for option in options.items() for word in option]
    with TemporaryDirectory() as folder:
        made = Path(folder, "out.json")
        words += ["--json", str(made), *(["--figures", folder] if stage.figures else ())]
        commit = _commit(stage, root)
        done = subprocess.run(
            [sys.executable, "-m", "mecazen_tools", *words], check=False, cwd=root
        )
        if done.returncode or not made.exists():
            raise ResultsError(f"{name}: the command ended with {done.returncode}")
        measured = msgspec.json.decode(made.read_bytes())
        for figure in stage.figures:
            shutil.copy(Path(folder, Path(figure).name), root / figure)
    header = {
        "version": version("mecazen"),
        "commit": commit,
        "date": datetime.now(UTC).date().isoformat(),
        "machine": measured.pop("context", None) or f"{machine()}.",
        "command": stage.command,
        "inputs": inputs,
        "seeds": _seeds(measured),
        "figures": {figure: _sha256(root / figure) for figure in stage.figures},
    }
    content = msgspec.json.format(msgspec.json.encode(header | measured))
    files.write(root / "results" / f"{name}.json", content + b"\n")


def _seeds(measured: Mapping[str, Any]) -> list[int]:
    """Return the seeds of an experiment's runs, and remove the runs from its rows."""
    runs = [run for row in measured.get("rows", ()) for run in row.pop("runs", ())]
    return sorted({run["record"]["key"]["seed"] for run in runs})


def write_tables(root: Path) -> None:
    """Write the tables of all documents, and those that they link to, from the result files."""
    for path in documents(root):
        text = path.read_text()
        if (new := updated(text, root)) != text:
            files.write(path, new.encode())
    linked = linked_tables(root)
    (root / TABLES).mkdir(exist_ok=True)
    for path in set((root / TABLES).iterdir()) - set(linked):
        path.unlink()
    for path, content in linked.items():
        files.write(path, content)


def linked_tables(root: Path) -> dict[Path, bytes]:
    """Return the tables in CSV that the documents link to."""
    return {
        root / TABLES / _file_name(block["stage"], table): _csv(table)
        for path in documents(root)
        for block in BLOCK.finditer(path.read_text())
        if block["form"] == "csv" and (result := find(block["stage"], root)) is not None
        for table in _tables(result, block)
    }


def documents(root: Path) -> list[Path]:
    """Return the documents that show results."""
    return [*sorted((root / "docs").glob("*.md")), root / "README.md"]


def updated(text: str, root: Path) -> str:
    """Return a document with the tables of the result files; other tables are kept."""

    def block(found: re.Match[str]) -> str:
        result = find(found["stage"], root)
        shown = found["shown"] if result is None else _shown(result, found)
        return f"{found['begin']}{shown}{found['end']}"

    return BLOCK.sub(block, text)


def _shown(result: Result, block: re.Match[str]) -> str:
    tables = _tables(result, block)
    if block["form"] == "results":
        shown = "\n".join(map(str, tables))
    else:
        folder = Path(TABLES).name
        shown = "".join(
            f"- [{table.title or block['stage']}]({folder}/{_file_name(block['stage'], table)}), "
            f"{len(table.rows)} rows. {table.sentences}\n"
            for table in tables
        )
    return f"{shown}\n{result.origin}\n"


def _tables(result: Result, block: re.Match[str]) -> list[MarkdownTable]:
    """Return the tables that a block shows."""
    tables = [table for table in result.tables if block["title"] in (None, table.title)]
    if not tables:
        titles = ", ".join(table.title for table in result.tables)
        raise ResultsError(f"{block['stage']}: no table {block['title']!r}; there are {titles}")
    return tables


def _csv(table: MarkdownTable) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((table.head, *table.rows))
    return text.getvalue().encode()


def _file_name(stage: str, table: MarkdownTable) -> str:
    return f"{re.sub(r'[^a-z0-9]+', '-', f'{stage} {table.title}'.lower()).strip('-')}.csv"


def problems(root: Path) -> Iterator[str]:
    """Yield each table and picture of the documents that does not match its origin."""
    known, shown = stages(root), set()
    for path in documents(root):
        text, name = path.read_text(), path.relative_to(root)
        shown |= {found["stage"] for found in BLOCK.finditer(text)}
        if updated(text, root) != text:
            yield f"{name}: a table differs from its result file; `mecazen bench tables` writes it"
        drawn = {
            root / figure: sha256
            for stage in known
            if (result := find(stage, root)) is not None
            for figure, sha256 in result.figures.items()
        }

        def blank(found: re.Match[str]) -> str:
            keep = found.re is BLOCK and find(found["stage"], root) is None
            return found[0] if keep else "\n" * found[0].count("\n")

        for pattern in (FENCE, BLOCK, GRAPH):
            text = pattern.sub(blank, text)
        lines = ["", "", *text.splitlines()]
        for number, line in enumerate(lines[2:], 1):
            marked = BY_HAND.fullmatch(lines[number])
            if DELIMITER.fullmatch(line) and not BY_HAND.fullmatch(lines[number - 1]):
                yield f"{name}:{number - 1}: this table needs a line <!-- by hand: REASON -->"
            for picture in PICTURE.findall(line):
                file = (path.parent / picture).resolve()
                if file in drawn and drawn[file] != _sha256(file):
                    yield f"{name}:{number}: {picture} is not the figure of its result file"
                elif file not in drawn and not marked:
                    yield f"{name}:{number}: this picture needs a line <!-- by hand: REASON -->"
    linked = linked_tables(root)
    there = {path: path.read_bytes() for path in (root / TABLES).glob("*")}
    for path in sorted(path for path in {*linked, *there} if linked.get(path) != there.get(path)):
        yield f"{path.relative_to(root)}: not of a result; `mecazen bench tables` writes it"
    for stage in sorted(set(known) ^ shown):
        where = "is shown nowhere" if stage in known else "is not in results/stages.toml"
        yield f"stage {stage} {where}"


def stale(root: Path) -> Iterator[str]:
    """Yield each stage whose result is missing, or older than the last change of its inputs."""
    for name, stage in stages(root).items():
        result = find(name, root)
        if result is None:
            yield f"{name}: has no result yet"
        elif (result.inputs, result.command) != (inputs_sha256(stage, root), stage.command):
            yield f"{name}: inputs have changed since commit {result.commit}"


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _commit(stage: Stage, root: Path) -> str:
    """Return the present commit, with a + if an input of the stage has uncommitted changes."""

    def git(*words: str) -> str:
        called = ["git", *words]
        done = subprocess.run(called, check=False, cwd=root, capture_output=True, text=True)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--", *stage.inputs)
    return f"{git('rev-parse', '--short', 'HEAD') or 'unknown'}{'+' if changed else ''}"


def _ranges(seeds: Sequence[int]) -> str:
    if len(seeds) == 1:
        return f"seed {seeds[0]}"
    return f"seeds {seeds[0]} to {seeds[-1]}"
