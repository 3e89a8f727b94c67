"""Checks at the start of a run: steps divide the tick, robots stand in free space."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mecazen.config import Scenario
from mecazen.config.people import Passerby
from mecazen.config.services import MAX_DT_S
from mecazen.config.world import Box
from mecazen.errors import ConfigError

from mecazen_physics.footprint import Footprint
from mecazen_physics.world import reachable


def steps_per_tick(tick_s: float, dt_s: float) -> int:
    """Return the number of physics steps in a control period."""
    steps = round(tick_s / dt_s)
    if steps < 1 or not math.isclose(steps * dt_s, tick_s, rel_tol=1e-9):
        most = math.ceil(tick_s / dt_s)
        allowed = [tick_s / number for number in (most, most - 1) if number > 0]
        which = ", ".join(repr(step) for step in allowed if step <= MAX_DT_S)
        raise ConfigError(
            f"physics.dt_s = {dt_s:g} must divide sim.tick_s = {tick_s:g}; nearest: {which}"
        )
    return steps


def check_obstacles(scenario: Scenario, name: str) -> None:
    """Refuse a robot that starts inside an obstacle."""
    for solid in scenario.world.solids:
        if solid.bottom_m < scenario.robot.height:
            kind = "box" if isinstance(solid, Box) else "cylinder"
            at = ", ".join(f"{value:g}" for value in solid.position_m)
            _check(scenario, name, Footprint.of_obstacle(solid), f"{kind} at [{at}]; move it")


def check_added(scenario: Scenario, known: Mapping[str, object], robot: Footprint) -> None:
    """Refuse what is added to the `known` things of a world, if it would be inside a robot.

    Raises:
        ConfigError: It would be; or a robot could drive onto an obstacle.
    """
    low = reachable(scenario.robot, scenario.world)
    for name, thing in scenario.world.added.items():
        if isinstance(thing, Passerby):
            place = Footprint(thing.path.x_m, thing.path.y_m, rim=scenario.world.person.radius_m)
        else:
            place = Footprint.of_obstacle(thing)
        is_in_reach = isinstance(thing, Passerby) or thing in low
        if is_in_reach and known.get(name) != thing and robot.gap(place) < 0.0:
            at = f"[{robot.x:.2f}, {robot.y:.2f}]"
            raise ConfigError(f"{name}: would be inside the robot, which is at {at}")


def check_person(scenario: Scenario, name: str, x: float, y: float) -> None:
    """Refuse a robot that starts inside its person at x, y [m]: it could only crawl away."""
    where = f"person, who is at [{x:g}, {y:g}]; move it, or target.path"
    _check(scenario, name, Footprint(x, y, rim=scenario.world.person.radius_m), where)


def _check(scenario: Scenario, name: str, obstacle: Footprint, what: str) -> None:
    robot = Footprint.of_robot(scenario.robot.footprint, scenario.start.pose, 0.0, 0.0)
    if robot.gap(obstacle) < 0.0:
        key = f"robots.{name}.start" if name else "start"
        raise ConfigError(f"{key}: the robot stands inside the {what}")
