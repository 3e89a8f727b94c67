"""The program `followbench`: our robot, or another follower on it, in an episode."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import from_tables, named_file
from mecazen_tools.observe import PELVIS, Watched, watch

from mecazen_experiments.followbench.episodes import (
    DISTANCE_M,
    PERSON_M,
    STEP_S,
    Episode,
    read,
)
from mecazen_experiments.safety import measure

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job
    from mecazen_experiments.study import Value

CENTRE_M = 0.25
"""Distance from the rear axle of the benchmark's robot, of which its poses are, to its centre."""
PRIVATE_M, PERSONAL_M = 0.45, 1.2
"""Outer radii of the private and the personal zone of a person [m], after E. T. Hall, 1966."""
AHEAD_M = 1.0
"""Distance of the way-point that shows where the target walks at the start."""
CROWDS = ("Circular", "Crowd", "Parallel", "Perpendicular")
LAYOUTS = ("Corridor", "Intersection", "Doorway", "Clutter")


def followbench(job: Job) -> dict[str, Value]:
    """Simulate our robot in the episode of a job's file.

    The columns are those of `safety.measure`, the metrics, and the two successes of Follow-Bench:
    `asr` without contact, whoever caused it, and `sr` if the camera also never lost the target for
    too long. The job's options are settings of the scenario.
    """
    if job.file is None:
        raise ConfigError("files: must name episodes of Follow-Bench")
    episode = read(job.file)
    scenario = scenario_of(episode, job.seed, job.options())
    run = watch(scenario)
    columns = measure(run, scenario)
    contacts = ("contacts_person_all", "contacts_others_all", "contacts_walls")
    asr = not any(columns[name] for name in contacts)
    sr = asr and float(columns["regain_s"] or 0.0) <= episode.max_search_steps * STEP_S
    kind = "open" if episode.cls in CROWDS else "layout" if episode.cls in LAYOUTS else "track"
    return {
        "kind": kind,
        "class": episode.cls,
        "place": episode.place,
        "people": len(episode.humans),
        "sr": sr,
        "asr": asr,
        **columns,
        **metrics(run, scenario),
        "trajectory": run.trajectory_sha256[:16],
    }


def metrics(run: Watched, scenario: Scenario) -> dict[str, float]:
    """Return the metrics of Follow-Bench of a run, from its steps; shares in percent.

    `tin_tperson` is the share of the time in the target's personal zone outside of the private
    zone, and `tin_private` in the private zone of another person; distances are those from the
    circle around the robot's outline. `pl_m` is the length of the path, and the others are means
    over the steps.
    """
    centres = np.stack(run.robot[:2], axis=-1)
    gaps = [
        np.hypot(*(body.joints[:, PELVIS, :2] - centres).T)
        - math.hypot(*scenario.robot.footprint)
        - PERSON_M
        for body in (run.person, *run.pedestrians)
    ]
    target = gaps[0]
    nearest = np.nanmin([np.full(len(target), np.inf), *gaps[1:]], axis=0)
    every = slice(None, None, round(STEP_S / run.table.tick_s))
    steps = np.stack(run.table.poses("robot")[:2], axis=-1)[every]
    velocity, acceleration, jerk = (np.diff(steps, n, axis=0) / STEP_S**n for n in (1, 2, 3))
    return {
        "tin_tperson": 100.0 * float(np.mean((target > PRIVATE_M) & (target < PERSONAL_M))),
        "tin_private": 100.0 * float(np.mean(nearest < PRIVATE_M)),
        "pl_m": STEP_S * float(np.hypot(*velocity.T).sum()),
        "avg_vel_m_s": float(np.hypot(*velocity.T).mean()),
        "avg_acc_m_s2": float(np.hypot(*acceleration.T).mean()),
        "jerk_m_s3": float(np.hypot(*jerk.T).mean()),
    }


def scenario_of(episode: Episode, seed: int, settings: dict[str, Any] | None = None) -> Scenario:
    """Return an episode with the robot nexus at the place of the benchmark's robot.

    The robot faces the target at the start, since its camera does not see all around. Beside the
    target it remains on the side of its start. People have the planned paths and the speed of the
    episode, a walking body, and give way by the social force of mecazen.
    """
    centre, target = episode.robot.compose(Pose2D(CENTRE_M)), episode.target
    yaw = math.atan2(target.y_m - centre.y, target.x_m - centre.x)
    tables: dict[str, Any] = {
        "robot": str(named_file("nexus", "robot")),
        "seed": seed,
        "services": ["physics", "controller", "target", "crowd", "sensors", "follower", "guard"],
        "sim": {"mode": "lockstep", "duration_s": episode.max_steps * STEP_S},
        "start": {"x_m": centre.x, "y_m": centre.y, "yaw_deg": math.degrees(yaw)},
        "sensor": {"kind": "fused"},
        "target": {"path": msgspec.to_builtins(target)},
        "crowd": {"walkers": [{"path": msgspec.to_builtins(path)} for path in episode.humans]},
        "world": {
            "person": {"radius_m": PERSON_M},
            "obstacles": list(map(msgspec.to_builtins, episode.boxes)),
        },
        "follower": {"view": _view(episode), "standoff_m": DISTANCE_M, "planner": {}},
    }
    return from_tables(tables, Path(episode.name), settings or {})


def _view(episode: Episode) -> str:
    """Return the view for the episode's place; beside the target it is that of the nearer side."""
    if episode.place == "back":
        return "back"
    path = episode.target
    start, points = (path.x_m, path.y_m), (*path.via_m, path.goal_m)
    x, y = next((at for at in points if math.dist(at, start) >= AHEAD_M), path.goal_m)
    walks = Pose2D(*start, math.atan2(y - start[1], x - start[0]))
    return "side_left" if walks.between(episode.robot).y >= 0.0 else "side_right"
