"""Runs that are made up, their scores, and what is shown of them."""

import io
import math
from pathlib import Path

import numpy as np
from mecazen.geometry import Pose2D, Standoff
from mecazen_experiments.config import Case
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.report import Record, summarise
from mecazen_experiments.scores import Score, Scores, score
from mecazen_tools.table import Poses, Table
from mecazen_tools.trajectory import COLUMNS, COVARIANCE, POSE, TWIST
from rich.console import Console

BACK = Standoff(1.0, math.pi, 0.0)
TICK_S = 0.01


def run(ticks, **given):
    """A run with only the columns that are given; `who=(x, y, yaw)` gives a pose."""
    columns = {name: np.full(ticks, np.nan) for name in COLUMNS}
    columns["t_s"] = np.arange(ticks) * TICK_S
    columns["tracking"] = np.full(ticks, "")
    for who in ("robot", "odom", "target", "estimate"):
        for name, column in zip(POSE, given.pop(who, ()), strict=False):
            columns[f"{who}_{name}"] = np.broadcast_to(column, ticks).astype(float)
    for name, column in given.items():
        columns[name] = np.broadcast_to(column, ticks)
    return Table(columns, TICK_S)


def twist(who, vx, vy=0.0, yaw_rate=0.0):
    return {f"{who}_{name}": value for name, value in zip(TWIST, (vx, vy, yaw_rate), strict=True)}


def line(ticks, yaw=0.0, speed=0.2):
    """A person who walks straight on from the origin, towards `yaw` [rad]."""
    way = speed * TICK_S * np.arange(ticks)
    return Poses(way * math.cos(yaw), way * math.sin(yaw), np.full(ticks, yaw))


def beside(person, distance, bearing_deg, heading_deg):
    """The robot at a distance and a bearing from the person, by its heading less theirs."""
    return person.compose(
        Standoff(distance, math.radians(bearing_deg), math.radians(heading_deg)).goal(Pose2D())
    )


def whole(table, standoff=BACK):
    return score(table, standoff).whole


def covariances(matrix):
    """The columns of one 3x3 covariance, or of one for each tick."""
    matrix = np.asarray(matrix)
    triangle = zip(COVARIANCE, *np.triu_indices(3), strict=True)
    return {f"estimate_{name}": matrix[..., i, j] for name, i, j in triangle}


def record(key, d_err_m, theta_err_deg=None):
    """Return the record of a run with these errors."""
    scores = Scores(Score(d_err_m=d_err_m, theta_err_deg=theta_err_deg), Score())
    return Record(key, "", scores, 1.0, 100.0)


def series(name, d_err_m, **case):
    """A series of runs with these errors, by walk and seed, and their records."""
    jobs, records = [], {}
    for (walk, seed), value in d_err_m.items():
        key = Key(f"{name} {walk}", seed, "0")
        jobs.append(Job(name, walk, Path("none.toml"), (), key))
        records[key] = record(key, value, None if value is None else 10.0 * value)
    return Series(name, Case(name, Path("none.toml"), **case), tuple(jobs)), records


def row(name, *d_err_m, **case):
    """The row of runs with these errors, of the seeds 1, 2, … and no walk."""
    by_seed = {(None, seed): value for seed, value in enumerate(d_err_m, start=1)}
    return summarise(FOLLOWING, *series(name, by_seed, **case))


def shown(*tables):
    """Return the text of tables in a terminal."""
    console = Console(file=io.StringIO(), width=160)
    console.print(*tables)
    return console.file.getvalue()


ERRORS = {"without": (0.25, 0.35), "with": (0.10, 0.15), "best": (0.04, 0.02)}
"""Records of the seeds 1 and 2, which the second view has in the other order."""


def six_rows():
    """The rows of the paper's four cases, and of our best."""
    published = {"d_err_m": 0.22, "theta_err_deg": 12.2}
    return [
        row(f"{view} {variant}", *errors[::order], published=published)
        for view, order in (("back", 1), ("side", -1))
        for variant, errors in ERRORS.items()
    ]
