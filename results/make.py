"""Makes the results that documents show: `make results`, `make results-check`.

A stage of stages.toml is a command of `mecazen` that writes results/STAGE.csv, or results/STAGE/ if
it identifies a robot. A document shows its tables between `<!-- results: STAGE -->`, or
`<!-- results: STAGE TITLE -->` for one of them, and `<!-- /results -->`; and a cell of a table in a
sentence between `<!-- cell: STAGE; TITLE; ROW; COLUMN -->`, where ROW is how the row begins, and
`<!-- /cell -->`. Any other table or picture needs a line `<!-- by hand: REASON -->` before it.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Any

import tomli_w
from mecazen.errors import MecazenError
from mecazen.files import read_text, read_toml
from mecazen_bench import harness
from mecazen_experiments import commands, frame, tables
from mecazen_experiments.cli import app
from mecazen_experiments.study import load_study
from mecazen_experiments.versions import version
from typer.main import get_command

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(
    r"(<!-- results: (?P<stage>\S+)(?: (?P<title>[^\n]+))? -->\n)(?P<text>.*?)(<!-- /results -->)",
    re.DOTALL,
)
CELL = re.compile(r"(<!-- cell: ([^;>]+);([^;>]*); ([^;>]+); ([^;>]+) -->)[^<]*(<!-- /cell -->)")
IGNORED = re.compile(r"^ *```.*?^ *```|<!-- graph: \w+ -->\n.*?<!-- /graph -->", re.DOTALL | re.M)
DELIMITER, PICTURE = re.compile(r"\|( *:?-+:? *\|)+"), re.compile(r"!\[[^\]]*\]\(([^)]+)\)")
BY_HAND = re.compile(r"<!-- by hand: \S.* -->")


class Results:
    """The stages, the origins of their results, and the documents of a project."""

    def __init__(self, root: Path) -> None:
        self.root, self.folder = root, root / "results"
        self.stages: dict[str, Any] = read_toml(self.folder / "stages.toml")
        self.origins: dict[str, Any] = read_toml(self.folder / "origins.toml")
        self.documents = [*sorted((root / "docs").glob("*.md")), root / "README.md"]
        self._made: dict[str, dict[str, str]] = {}

    def words(self, stage: str) -> list[str]:
        """Return the words of a stage's command, with variables of the environment."""
        command: str = self.stages[stage]["command"]
        return [Template(word).substitute(os.environ) for word in shlex.split(command)]

    def key(self, stage: str) -> str:
        """Return a hash of all that the result of a stage depends on: code, data, configuration."""
        group, _, *words = self.words(stage)
        if group == "bench":
            return version(f"mecazen_bench.{stage.removeprefix('bench-')}")[:16]
        if group == "identify":
            files = sorted(file for file in Path(words[-1]).rglob("*") if file.is_file())
            code = version("mecazen_experiments.identify.validate")
            return sha256("".join([code, *(sha256(f.read_bytes()) for f in files)]).encode())
        options = get_command(app).make_context("run", words).params
        names = "study", "seeds", "walks", "settings", "sweep", "only"
        _, jobs = commands.plan(*(options[name] for name in names))
        return sha256(" ".join(sorted(job.key for job in jobs)).encode())

    def made(self, stage: str) -> dict[str, str]:
        """Return the tables of a stage in Markdown, by title."""
        if stage not in self._made:
            self._made[stage] = self._make(stage)
        return self._made[stage]

    def _make(self, stage: str) -> dict[str, str]:
        file = self.folder / f"{stage}.csv"
        group, _, name, *_ = shlex.split(self.stages[stage]["command"])
        if group == "identify":
            report = read_text(self.folder / stage / "validation.md")
            return {"": report[report.index("|") :]}
        if group == "bench":
            return harness.tables(harness.read(file))
        study = load_study(name)
        runs = frame.read(study, read_text(file))
        return {table.title: tables.markdown(table) for table in tables.make_tables(study, runs)}

    def is_made(self, stage: str) -> bool:
        """Whether a stage has a result."""
        return (self.folder / f"{stage}.csv").exists() or (self.folder / stage).exists()

    def table(self, stage: str, title: str) -> str:
        """Return a table of a stage in Markdown.

        Raises:
            MecazenError: The stage has no such table.
        """
        made = self.made(stage)
        if title not in made:
            raise MecazenError(f"{stage}: no table {title!r}; there are {', '.join(made)}")
        return made[title]

    def cell(self, stage: str, title: str, row: str, column: str) -> str:
        """Return a cell of a table, without its limit.

        Raises:
            MecazenError: The stage has no such table, row or column, or several such rows.
        """
        lines = [line for line in self.table(stage, title).splitlines() if line.startswith("|")]
        head, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
        selected = [cells for cells in rows if " ".join(cells).lstrip().startswith(f"{row} ")]
        if len(selected) != 1 or column not in head:
            raise MecazenError(f"{stage}, {title}: {row!r}, {column!r} is not one cell")
        return selected[0][head.index(column)].partition(" ≤ ")[0]

    def updated(self, text: str) -> str:
        """Return a document with the tables and cells of the results."""

        def block(match: re.Match[str]) -> str:
            stage, title = match["stage"], match["title"]
            if stage not in self.stages or not self.is_made(stage):
                return match[0]
            made = self.made(stage).values() if title is None else [self.table(stage, title)]
            text = "\n".join(made)
            origin = self.origins[stage]
            source = f"Commit {origin['commit']}, {origin['date']}: {origin['machine']}"
            return f"{match[1]}{text}\n{source}\n{match[5]}"

        def cell(match: re.Match[str]) -> str:
            return f"{match[1]}{self.cell(*map(str.strip, match.group(2, 3, 4, 5)))}{match[6]}"

        return CELL.sub(cell, BLOCK.sub(block, text))

    def problems(self) -> Iterator[str]:
        """Yield each table and picture of the documents that does not match its origin."""
        drawn = {f: sha for o in self.origins.values() for f, sha in o.get("figures", {}).items()}
        shown: set[str] = set()
        for path in self.documents:
            text, name = path.read_text(), path.relative_to(self.root)
            for match in BLOCK.finditer(IGNORED.sub("", text)):
                shown.add(match["stage"])
            if self.updated(text) != text:
                yield f"{name}: a table or cell is not that of its result; `make results` writes it"
            for pattern in (IGNORED, BLOCK):
                text = pattern.sub(lambda match: "\n" * match[0].count("\n"), text)
            lines = ["", "", *text.splitlines()]
            for number, line in enumerate(lines[2:], 1):
                if DELIMITER.fullmatch(line) and not BY_HAND.fullmatch(lines[number - 1]):
                    yield f"{name}:{number - 1}: this table needs a line <!-- by hand: REASON -->"
                for picture in PICTURE.findall(line):
                    file = str((path.parent / picture).resolve().relative_to(self.root))
                    if drawn.get(file, _drawn(self.root / file)) != _drawn(self.root / file):
                        yield f"{name}:{number}: {picture} is not the figure of its result"
                    if file not in drawn and not BY_HAND.fullmatch(lines[number]):
                        yield f"{name}:{number}: this picture needs <!-- by hand: REASON -->"
        for stage in sorted({*self.stages} ^ shown):
            yield f"stage {stage} is {'shown nowhere' if stage in self.stages else 'not in stages'}"

    def stale(self, stage: str) -> str:
        """Return why the result of a stage is not that of this code; empty if it is."""
        if not self.is_made(stage):
            return "no result yet"
        try:
            key = self.key(stage)
        except KeyError as missing:
            return f"not known without {missing.args[0]} in the environment"
        origin = self.origins[stage]
        same = origin.get("key") == key
        return "" if same else f"inputs have changed since commit {origin['commit']}"

    def run(self, stage: str, more: list[str]) -> None:
        """Run a stage; write its result, its origin and the documents."""
        words, key = self.words(stage), self.key(stage)
        if words[0] == "identify":
            words += ["--out", f"results/{stage}"]
        else:
            words += ["--csv", f"results/{stage}.csv", *(more if words[0] == "experiment" else ())]
        commit = _git(self.root, "rev-parse", "--short=8", "HEAD")
        changed = ":(exclude)results", ":(exclude)docs", ":(exclude)README.md"
        if _git(self.root, "status", "--porcelain", "--untracked-files=no", "--", ".", *changed):
            commit += "+"
        subprocess.run([sys.executable, "-m", "mecazen_tools", *words], check=True, cwd=self.root)
        self._made.clear()
        figures = {file: _drawn(self.root / file) for file in self.stages[stage].get("figures", ())}
        self.origins = read_toml(self.folder / "origins.toml")  # others may run meanwhile
        self.origins[stage] = {
            "commit": commit,
            "date": _git(self.root, "show", "--no-patch", "--format=%cs"),
            "machine": f"{harness.machine()}.",
            "key": key,
            **({"figures": figures} if figures else {}),
        }
        (self.folder / "origins.toml").write_text(tomli_w.dumps(self.origins))
        for path in self.documents:
            path.write_text(self.updated(path.read_text()))


