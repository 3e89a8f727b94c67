"""Follow-Bench as two kinds of experiments: by its rules, and in its episodes with our robot."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from itertools import product
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
from mecazen.errors import ConfigError, explaining
from mecazen.files import read_bytes
from mecazen.portable import Floats
from mecazen_tools.observe import watch
from rich.table import Table

from mecazen_experiments.config import Case
from mecazen_experiments.followbench.entrants import entrant
from mecazen_experiments.followbench.episodes import Density, Episode, read
from mecazen_experiments.followbench.generate import (
    PEOPLE_OF_LAYOUTS,
    SETTINGS,
    generate,
    scenarios,
    tracks,
)
from mecazen_experiments.followbench.metrics import SUCCESSES, Metrics, compare, measure
from mecazen_experiments.followbench.own import COLUMNS as OWN_COLUMNS
from mecazen_experiments.followbench.own import OwnRun, own_run
from mecazen_experiments.followbench.planners import PLANNERS
from mecazen_experiments.followbench.play import Record as Played
from mecazen_experiments.followbench.play import play
from mecazen_experiments.followbench.scenario import scenario_of
from mecazen_experiments.followbench.view import Place
from mecazen_experiments.jobs import Job, Key, Series, version, with_content
from mecazen_experiments.report import Kind, Record, Row, regroup
from mecazen_experiments.run import file_name
from mecazen_experiments.safety_old import MORE, SAFETY
from mecazen_experiments.tables_old import Column, table

T = TypeVar("T")

PLACES: tuple[Place, ...] = ("back", "left_side")
CROWDS = ("Circular", "Crowd", "Parallel", "Perpendicular")
MISSING = "lShape45", "left_side"
"""The only track without an episode for one of the places."""
OURS = "our robot"
"""The follower of table B."""
CAPTION = (
    "By the rules of Follow-Bench. Means over the episodes, each with its 95 % interval; SR, ASR, "
    "TVR and the times in % of the episode"
)
PAIRED = "Differences over the same episodes, each with its 95 % interval"
OWN_CAPTION = (
    "Our robot with its own limits and senses in the same episodes; not comparable with published "
    "numbers. Contacts: sums over the episodes, those that the robot caused and all; stride: error "
    "of the mean stride time and length that the robot sees"
)
COLUMNS: tuple[Column, ...] = (
    ("SR\n\\[%]", "sr", 0),
    ("ASR\n\\[%]", "asr", 0),
    ("TVR\n\\[%]", "tvr", 1),
    ("TinT-\nPerson", "tin_tperson", 1),
    ("Tin-\nPrivate", "tin_private", 1),
    ("PL\n\\[m]", "pl_m", 1),
    ("AvgVel\n\\[m/s]", "avg_vel_m_s", 2),
    ("AvgAcc\n\\[m/s²]", "avg_acc_m_s2", 2),
    ("Jerk\n\\[m/s³]", "jerk_m_s3", 1),
    ("search\n\\[s]", "search_time_s", 1),
    ("caused\n\\[%]", "caused_contact", 0),
    ("in view\n\\[%]", "in_view", 0),
    ("D_err\n\\[m]", "d_err_m", 2),
    ("heading\n\\[°]", "heading_err_deg", 0),
)
LEVELS = {
    (cls, Density(humans, *size).text): level
    for cls, (size, numbers) in PEOPLE_OF_LAYOUTS.items()
    for level, humans in enumerate(numbers, start=1)
}
"""The level of people, by class and density as text."""


class Entry(msgspec.Struct, frozen=True):
    """A follower, and an episode from a file or from the generator."""

    follower: str
    cls: str
    place: Place
    density: Density
    file: str = ""
    """File of the episode; empty for the generator."""

    def episode(self, seed: int) -> Episode:
        """Return the episode."""
        if self.file:
            return read(Path(self.file))
        return generate(self.cls, self.place, self.density, seed)


def drawn(followers: Sequence[str], seeds: Sequence[int], only: Sequence[str]) -> list[Series]:
    """Return the generated episodes of all cells for each follower, of all classes or of `only`.

    Raises:
        ConfigError: There is no such class.
    """
    cells = [*scenarios(), *tracks()]
    _check(only, {cell.cls for cell in cells})
    todo = []
    for follower, cell, place in product(followers, cells, PLACES):
        if (cell.cls, place) == MISSING or (only and cell.cls not in only):
            continue
        entry = Entry(follower, cell.cls, place, cell.density)
        # a track has no random part
        chosen = seeds if cell.cls in SETTINGS else seeds[:1]
        todo.append(_series([(entry, seed) for seed in chosen]))
    return todo


def read_from(
    followers: Sequence[str], files: Mapping[Path, Episode], only: Sequence[str]
) -> list[Series]:
    """Return the episodes of files for each follower, by class, density and place.

    Raises:
        ConfigError: The files have no class of `only`.
    """
    _check(only, {episode.cls for episode in files.values()})
    groups: dict[tuple[str, Place, Density], list[str]] = {}
    for file, episode in files.items():
        if not only or episode.cls in only:
            cell = episode.cls, episode.place, episode.density
            groups.setdefault(cell, []).append(str(file))
    return [
        _series([(Entry(follower, *cell, file), number) for number, file in enumerate(names)])
        for follower in followers
        for cell, names in groups.items()
    ]


def _check(only: Sequence[str], known: Collection[str]) -> None:
    if unknown := sorted(set(only) - set(known)):
        raise ConfigError(f"--only {unknown[0]}: no such class; known: {', '.join(sorted(known))}")


def _series(runs: Sequence[tuple[Entry, int]]) -> Series:
    """Return the runs of entries with seeds, which share a row of the table."""
    first, _ = runs[0]
    labels = {
        "follower": first.follower,
        "class": first.cls,
        "place": first.place,
        "density": first.density.text,
    }
    row = ", ".join(labels.values())
    jobs = tuple(
        Job(row, None, Path(entry.file), (_text(entry),), Key(_sha256(entry), seed, version()))
        for entry, seed in runs
    )
    return Series(row, Case(name=row, scenario=Path(first.file)), jobs, dict(labels))


def _text(entry: Entry) -> str:
    return msgspec.json.encode(entry).decode()


def _sha256(entry: Entry) -> str:
    """Return the SHA-256 of an entry, with the contents of its files."""
    digest = hashlib.sha256(f"{_text(entry)}\n{with_content(entry.follower)}\n".encode())
    if entry.file:
        digest.update(read_bytes(Path(entry.file)))
    return digest.hexdigest()


def _episode(job: Job) -> tuple[str, Episode]:
    """Return the follower and the episode of a job."""
    entry = msgspec.json.decode(job.settings[0], type=Entry)
    if entry.file:
        return entry.follower, read(Path(entry.file))
    return entry.follower, generate(entry.cls, entry.place, entry.density, job.key.seed)


def _played(job: Job) -> tuple[Episode, Played]:
    """Play the episode of a job."""
    follower, episode = _episode(job)
    with nullcontext() if follower in PLANNERS else explaining(follower):
        return episode, play(episode, entrant(follower)(), job.key.seed)


def _measure(job: Job) -> tuple[Metrics, str]:
    episode, record = _played(job)
    digest = hashlib.sha256()
    for values in cast(tuple[Floats, ...], record[:4]):
        digest.update(values.tobytes())
    return measure(record, episode.place, episode.distance), digest.hexdigest()


def _measure_own(job: Job) -> tuple[OwnRun, str]:
    _, episode = _episode(job)
    scenario = scenario_of(episode, job.key.seed)
    seen = watch(scenario)
    return own_run(seen, scenario), seen.trajectory_sha256


def _kind_of(cls: Any) -> str:
    return "open" if cls in CROWDS else "layouts" if cls in SETTINGS else "tracks"


def tables(rows: Sequence[Row[Metrics]]) -> list[Table]:
    """Return tables over all episodes, by people in open scenes and layouts, and by class."""
    found = _tables(FOLLOWBENCH, rows, COLUMNS, CAPTION)
    pairs = _pairs(rows)
    if pairs:
        heads = ["follower", "minus", "in"]
        found.append(table(heads, COLUMNS, pairs, title="Paired", caption=PAIRED))
    return found


def _in_open(rows: Sequence[Row[T]]) -> list[Row[T]]:
    return [row for row in rows if _kind_of(row.labels["class"]) == "open"]


def _by_level(row: Row[Any]) -> dict[str, str | float]:
    labels = row.labels
    level = LEVELS[str(labels["class"]), str(labels["density"])]
    return {"follower": labels["follower"], "layouts, place": labels["place"], "level": level}


def _with_level(rows: Sequence[Row[T]]) -> list[Row[T]]:
    return [row for row in rows if (row.labels["class"], row.labels["density"]) in LEVELS]


def _by_people(row: Row[Any]) -> dict[str, str | float]:
    follower, place, density = (row.labels[name] for name in ("follower", "place", "density"))
    return {"follower": follower, "open, place": place, "density": density}


def _pairs(rows: Sequence[Row[Metrics]]) -> list[Row[Metrics]]:
    """Return the differences of each follower from the first, over the same episodes."""
    runs: dict[tuple[str, str], dict[str, Metrics]] = {}
    for row in rows:
        labels = row.labels
        where = ", ".join(str(labels[axis]) for axis in ("class", "place", "density"))
        some = runs.setdefault(_total(row), {})
        some.update({f"{where}, {r.record.key.seed}": r.record.scores for r in row.runs})
    first = str(rows[0].labels["follower"]) if rows else ""
    return [
        Row(
            f"{follower}, {kind}",
            compare(runs[first, kind], found),
            runs=tuple(r for row in rows if _total(row) == (follower, kind) for r in row.runs),
            labels={"follower": follower, "minus": first, "in": kind},
        )
        for (follower, kind), found in runs.items()
        if follower != first
    ]


def _total(row: Row[Any]) -> tuple[str, str]:
    """Return the follower of a row, and whether its scenes are open, layouts or tracks."""
    return str(row.labels["follower"]), _kind_of(row.labels["class"])


def own_tables(rows: Sequence[Row[OwnRun]]) -> list[Table]:
    """Return the same tables for our robot."""
    return _tables(OWN_ROBOT, rows, OWN_COLUMNS, OWN_CAPTION, MORE)


def _tables(
    kind: Kind[Any],
    rows: Sequence[Row[Any]],
    columns: Sequence[Column],
    caption: str,
    more: Mapping[str, Callable[[Row[Any]], str]] | None = None,
) -> list[Table]:
    def total(row: Row[Any]) -> dict[str, str | float]:
        return dict(zip(("follower", "in"), _total(row), strict=True))

    def by_place(row: Row[Any]) -> dict[str, str | float]:
        return {**total(row), "place": row.labels["place"]}

    def by_class(row: Row[Any]) -> dict[str, str | float]:
        return {name: row.labels[name] for name in ("follower", "class", "place")}

    shown = [
        ("Overall", ["follower", "in"], regroup(kind, rows, total)),
        ("By place", ["follower", "in", "place"], regroup(kind, rows, by_place)),
        (
            "In the open",
            ["follower", "open, place", "density"],
            regroup(kind, _in_open(rows), _by_people),
        ),
        (
            "In layouts",
            ["follower", "layouts, place", "level"],
            regroup(kind, _with_level(rows), _by_level),
        ),
        ("By class", ["follower", "class", "place"], regroup(kind, rows, by_class)),
    ]
    return [
        table(heads, columns, some, title=title, caption=caption, more=more)
        for title, heads, some in shown
        if some
    ]


def draw(folder: Path, rows: Sequence[Row[Metrics]]) -> list[Path]:
    """Write the figure of the success rates in open scenes into a folder, and return the files."""
    from mecazen_experiments.followbench import figure  # noqa: PLC0415  # imports Matplotlib

    return figure.draw(regroup(FOLLOWBENCH, _in_open(rows), _by_people), folder)


def film_of(folder: Path, job: Job) -> Path:
    """Play an episode again, write a film of it into a folder, and return the file."""
    from mecazen_experiments.followbench.film import film  # noqa: PLC0415  # imports Matplotlib

    episode, record = _played(job)
    file = folder / f"{file_name(job)}.gif"
    film(episode, record, job.row, file)
    return file


def worst(series: Series, row: Row[Metrics]) -> Job:
    """Return the first failed episode of a row, or its first episode if none failed."""
    failed = {run.record.key for run in row.runs if not run.record.scores.sr}
    return next((job for job in series.jobs if job.key in failed), series.jobs[0])


class Result(msgspec.Struct):
    """A result of `--json`."""

    rows: list[Row[Metrics]]


def rows_of(file: Path) -> list[Row[Metrics]]:
    """Return the rows of a result that `--json` wrote.

    Raises:
        ConfigError: The file is not a result of `--json`.
    """
    try:
        return msgspec.json.decode(read_bytes(file), type=Result).rows
    except (msgspec.DecodeError, OSError) as error:
        raise ConfigError(f"--leaderboard {file}: no result of followbench: {error}") from None


FOLLOWBENCH = Kind(
    "followbench",
    Record[Metrics],
    _measure,
    msgspec.structs.asdict,
    tables,
    successes=SUCCESSES,
)
"""Table A: the robot and rules of Follow-Bench."""
OWN_ROBOT = Kind(
    "followbench_own",
    Record[OwnRun],
    _measure_own,
    msgspec.structs.asdict,
    own_tables,
    sums=SAFETY.sums,
    least=SAFETY.least,
)
"""Table B: our robot, its senses and the guard."""
