"""The social-force follower of Follow-Bench as a node: a reference beside our follower.

A driving force towards the goal and exponential repulsions (Helbing & Molnár, Phys. Rev. E 51,
1995) change the robot's velocity; the robot then turns into this velocity as a unicycle. The
formulas and parameters are those of Follow-Bench's planner (Ye et al., arXiv 2509.10796), including
two peculiarities that affect its results. Clusters of the scan repel as obstacles although some are
people. The direction vectors from clusters are divided by the norm of all vectors together. Unlike
there, the target is known even where it is out of sight, and a cluster repels from its mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.config import Scenario
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.keys import CMD_VEL, GROUND_TRUTH, ODOM, PEOPLE, SCAN
from mecazen.messages import Twist
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.portable import Floats, exp
from mecazen.row import Row, due, every
from mecazen.scan import clusters, ranges_of
from mecazen_people.crowd import Agent, agent_at

from mecazen_experiments.followbench.episodes import DISTANCE_M, STEP_S

SPEED_M_S, GAIN = 3.0, 1.3
"""Desired and maximum speed (the robot's own limit is lower), gain of the driving force [1/s]."""
ARRIVED_M, STILL_M = 0.7, 0.05
"""Distance to the goal below which the desired speed is 0, and below which the robot stops if the
goal has not moved farther."""
PEOPLE_FORCE, THINGS_FORCE, SAFE_M = (7.0, 0.5), (10.0, 0.5), 0.3
"""Strength [m/s²] and reach [m] of the repulsion by people and by clusters of the scan, and the
distance at which they repel with this strength."""
SIGHT_M, TARGET_M = 5.0, 0.5
"""Distances beyond which people and clusters do not repel, and within which clusters are part of
the target."""
TURN_RAD_S, TURN_S, ALIGNED_RAD, SLOW_M_S = 2.0, 0.2, 0.1, 0.02
"""Maximum yaw rate, time of a turn, angle below which no turn is needed, speed that counts as 0."""
STANDING_M_S = 0.01
"""Below this speed, a person keeps the previous heading."""
REACH_M, LEAST = 0.5, 3
"""Greatest distance of neighbours in a cluster, and the least number of its points."""


class SocialFollower(Node):
    """Follows the person by social forces, with the true poses of robot and people."""

    ROW = Row(
        "follower",
        inputs=(every(ODOM), every(GROUND_TRUTH), due(PEOPLE), due(SCAN)),
        outputs=(CMD_VEL,),
    )

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self._is_behind = scenario.follower.view == "back"
        lidar = scenario.robot.lidar
        self._lidar = lidar.pose if lidar else Pose2D()  # without one there is no scan
        self._ticks = round(STEP_S / scenario.sim.tick_s)

    def reset(self, seed: int) -> None:
        """Begin a run; nothing is drawn at random."""
        self._heading, self._twist = 0.0, Twist2D()
        self._goal = math.inf, math.inf

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the twist, which changes with each step of Follow-Bench."""
        if tick.number % self._ticks == 0 and (people := inputs.get(PEOPLE)) is not None:
            robot = inputs[GROUND_TRUTH].pose.pose.to_planar()
            speed = inputs[ODOM].twist.twist.to_planar().x
            agents = {
                person.id: agent_at(person.pose.to_planar(), person.twist.to_planar(), 0.0)
                for person in people.persons
            }
            target = agents.pop("target")
            things: list[tuple[float, float]] = []
            if (scan := inputs.get(SCAN)) is not None:
                groups = clusters(scan, ranges_of(scan), REACH_M, SIGHT_M)
                groups = groups.moved(robot.compose(self._lidar))
                things = [(x, y) for x, y in groups.middle[groups.counts >= LEAST].tolist()]
            self._twist = self._command(robot, speed, target, [*agents.values()], things)
        return {CMD_VEL: Twist.planar(self._twist)}

    def _command(
        self,
        robot: Pose2D,
        speed: float,
        target: Agent,
        humans: Sequence[Agent],
        things: Sequence[tuple[float, float]],
    ) -> Twist2D:
        if math.hypot(target.vx, target.vy) >= STANDING_M_S:
            self._heading = math.atan2(target.vy, target.vx)
        last, self._goal = self._goal, self._place(robot, target)
        x, y = self._goal[0] - robot.x, self._goal[1] - robot.y
        distance = math.hypot(x, y)
        if max(math.dist(last, self._goal), distance) < STILL_M:
            return Twist2D()
        vx, vy = speed * math.cos(robot.yaw), speed * math.sin(robot.yaw)
        drive = SPEED_M_S / distance if distance > ARRIVED_M else 0.0
        push_x, push_y = _push(robot, target, humans, things)
        vx += STEP_S * (GAIN * (drive * x - vx) + push_x)
        vy += STEP_S * (GAIN * (drive * y - vy) + push_y)
        scale = min(1.0, SPEED_M_S / max(math.hypot(vx, vy), 1e-9))
        return unicycle(robot.yaw, scale * vx, scale * vy)

    def _place(self, robot: Pose2D, target: Agent) -> tuple[float, float]:
        """Return the goal: behind the target at any bearing, or on its nearer side."""
        if self._is_behind:
            bearing = math.atan2(target.y - robot.y, target.x - robot.x)
            x, y = -DISTANCE_M * math.cos(bearing), -DISTANCE_M * math.sin(bearing)
            return target.x + x, target.y + y
        x, y = -DISTANCE_M * math.sin(self._heading), DISTANCE_M * math.cos(self._heading)
        sides = (target.x + x, target.y + y), (target.x - x, target.y - y)
        return min(sides, key=lambda side: math.dist(side, robot[:2]))


def _push(
    robot: Pose2D,
    target: Agent,
    humans: Sequence[Agent],
    things: Sequence[tuple[float, float]],
) -> tuple[float, float]:
    """Return the repulsion [m/s²] by people and by clusters of the scan."""
    away, ranges = _away(robot, [human[:2] for human in humans])
    x, y = _repulsion(away / ranges[:, None], ranges, *PEOPLE_FORCE)
    away, ranges = _away(robot, [at for at in things if math.dist(at, target[:2]) > TARGET_M])
    norm = math.sqrt(math.fsum((ranges * ranges).tolist()))
    things_x, things_y = _repulsion(away / max(norm, 1e-9), ranges, *THINGS_FORCE)
    return x + things_x, y + things_y


def _away(robot: Pose2D, places: Sequence[tuple[float, float]]) -> tuple[Floats, Floats]:
    """Return the vectors from near places to the robot (n, 2), and their lengths (n) [m]."""
    away = np.array(robot[:2]) - np.array(places).reshape(-1, 2)
    ranges = np.hypot(away[:, 0], away[:, 1])
    return away[ranges < SIGHT_M], ranges[ranges < SIGHT_M]


def _repulsion(away: Floats, ranges: Floats, strength: float, reach: float) -> tuple[float, float]:
    forces = strength * exp((SAFE_M - ranges) / reach)[:, None] * away
    return math.fsum(forces[:, 0].tolist()), math.fsum(forces[:, 1].tolist())


def unicycle(yaw: float, vx: float, vy: float) -> Twist2D:
    """Return the twist that turns a unicycle into a velocity, without backing up."""
    speed = math.hypot(vx, vy)
    if speed <= SLOW_M_S:
        return Twist2D()
    off = wrap(math.atan2(vy, vx) - yaw)
    turn = 0.0 if abs(off) < ALIGNED_RAD else max(-TURN_RAD_S, min(TURN_RAD_S, off / TURN_S))
    return Twist2D(max(speed * math.cos(off), 0.0), 0.0, turn)
