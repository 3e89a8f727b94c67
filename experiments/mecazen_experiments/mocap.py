"""`mecazen experiment mocap`: from where is a gait captured how well?

Somebody walks straight on, and the robot follows at each of its places by its own sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.schema import AngleDeg, Positive, Section
from mecazen.standoff import Standoff
from rich.table import Table

from mecazen_experiments.capture import capture
from mecazen_experiments.config import BaseCase, Name, Runs, Settings
from mecazen_experiments.jobs import Job, Key, Series, series
from mecazen_experiments.quality import MEASURED, Curves, Quality, numbers, quality
from mecazen_experiments.report import CAPTION, show
from mecazen_experiments.statistics import Interval, mean_interval

Column = tuple[str, str, int]
"""Heading, name in `quality.numbers`, and digits to show."""
ANGLE_COLUMNS: tuple[Column, ...] = (
    *(
        (f"{joint} \\[°]\n{stage}", f"{stage}_{joint}_deg", 1)
        for joint in MEASURED
        for stage in ("raw", "refined")
    ),
    *((f"{joint} \\[°]\ncentred", f"refined_{joint}_centred_deg", 1) for joint in MEASURED),
    ("jitter \\[mm]\nraw", "raw_jitter_mm", 0),
    ("refined", "refined_jitter_mm", 0),
)
GAIT_COLUMNS: tuple[Column, ...] = (
    ("stride\n\\[ms]", "stride_time_err_ms", 1),
    ("stride\n\\[mm]", "stride_length_err_mm", 0),
    ("cadence\n\\[%]", "cadence_err_percent", 2),
    ("stance\n\\[%]", "stance_err_percent", 1),
    ("asymm.\n\\[%]", "asymmetry_err_percent", 1),
    *((f"{name}\nseen \\[%]", f"{name}_seen_percent", 0) for name in ("knee", "ankle", "foot")),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("odometry\n\\[%]", "odometry_drift_percent", 1),
)
GAITS_COLUMNS: tuple[Column, ...] = tuple(
    (f"{heading}\n{stage}", f"{stage}_{name}", digits)
    for heading, name, digits in (
        ("step length\nasymm. \\[%]", "step_length_percent", 1),
        ("step time\nasymm. \\[%]", "step_time_percent", 1),
        ("stance\nasymm. \\[%]", "stance_percent", 1),
        ("left knee\n\\[°]", "left_knee_deg", 0),
        ("right knee\n\\[°]", "right_knee_deg", 0),
        ("stride\n\\[m]", "stride_m", 2),
        ("cadence\n\\[1/min]", "cadence", 0),
    )
    for stage in ("true", "found")
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
    gaits: Annotated[dict[Name, Settings], msgspec.Meta(min_length=1)] = msgspec.field(
        default_factory=lambda: {"normal": ()}
    )
    """Settings of the walker's gait, by its name."""


class Place(NamedTuple):
    """From where a walk is seen, and how fast it is."""

    view: str
    standoff_m: float
    speed_m_s: float
    gait: str


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
    gait: str
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
                for gait, of in config.gaits.items():
                    place = Place(view, distance, speed, gait)
                    row = name if gait == "normal" else f"{name}, {gait}"
                    todo[place] = series(case, row, (*own, *of, *settings), seeds)
    return todo


def measure(job: Job) -> tuple[Quality, Curves]:
    """Simulate a job and score what was captured.

    Raises:
        MecazenError: As of `capture`, or nobody walks.
    """
    scenario = load_scenario(job.scenario, job.settings)
    return quality(capture(job), scenario.follower.standoff)


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


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return the angles and the gait: by view and standoff over all speeds, and by speed.

    If there are several gaits, the last table has what tells them from each other.
    """
    groups: dict[tuple[str, str], list[Run]] = {}
    for row in rows:
        groups.setdefault((row.view, f"{row.standoff_m:g} m"), []).extend(row.runs)
    for row in sorted(rows, key=lambda row: row.speed_m_s):
        groups.setdefault(("all", f"{row.speed_m_s:g} m/s"), []).extend(row.runs)
    found = [
        _table("Angles and jitter", ANGLE_COLUMNS, groups),
        _table("Gait", GAIT_COLUMNS, groups),
    ]
    by_gait: dict[tuple[str, str], list[Run]] = {}
    for row in sorted(rows, key=lambda row: row.gait):
        by_gait.setdefault((row.view, row.gait), []).extend(row.runs)
    if len({row.gait for row in rows}) > 1:
        found.append(_table("Gaits", GAITS_COLUMNS, by_gait))
    return found


def _table(
    title: str, columns: Sequence[Column], groups: Mapping[tuple[str, str], Sequence[Run]]
) -> Table:
    shown = Table("view", "", "runs", show_lines=True, title=title, caption=CAPTION)
    for heading, *_ in columns:
        shown.add_column(heading)
    for group, runs in groups.items():
        of = means(runs)
        cells = [show(of.get(name), digits) for _, name, digits in columns]
        shown.add_row(*group, str(len(runs)), *cells)
    return shown
