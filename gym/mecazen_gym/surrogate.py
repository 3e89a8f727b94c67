"""The program `surrogate` of studies: the gap between full physics and the plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mecazen.config import Scenario
from mecazen.geometry import Twist2D
from mecazen.portable import Floats
from mecazen_tools.simulation import Simulation, load
from mecazen_tools.table import wrap

from mecazen_gym.follow import FollowEnv
from mecazen_gym.planar import Effects, PlanarRobots

PERIOD_S = 0.1
"""Time for which an action holds."""
HORIZONS_S = 1, 5, 20
"""Times after which places and headings are compared, within the scenario's duration."""
UNLIMITED = {
    f"controller.limits.{axis}.max_acceleration_{unit}": math.inf
    for axis, unit in (("x", "m_s2"), ("y", "m_s2"), ("yaw", "rad_s2"))
}


def surrogate(job: Any) -> dict[str, float | bool | None]:
    """Replay the actions of a job in full physics and on the plane; return the differences.

    The actions are those of the scenario's follower; without a follower, the seed draws them. In
    the columns `all` is the plane with all effects, and an effect's name the plane without it. Once
    robot and person have touched in full physics, the differences are those of `touched_…`.
    """
    scenario = job.load()
    env = FollowEnv(scenario, period_s=PERIOD_S, far_m=math.inf)
    try:
        horizons = [horizon for horizon in HORIZONS_S if horizon < scenario.sim.duration_s]
        steps = round(max(horizons) / PERIOD_S)
        if "follower" in scenario.services:
            actions = commanded(scenario, env, steps)
        else:
            actions = np.random.default_rng(job.seed).uniform(-1.0, 1.0, (steps, 3))
        env.reset(seed=job.seed)
        poses, contact_s = np.empty((steps, 3)), math.inf
        for step, action in enumerate(actions):
            *_, is_contact, _, info = env.step(action)
            poses[step] = info["robot"]
            contact_s = min(contact_s, info["time_s"] if is_contact else math.inf)
    finally:
        env.close()
    columns: dict[str, float | bool | None] = {}
    for name, plane in planes(scenario).items():
        dx, dy, turn = (replayed(plane, actions * env.scale) - poses).T
        place_mm, heading_deg = 1e3 * np.hypot(dx, dy), np.degrees(np.abs(wrap(turn)))
        for horizon in horizons:
            step, has_touched = round(horizon / PERIOD_S) - 1, contact_s <= horizon
            columns[f"contact_{horizon}"] = has_touched
            for prefix, is_shown in (("", not has_touched), ("touched_", has_touched)):
                place, heading = float(place_mm[step]), float(heading_deg[step])
                columns[f"{prefix}{name}_{horizon}_mm"] = place if is_shown else None
                columns[f"{prefix}{name}_{horizon}_deg"] = heading if is_shown else None
    return columns


def commanded(scenario: Scenario, env: FollowEnv, steps: int) -> Floats:
    """Return the actions (steps, 3) of the scenario's follower in full physics."""
    actions = np.zeros((steps, 3))
    with Simulation(scenario) as sim:
        for action in actions:
            command = sim.state.command
            action[:] = env.action(command or Twist2D())
            sim.run(PERIOD_S)
    return actions


def planes(scenario: Scenario) -> dict[str, PlanarRobots]:
    """Return the robot on the plane with all effects, and without each."""
    effects, none = Effects.from_scenario(scenario), Effects()
    return {
        "all": PlanarRobots(scenario, 1),
        "gain": PlanarRobots(scenario, 1, effects._replace(gain=none.gain)),
        "limits": PlanarRobots(load(scenario, UNLIMITED), 1, effects),
        "lag": PlanarRobots(scenario, 1, effects._replace(lag_s=0.0, delay_ticks=0)),
        "slip": PlanarRobots(scenario, 1, effects._replace(grip=none.grip, force=none.force)),
    }


def replayed(robots: PlanarRobots, twists: Floats) -> Floats:
    """Return the poses (steps, 3) after each wanted twist (steps, 3) of a single robot."""
    ticks = np.empty((round(PERIOD_S / robots.tick_s), 3, 1))
    poses = np.empty_like(twists)
    for pose, twist in zip(poses, twists, strict=True):
        robots.drive(twist[:, None], ticks)
        pose[:] = ticks[-1, :, 0]
    return poses
