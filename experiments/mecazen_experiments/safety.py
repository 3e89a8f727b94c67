"""`mecazen experiment safety`: does the robot follow without touching anybody?

Each situation is run with each driver from each view, with many seeds.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from string import Template
from typing import Annotated, Literal

import msgspec
from mecazen.config.follower import VIEWS
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, load_table
from mecazen.schema import Finite, Section
from mecazen.standoff import Standoff

from mecazen_experiments.config import BaseCase, Name, Runs, Settings, experiment_path
from mecazen_experiments.jobs import Job, Series, series
from mecazen_experiments.report import Row, regroup
from mecazen_experiments.run import Kind, Record, loaded
from mecazen_experiments.safety_scores import Safety, safety
from mecazen_experiments.watch import watch

Range = tuple[Finite, Finite]
View = Literal["back", "front", "side_left", "side_right"]


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


def configured(
    file: str,
    situations: Sequence[str],
    drivers: Sequence[str],
    views: Sequence[str],
) -> SafetyConfig:
    """Return an experiment with some of its situations, drivers and views.

    Raises:
        ConfigError: There is no such file, or no such one in it.
    """
    config = load_table(experiment_path(file), SafetyConfig)
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


def expand(config: SafetyConfig, runs: int | None, settings: Settings) -> list[Series]:
    """Return the runs of an experiment by situation, driver and view; `settings` override its own.

    Raises:
        ConfigError: The scenario can't be loaded, or a setting names what is not there.
    """
    todo = []
    seeds = range(1, (runs or config.seeds) + 1)
    for situation, driver, view in product(config.situations, config.drivers, config.views):
        labels = {"situation": situation.name, "driver": driver, "view": view}
        case = BaseCase(", ".join(labels.values()), config.scenario, config.drivers[driver])
        jobs: list[Job] = []
        for seed in seeds:
            own = (*_at(view, config.standoff_m), *_filled(situation, view, seed))
            jobs += series(case, case.name, (*own, *settings), (seed,)).jobs
        todo.append(Series(case.name, case, tuple(jobs), labels))
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


def _measure(job: Job) -> tuple[Safety, str]:
    scenario = loaded(job)
    seen = watch(scenario)
    return safety(seen, scenario), seen.trajectory_sha256


SAFETY = Kind(
    "safety",
    Record[Safety],
    _measure,
    msgspec.structs.asdict,
    sums=[name for name in Safety.__struct_fields__ if name.startswith("contacts_")],
    least=[name for name in Safety.__struct_fields__ if name.startswith("gap_")],
)
"""How safely the robot follows."""


def film(job: Job, folder: Path) -> Path:
    """Simulate a job once more, and record all of it; return the file.

    Raises:
        MecazenError: The run failed.
    """
    scenario = loaded(job)
    file = folder / f"{job.row.replace(', ', '-').replace(' ', '_')}.mcap"
    recorded = (
        f"services={json.dumps([*scenario.services, 'recorder'])}",
        f"recorder.file={json.dumps(str(file))}",
    )
    watch(load_scenario(job.scenario, (*job.settings, *recorded)))
    return file


def rows_of(rows: Sequence[Row[Safety]]) -> list[Row[Safety]]:
    """Return a row for each situation and driver, and for each driver over all situations."""
    each = regroup(SAFETY, rows, lambda row: {n: row.labels[n] for n in ("situation", "driver")})
    views = list(dict.fromkeys(row.labels["view"] for row in rows))
    by_view = sorted(rows, key=lambda row: views.index(row.labels["view"]))
    return each + regroup(
        SAFETY, by_view, lambda row: {"situation": "all", "driver": row.labels["driver"]}
    )
