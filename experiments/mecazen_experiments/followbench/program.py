"""The programs `followbench` and `followbench_rules`: our robot in an episode, or a planner."""

from __future__ import annotations

import hashlib
import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError, explaining
from mecazen.geometry import Pose2D
from mecazen.loading import from_tables, named_file
from mecazen_tools.observe import watch

from mecazen_experiments.followbench import robot
from mecazen_experiments.followbench.entrants import entrant
from mecazen_experiments.followbench.episodes import DISTANCE_M, STEP_S, Episode, Walk, read
from mecazen_experiments.followbench.metrics import metrics
from mecazen_experiments.followbench.people import SPEED_M_S, Grid
from mecazen_experiments.followbench.play import play
from mecazen_experiments.safety import measure

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job
    from mecazen_experiments.programs import Value

WALL_M = 2.0
"""Height of the boxes [m]; those of Follow-Bench have no height."""
CROWDS = ("Circular", "Crowd", "Parallel", "Perpendicular")
LAYOUTS = ("Corridor", "Intersection", "Doorway", "Clutter")


def followbench_rules(job: Job) -> dict[str, Value]:
    """Play the episode of a job's file by the rules of Follow-Bench.

    The option `follower` names the planner, see `entrant`; by default it is the reference.
    """
    episode = _episode(job)
    options = job.options()
    follower = str(options.pop("follower", "social"))
    if options:
        raise ConfigError(f"set: no option {min(options)!r}; allowed: follower")
    planner = entrant(follower)()
    with nullcontext() if follower == "social" else explaining(follower):
        record = play(episode, planner, job.seed)
    digest = hashlib.sha256(record.robot.tobytes() + record.target.tobytes()).hexdigest()
    return _labels(episode) | metrics(record, episode) | {"trajectory": digest[:16]}


def followbench(job: Job) -> dict[str, Value]:
    """Simulate our robot in the episode of a job's file.

    The columns are those of `safety.measure`, and the two successes of Follow-Bench: `asr` without
    contact, whoever caused it, and `sr` if the camera also never lost the target for too long. The
    job's options are settings of the scenario.
    """
    episode = _episode(job)
    scenario = scenario_of(episode, job.seed, job.options())
    run = watch(scenario)
    columns = measure(run, scenario)
    contacts = ("contacts_person_all", "contacts_others_all", "contacts_walls")
    asr = not any(columns[name] for name in contacts)
    sr = asr and float(columns["regain_s"] or 0.0) <= episode.max_search_steps * STEP_S
    successes = {"sr": sr, "asr": asr}
    return _labels(episode) | successes | columns | {"trajectory": run.trajectory_sha256[:16]}


def scenario_of(episode: Episode, seed: int, settings: dict[str, Any] | None = None) -> Scenario:
    """Return an episode with the robot nexus at the place of the benchmark's robot.

    The robot faces the target at the start, since its camera does not see all around. Beside the
    target it remains on the side of its start. People have the planned paths and the speed of the
    episode, a walking body, and give way by the social force of mecazen.
    """
    grid = Grid(episode)
    centre, target = episode.robot.compose(Pose2D(robot.CENTRE)), episode.target.start
    yaw = math.atan2(target.y - centre.y, target.x - centre.x)
    tables: dict[str, Any] = {
        "robot": str(named_file("nexus", "robot")),
        "seed": seed,
        "services": ["physics", "controller", "target", "crowd", "sensors", "follower", "guard"],
        "sim": {"mode": "lockstep", "duration_s": episode.max_steps * STEP_S},
        "start": {"x_m": centre.x, "y_m": centre.y, "yaw_deg": math.degrees(yaw)},
        "sensor": {"kind": "fused"},
        "target": {"path": _path(episode.target, grid)},
        "crowd": {"walkers": [{"path": _path(walk, grid)} for walk in episode.humans]},
        "world": {
            "person": {"radius_m": robot.PERSON_RADIUS},
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
        "follower": {"view": _view(episode), "standoff_m": DISTANCE_M, "planner": {}},
    }
    return from_tables(tables, Path(episode.name), settings or {})


def _view(episode: Episode) -> str:
    """Return the view for the episode's place; beside the target it is that of the nearer side."""
    if episode.place == "back":
        return "back"
    start, (x, y) = episode.target.start, episode.target.goals[0]
    walks = start._replace(yaw=math.atan2(y - start.y, x - start.x))
    return "side_left" if walks.between(episode.robot).y >= 0.0 else "side_right"


def _path(walk: Walk, grid: Grid) -> dict[str, Any]:
    return {
        "kind": "goal",
        "x_m": walk.start.x,
        "y_m": walk.start.y,
        "yaw_deg": math.degrees(walk.start.yaw),
        "via_m": [list(place) for place in grid.path(walk)[:-1]],
        "goal_m": list(walk.goals[-1]),
        "speed_m_s": SPEED_M_S,
    }


def _episode(job: Job) -> Episode:
    if job.file is None:
        raise ConfigError("files: must name episodes of Follow-Bench")
    return read(job.file)


def _labels(episode: Episode) -> dict[str, Value]:
    """Return what tables group by; people are those besides the target."""
    kind = "open" if episode.cls in CROWDS else "layout" if episode.cls in LAYOUTS else "track"
    labels = {"kind": kind, "class": episode.cls, "place": episode.place}
    return labels | {"people": len(episode.humans)}
