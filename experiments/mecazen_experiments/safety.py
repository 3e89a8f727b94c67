"""`mecazen experiment safety`: does the robot follow without touching anybody?

Each situation is run with each driver from each view, with many seeds.
"""

from __future__ import annotations

import gc
import json
import math
import random
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from string import Template
from typing import Annotated, Literal, NamedTuple

import msgspec
from mecazen.config.follower import VIEWS
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.schema import Finite, Section
from mecazen.standoff import Standoff
from rich.table import Column, Table

from mecazen_experiments.config import BaseCase, Name, Runs, Settings
from mecazen_experiments.jobs import Job, Key, check_version, series
from mecazen_experiments.report import show
from mecazen_experiments.safety_scores import Safety, safety
from mecazen_experiments.statistics import Interval, mean_interval
from mecazen_experiments.watch import watch

Range = tuple[Finite, Finite]
View = Literal["back", "front", "side_left", "side_right"]

CAPTION = (
    "contacts: sums over the runs, those that the robot caused and all; gaps: the smallest; "
    "others: means, below each its 95 % interval"
)
SUMS = (
    ("contacts\nperson", "contacts_person"),
    ("person\nall", "contacts_person_all"),
    ("others", "contacts_others"),
    ("others\nall", "contacts_others_all"),
    ("walls", "contacts_world"),
)
LEAST = (
    ("gap \\[m]\nperson", "gap_person_m"),
    ("others", "gap_others_m"),
    ("walls", "gap_world_m"),
)
MEANS = (
    ("conflict\n\\[s]", "conflict_s", 2),
    ("in view\n\\[%]", "view_percent", 1),
    ("regain\n\\[s]", "regain_s", 2),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("frozen\n\\[s]", "frozen_s", 2),
    ("jerk\n\\[m/s³]", "jerk_rms_m_s3", 1),
)
"""Headings, names in `Safety`, and digits to show."""


class Situation(Section):
    """What happens around the robot.

    In its settings `$name` is the value of that name of `vary`, and `$bearing_deg` the direction
    from the person to the robot.
    """

    name: Name
    settings: Settings = msgspec.field(name="set", default=())
    vary: dict[str, Range] = msgspec.field(default_factory=dict)
    """Values that each seed draws between two limits."""


class SafetyConfig(Section):
    """An experiment of safety."""

    scenario: Path
    """The scenario's file, relative to this one."""
    standoff_m: Annotated[float, msgspec.Meta(gt=0.0)]
    situations: Annotated[tuple[Situation, ...], msgspec.Meta(min_length=1)]
    drivers: Annotated[dict[Name, Settings], msgspec.Meta(min_length=1)]
    """Who drives: settings by name."""
    views: Annotated[tuple[View, ...], msgspec.Meta(min_length=1)] = (
        "back",
        "front",
        "side_left",
        "side_right",
    )
    seeds: Runs = 30


class Place(NamedTuple):
    """What is run: a row of the table is all views of a situation and a driver."""

    situation: str
    driver: str
    view: str


class SafetyRecord(msgspec.Struct, frozen=True):
    """The results of a run, and its cost."""

    key: Key
    safety: Safety
    wall_s: float


class SafetyRow(msgspec.Struct, frozen=True):
    """All runs of a situation with a driver."""

    situation: str
    driver: str
    sums: dict[str, int]
    least: dict[str, float | None]
    means: dict[str, Interval | None]
    runs: dict[str, tuple[SafetyRecord, ...]]
    """By view."""


def selected(
    config: SafetyConfig,
    situations: Sequence[str],
    drivers: Sequence[str],
    views: Sequence[str],
) -> SafetyConfig:
    """Return an experiment with some of its situations, drivers and views.

    Raises:
        ConfigError: It has no such one.
    """
    names = [one.name for one in config.situations]
    for option, wanted, known in (
        ("--situation", situations, names),
        ("--driver", drivers, [*config.drivers]),
        ("--view", views, [*config.views]),
    ):
        if unknown := [name for name in wanted if name not in known]:
            raise ConfigError(f"{option} {unknown[0]}: unknown; allowed: {', '.join(known)}")
    return msgspec.structs.replace(
        config,
        situations=tuple(
            one for one in config.situations if not situations or one.name in situations
        ),
        drivers={name: config.drivers[name] for name in drivers or config.drivers},
        views=tuple(view for view in config.views if not views or view in views),
    )


def expand(config: SafetyConfig, runs: int | None, settings: Settings) -> dict[Place, list[Job]]:
    """Return the runs of an experiment by place; `settings` override its own.

    Raises:
        ConfigError: The scenario can't be loaded, or a setting names what is not there.
    """
    todo: dict[Place, list[Job]] = {}
    seeds = range(1, (runs or config.seeds) + 1)
    for situation, driver, view in product(config.situations, config.drivers, config.views):
        place = Place(situation.name, driver, view)
        case = BaseCase(", ".join(place), config.scenario, config.drivers[driver])
        todo[place] = []
        for seed in seeds:
            own = (*_at(view, config.standoff_m), *_filled(situation, view, seed))
            todo[place] += series(case, case.name, (*own, *settings), (seed,)).jobs
    return todo


