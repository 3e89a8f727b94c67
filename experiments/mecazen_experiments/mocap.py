"""`mecazen experiment mocap`: from where is a gait captured how well?

Somebody walks straight on, and the robot follows at each of its places by its own sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.schema import AngleDeg, Positive, Section
from mecazen_follower.config import FollowerConfig
from mecazen_follower.goal import Standoff
from rich.table import Table

from mecazen_experiments.capture import capture
from mecazen_experiments.config import BaseCase, Name, Runs, Settings
from mecazen_experiments.jobs import Job, Key, Series, series
from mecazen_experiments.quality import MEASURED, Curves, Quality, numbers, quality
from mecazen_experiments.report import show
from mecazen_experiments.statistics import Interval, mean_interval

CAPTION = (
    "means over the runs, below each its 95 % interval; raw → refined: as reported, and by the "
    "estimator of refine.py"
)

Values = Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)]


class MocapConfig(Section):
    """An experiment of motion capture."""

    scenario: Path
    """The scenario's file, relative to this one."""
    views: Annotated[dict[Name, AngleDeg], msgspec.Meta(min_length=1)]
    """Bearings of the robot about the person, whom it faces: 0 is ahead of them, 90 on their
    left [deg]."""
    settings: Settings = msgspec.field(name="set", default=())
    seeds: Runs = 2
    standoffs_m: Values = (1.0, 1.5, 2.0, 3.0)
    speeds_m_s: Values = (0.6, 1.0, 1.3)


class Place(NamedTuple):
    """From where a walk is seen, and how fast it is."""

    view: str
    standoff_m: float
    speed_m_s: float


class Run(msgspec.Struct, frozen=True):
    """A run and its scores."""

    key: Key
    quality: Quality


class Row(msgspec.Struct, frozen=True):
    """All runs of one place."""

    view: str
    bearing_deg: float
    standoff_m: float
    speed_m_s: float
    means: dict[str, Interval]
    """Over the seeds, by the names of `quality.numbers`."""
    runs: tuple[Run, ...]


def selected(
    config: MocapConfig,
    views: Sequence[str],
    standoffs_m: Sequence[float],
    speeds_m_s: Sequence[float],
) -> MocapConfig:
    """Return an experiment with some of its views, and with other standoffs and speeds.

    Raises:
        ConfigError: It has no such view.
    """
    if unknown := [view for view in views if view not in config.views]:
        raise ConfigError(f"--view {unknown[0]}: unknown; allowed: {', '.join(config.views)}")
    return msgspec.structs.replace(
        config,
        views={view: config.views[view] for view in views or config.views},
        standoffs_m=tuple(standoffs_m or config.standoffs_m),
        speeds_m_s=tuple(speeds_m_s or config.speeds_m_s),
    )


def expand(config: MocapConfig, runs: int | None, settings: Settings) -> dict[Place, Series]:
    """Return the runs of an experiment by place; `settings` override its own.

    Raises:
        ConfigError: The scenario can't be loaded.
    """
    case = BaseCase("mocap", config.scenario, config.settings)
    seeds = range(1, (runs or config.seeds) + 1)
    todo = {}
    for view, bearing in config.views.items():
        for distance in config.standoffs_m:
            # the robot faces the person
            heading = math.remainder(bearing - 180.0, 360.0)
            start = Standoff(distance, math.radians(bearing), 0.0).goal(Pose2D())
            for speed in config.speeds_m_s:
                own = (
                    f"follower.bearing_deg={bearing}",
                    f"follower.heading_deg={heading}",
                    f"follower.standoff_m={distance}",
                    f"start={{ x_m = {start.x}, y_m = {start.y}, yaw_deg = {heading} }}",
                    f"target.path.speed_m_s={speed}",
                )
                name = f"{view}, {distance:g} m, {speed:g} m/s"
                place = Place(view, distance, speed)
                todo[place] = series(case, name, (*own, *settings), seeds)
    return todo


def measure(job: Job) -> tuple[Quality, Curves]:
    """Simulate a job and score what was captured.

    Raises:
        MecazenError: As of `capture`, or nobody walks.
    """
    scenario = load_scenario(job.scenario, job.settings)
    return quality(capture(job), scenario.section(FollowerConfig, "follower").standoff)


def summarise(
    config: MocapConfig, todo: Mapping[Place, Series], found: Mapping[Key, Quality]
) -> list[Row]:
    """Return a row for each place."""
    rows = []
    for place, one in todo.items():
        runs = tuple(Run(job.key, found[job.key]) for job in one.jobs)
        bearing = config.views[place.view]
        rows.append(Row(place.view, bearing, *place[1:], means(runs), runs))
    return rows


def means(runs: Sequence[Run]) -> dict[str, Interval]:
    """Return the mean of each score over those runs that have it, with its interval."""
    columns: dict[str, list[float]] = {}
    for run in runs:
        for name, value in numbers(run.quality).items():
            columns.setdefault(name, []).append(value)
    return {name: mean_interval(values) for name, values in columns.items()}


def tables(rows: Sequence[Row]) -> tuple[Table, Table]:
    """Return the scores by view and standoff, over all speeds, and by view and speed."""
    return (
        _table(rows, "standoff", lambda row: f"{row.standoff_m:g} m"),
        _table(rows, "speed", lambda row: f"{row.speed_m_s:g} m/s"),
    )


def _table(rows: Sequence[Row], title: str, label: Callable[[Row], str]) -> Table:
    groups: dict[tuple[str, str], list[Run]] = {}
    for row in rows:
        groups.setdefault((row.view, label(row)), []).extend(row.runs)
    shown = Table("view", title, "runs", show_lines=True, caption=CAPTION)
    pairs = [(f"{joint}\nRMSE \\[°]", f"{joint}_deg", 1) for joint in MEASURED]
    pairs.append(("jitter\n\\[mm]", "jitter_mm", 1))
    singles = (
        ("stride\n\\[ms]", "stride_time_err_ms", 1),
        ("stride\n\\[mm]", "stride_length_err_mm", 0),
        ("cadence\n\\[%]", "cadence_err_percent", 2),
        ("stance\n\\[%]", "stance_err_percent", 1),
        ("asymmetry\n\\[%]", "asymmetry_err_percent", 1),
        ("knee\nseen \\[%]", "knee_seen_percent", 0),
        ("ankle\nseen \\[%]", "ankle_seen_percent", 0),
        ("foot\nseen \\[%]", "foot_seen_percent", 0),
        ("D_err\n\\[m]", "d_err_m", 3),
        ("Θ_err\n\\[°]", "theta_err_deg", 1),
    )
    for heading, *_ in (*pairs, *singles):
        shown.add_column(heading)
    for (view, value), runs in groups.items():
        of = means(runs)
        cells = [
            f"{_mean(of, f'raw_{name}', digits)} → {show(of.get(f'refined_{name}'), digits)}"
            for _, name, digits in pairs
        ]
        cells += [show(of.get(name), digits) for _, name, digits in singles]
        shown.add_row(view, value, str(len(runs)), *cells)
    return shown


def _mean(of: Mapping[str, Interval], name: str, digits: int) -> str:
    return f"{of[name].mean:.{digits}f}" if name in of else "-"
