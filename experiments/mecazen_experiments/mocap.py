"""`mecazen experiment mocap`: from where is a gait captured how well?

Somebody walks straight on, and the robot follows at each of its places by its own sensors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Annotated

import msgspec
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_table
from mecazen.schema import AngleDeg, Positive, Section
from mecazen.standoff import Standoff

from mecazen_experiments.capture import capture
from mecazen_experiments.config import BaseCase, Name, Runs, Settings, experiment_path
from mecazen_experiments.jobs import Job, Series, series
from mecazen_experiments.quality import Curves, Quality, numbers, quality
from mecazen_experiments.run import Kind, Record, loaded, standoff_of

SHOWN = 2.0, 1.0
"""Standoff [m] and speed [m/s] whose curves are shown, or the nearest that there are."""

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


def configured(
    file: str,
    views: Sequence[str],
    standoffs_m: Sequence[float],
    speeds_m_s: Sequence[float],
) -> MocapConfig:
    """Return an experiment with some of its views, and with other standoffs and speeds.

    Raises:
        ConfigError: There is no such file, or no such view in it.
    """
    config = load_table(experiment_path(file), MocapConfig)
    if unknown := [view for view in views if view not in config.views]:
        raise ConfigError(f"--view {unknown[0]}: unknown; allowed: {', '.join(config.views)}")
    return msgspec.structs.replace(
        config,
        views={view: config.views[view] for view in views or config.views},
        standoffs_m=tuple(standoffs_m or config.standoffs_m),
        speeds_m_s=tuple(speeds_m_s or config.speeds_m_s),
    )


def expand(config: MocapConfig, runs: int | None, settings: Settings) -> list[Series]:
    """Return the runs of an experiment by place; `settings` override its own.

    Raises:
        ConfigError: The scenario can't be loaded.
    """
    case = BaseCase("mocap", config.scenario, config.settings)
    seeds = range(1, (runs or config.seeds) + 1)
    todo = []
    places = product(
        config.views.items(), config.standoffs_m, config.speeds_m_s, config.gaits.items()
    )
    for (view, bearing), distance, speed, (gait, of) in places:
        # the robot faces the person
        heading = math.remainder(bearing - 180.0, 360.0)
        start = Standoff(distance, math.radians(bearing), 0.0).goal(Pose2D())
        own = (
            f"follower.bearing_deg={bearing}",
            f"follower.heading_deg={heading}",
            f"follower.standoff_m={distance}",
            f"start={{ x_m = {start.x}, y_m = {start.y}, yaw_deg = {heading} }}",
            f"target.path.speed_m_s={speed}",
        )
        name = f"{view}, {distance:g} m, {speed:g} m/s"
        name += "" if gait == "normal" else f", {gait}"
        labels: dict[str, str | float] = {
            "view": view,
            "bearing_deg": bearing,
            "standoff_m": distance,
            "speed_m_s": speed,
            "gait": gait,
        }
        one = series(case, name, (*own, *of, *settings), seeds)
        todo.append(one._replace(labels=labels))
    return todo


def _measure(job: Job) -> tuple[Quality, str]:
    scenario = loaded(job)
    found = capture(scenario)
    return quality(found, standoff_of(scenario))[0], found.trajectory_sha256


CAPTURE = Kind("mocap", Record[Quality], _measure, numbers)
"""How well a gait is captured."""


def shown(todo: Sequence[Series]) -> list[Job]:
    """Return the first run of the place of each view whose curves are shown."""

    def distance(one: Series) -> float:
        return math.dist([float(one.labels[n]) for n in ("standoff_m", "speed_m_s")], SHOWN)

    views = dict.fromkeys(one.labels["view"] for one in todo)
    return [
        min((one for one in todo if one.labels["view"] == view), key=distance).jobs[0]
        for view in views
    ]


def curves(job: Job) -> Curves:
    """Simulate a job once more; return what is to be drawn.

    Raises:
        MecazenError: As `capture`, or the person does not walk.
    """
    scenario = loaded(job)
    return quality(capture(scenario), standoff_of(scenario))[1]