def _at(view: View, standoff_m: float) -> Settings:
    """Return the settings that have the robot begin at its place beside the person."""
    bearing, heading = map(math.radians, VIEWS[view])
    start = Standoff(standoff_m, bearing, heading).goal(Pose2D())
    return (
        f"follower.view={view}",
        f"follower.standoff_m={standoff_m}",
        f"start={{ x_m = {start.x}, y_m = {start.y}, yaw_deg = {math.degrees(start.yaw)} }}",
    )


def _filled(situation: Situation, view: View, seed: int) -> Settings:
    """Return a situation's settings with the values of a view and a seed.

    Raises:
        ConfigError: They name a value that is not there.
    """
    # the same values for all drivers and views: they are compared in pairs
    chance = random.Random(f"{situation.name} {seed}")  # noqa: S311
    values: dict[str, float] = {
        "bearing_deg": VIEWS[view][0],
        **{name: chance.uniform(*limits) for name, limits in situation.vary.items()},
    }
    try:
        return tuple(Template(setting).substitute(values) for setting in situation.settings)
    except (KeyError, ValueError) as error:
        raise ConfigError(
            f"situation {situation.name!r}: set: no value {error}; known: {', '.join(values)}"
        ) from None


def measure(job: Job) -> SafetyRecord:
    """Simulate a job and score it.

    Raises:
        MecazenError: The run failed, or this process has another version of the code.
    """
    check_version(job)
    gc.collect()  # reference cycles hold the last run's DART world
    begin = time.perf_counter()
    scenario = load_scenario(job.scenario, job.settings)
    found = safety(watch(scenario), scenario)
    return SafetyRecord(job.key, found, time.perf_counter() - begin)


def film(job: Job, folder: Path) -> Path:
    """Simulate a job once more, and record all of it; return the file.

    Raises:
        MecazenError: As of `measure`.
    """
    scenario = load_scenario(job.scenario, job.settings)
    file = folder / f"{job.row.replace(', ', '-').replace(' ', '_')}.mcap"
    recorded = (
        f"services={json.dumps([*scenario.services, 'recorder'])}",
        f"recorder.file={json.dumps(str(file))}",
    )
    watch(load_scenario(job.scenario, (*job.settings, *recorded)))
    return file


def summarise(
    todo: Mapping[Place, Sequence[Job]], found: Mapping[Key, SafetyRecord]
) -> list[SafetyRow]:
    """Return a row for each situation and driver, and for each driver over all situations."""
    groups: dict[tuple[str, str], dict[str, list[SafetyRecord]]] = {}
    for place, jobs in todo.items():
        records = [found[job.key] for job in jobs]
        for situation in (place.situation, "all"):
            of_view = groups.setdefault((situation, place.driver), {})
            of_view.setdefault(place.view, []).extend(records)
    rows = [
        _row(*names, {view: tuple(records) for view, records in of_view.items()})
        for names, of_view in groups.items()
    ]
    return sorted(rows, key=lambda row: row.situation == "all")


def _row(situation: str, driver: str, runs: dict[str, tuple[SafetyRecord, ...]]) -> SafetyRow:
    of = [record.safety for records in runs.values() for record in records]

    values = {
        name: [value for one in of if (value := getattr(one, name)) is not None]
        for name in Safety.__struct_fields__
    }
    return SafetyRow(
        situation,
        driver,
        {name: sum(values[name]) for _, name in SUMS},
        {name: min(values[name], default=None) for _, name in LEAST},
        {name: mean_interval(values[name]) if values[name] else None for _, name, _ in MEANS},
        runs,
    )


def table(rows: Sequence[SafetyRow]) -> Table:
    """Return the table of the experiment."""
    names = (Column(name, no_wrap=True) for name in ("situation", "driver", "runs"))
    shown = Table(*names, show_lines=True, caption=CAPTION)
    for heading in (*(one[0] for one in SUMS), *(one[0] for one in LEAST)):
        shown.add_column(heading)
    for heading, *_ in MEANS:
        shown.add_column(heading)
    for row in rows:
        least = [row.least[name] for _, name in LEAST]
        shown.add_row(
            row.situation,
            row.driver,
            str(sum(map(len, row.runs.values()))),
            *(str(row.sums[name]) for _, name in SUMS),
            *("" if value is None else f"{value:.2f}" for value in least),
            *(show(row.means[name], digits) for _, name, digits in MEANS),
        )
    return shown