def sha256(content: bytes) -> str:
    """Return the first half of a hash."""
    return hashlib.sha256(content).hexdigest()[:16]


def _drawn(file: Path) -> str:
    return sha256(file.read_bytes()) if file.is_file() else "missing"


def _git(root: Path, *words: str) -> str:
    call = ["git", *words]
    done = subprocess.run(call, check=True, cwd=root, capture_output=True, text=True)
    return done.stdout.strip()


def main(arguments: list[str]) -> None:
    """Check the documents, list stale stages, or run stages."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("stages", nargs="*", help="stages to run; all stale ones by default")
    options.add_argument("--check", action="store_true", help="check the documents, run nothing")
    options.add_argument("--stale", action="store_true", help="fail if a result is stale")
    options.add_argument("--cluster", help="address of a Dask scheduler")
    chosen, results = options.parse_args(arguments), Results(ROOT)
    if unknown := sorted({*chosen.stages} - {*results.stages}):
        sys.exit(f"{unknown[0]}: no such stage; stages: {', '.join(results.stages)}")
    problems = list(results.problems()) if chosen.check else []
    for stage in chosen.stages or results.stages if not chosen.check or chosen.stale else ():
        if why := results.stale(stage):
            print(f"{stage}: {why}", flush=True)
            problems += [f"{stage} is stale"] * chosen.stale
            if not (chosen.check or chosen.stale):
                results.run(stage, ["--cluster", chosen.cluster] if chosen.cluster else [])
    sys.exit("\n".join(problems) or 0)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (MecazenError, subprocess.CalledProcessError) as error:
        sys.exit(f"error: {error}")
