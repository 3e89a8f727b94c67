"""An episode of Follow-Bench as a scenario of mecazen: our robot, its own senses, the guard."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen.loading import from_tables, named_file

from mecazen_experiments.followbench import unicycle
from mecazen_experiments.followbench.episodes import Episode, Walk
from mecazen_experiments.followbench.pedestrians import SPEED_M_S
from mecazen_experiments.followbench.pedestrians.grid import Grid
from mecazen_experiments.followbench.play import grid_of

WALL_M = 2.0
"""Height of the boxes [m]; those of Follow-Bench have no height."""
LOST_AFTER_S = 4.0
"""Follower setting, as in other scenarios with people between robot and person [s]."""


def tables_of(episode: Episode, seed: int) -> dict[str, Any]:
    """Return the tables of the scenario; the nexus robot is at the original outline's centre.

    The robot faces the target at the start, since its camera does not see all around. Beside the
    target it remains on the side of its start. People have the planned ways and the speed of the
    episode, a walking body, and give way by the social force of mecazen.
    """
    grid = grid_of(episode)
    robot, target = episode.robot.compose(Pose2D(unicycle.CENTRE)), episode.target.start
    yaw = math.atan2(target.y - robot.y, target.x - robot.x)
    return {
        "robot": str(named_file("nexus", "robot")),
        "seed": seed,
        "services": ["physics", "controller", "target", "crowd", "sensors", "follower", "guard"],
        "sim": {"mode": "lockstep", "duration_s": episode.max_steps * episode.step_s},
        "start": {"x_m": robot.x, "y_m": robot.y, "yaw_deg": math.degrees(yaw)},
        "sensor": {"kind": "fused"},
        "target": {"path": _goal(episode.target, grid)},
        "crowd": {"walkers": [{"path": _goal(walk, grid)} for walk in episode.humans]},
        "world": {
            "person": {"radius_m": unicycle.PERSON_RADIUS},
            "obstacles": [
                {
                    "kind": "box",
                    "size_m": [box.length, box.width, WALL_M],
                    "position_m": [box.x, box.y],
                    "yaw_deg": math.degrees(box.yaw),
                }
                for box in episode.boxes
            ],
        },
        "follower": {
            "view": _view(episode),
            "standoff_m": episode.distance,
            "lost_after_s": LOST_AFTER_S,
            "planner": {},
        },
    }


def scenario_of(episode: Episode, seed: int) -> Scenario:
    """Return the scenario of an episode."""
    return from_tables(tables_of(episode, seed), Path(episode.name))


def _view(episode: Episode) -> str:
    """Return the view for the episode's place; beside the target it is that of the nearer side."""
    if episode.place == "back":
        return "back"
    start, (x, y) = episode.target.start, episode.target.goals[0]
    walks = start._replace(yaw=math.atan2(y - start.y, x - start.x))
    return "side_left" if walks.between(episode.robot).y >= 0.0 else "side_right"


def _goal(walk: Walk, grid: Grid) -> dict[str, Any]:
    ways = grid.way([walk.start[:2], *walk.goals]) if walk.plans else walk.goals
    return {
        "kind": "goal",
        "x_m": walk.start.x,
        "y_m": walk.start.y,
        "yaw_deg": math.degrees(walk.start.yaw),
        "via_m": [list(place) for place in ways[:-1]],
        "goal_m": list(walk.goals[-1]),
        "speed_m_s": SPEED_M_S,
    }
