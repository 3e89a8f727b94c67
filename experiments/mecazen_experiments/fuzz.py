"""The program `fuzz`: a minute of a robot among obstacles, with a person who comes near.

The seed draws the room, the commands and the person's walk. `set` of a study has the options of
`Options`; all other settings are those of the scenario.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from mecazen import messages as m
from mecazen.arrays import to_rectangle
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.keys import CMD_VEL, GROUND_TRUTH, GUARD_STATE, TARGET_CMD_VEL, TARGET_ODOM
from mecazen.keys import TARGET_SKELETON as SKELETON
from mecazen.loading import convert, from_tables, named_file
from mecazen.schema import NonNegative, Section
from mecazen.ticks import ROUNDING_S
from mecazen.wire import encode
from mecazen_tools.observe import PersonOverTime, Samples, observe
from mecazen_tools.plane import Plane
from mecazen_tools.table import Table

from mecazen_experiments.safety import contacts, gap_to_walls, onsets

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

MINUTE_S = 60.0
ROOM_M = 7.0
"""Length of the walls [m]."""
CLEAR_M = 0.5
"""Minimum distance of a walking person from obstacles [m]."""
BRAKING_M_S2 = 6.0
"""Acceleration and deceleration of the person: from 1.8 m/s in 0.3 s."""
STEERING_1_S, TURN_RAD_S = 4.0, 2.0
"""Gain and maximum of the turning rate of a person who walks at the robot."""
COMMAND_TICKS = 5
"""Number of ticks between commands to the robot: 20 Hz."""
FASTEST_M_S, FASTEST_RAD_S = 2.5, 4.0
"""Limits of the commands; the wheels reach less."""


class Options(Section):
    """What happens in a minute."""

    speed_m_s: NonNegative = 1.0
    """Speed of the person when walking: anywhere, or at the robot."""


def fuzz(job: Job) -> dict[str, float | str]:
    """Drive for a minute; return contacts, least gaps and the share of time with a reduced command.

    `caused` are the contacts that the robot caused, see `safety.Contacts`, and `contacts` all with
    the person; `walls` are those with obstacles. `closing_m_s` is the highest speed of robot and
    person towards each other at the begin of a contact.
    """
    settings = job.options()
    chosen = {name: settings.pop(name) for name in Options.__struct_fields__ if name in settings}
    options = convert(chosen, Options, "fuzz")
    chance = np.random.Generator(np.random.PCG64(job.seed))
    scenario = room(job.seed, chance, settings)
    rider = Rider(chance, scenario, options)
    topics = GROUND_TRUTH, TARGET_ODOM, SKELETON, GUARD_STATE
    table, sha256, samples = observe(scenario, *topics, drive=rider.drive)
    robot = table.poses("robot")
    person = _person(samples[SKELETON.key], table)
    touched = contacts(scenario.robot, robot, person, table.tick_s)
    walls = gap_to_walls(scenario, robot)
    target = table.poses("target")
    distance = np.hypot(target.x - robot.x, target.y - robot.y)
    closing = -np.gradient(distance, table.tick_s)[touched.rows]
    reduced = {state.header.stamp.ns for state in samples[GUARD_STATE.key] if state.factor < 1.0}
    return {
        "contacts": len(touched.rows),
        "caused": int(touched.caused.sum()),
        "walls": len(onsets(walls)),
        "gap_person_m": float(np.nanmin(touched.gap_m)),
        "gap_walls_m": float(walls.min()),
        "closing_m_s": float(closing.max(initial=0.0)),
        "driven_m": float(np.sum(np.hypot(np.diff(robot.x), np.diff(robot.y)))),
        "reduced_percent": 100.0 * len(reduced) / len(table),
        "time_s": len(table) * table.tick_s,
        "trajectory": sha256[:16],
    }


def _person(bodies: list[m.Skeleton], table: Table) -> PersonOverTime:
    """Return the person at every tick, where the newest body until then was."""
    times = np.array([body.header.stamp.ns / 1e9 for body in bodies])
    newest = np.searchsorted(times, table["t_s"] + ROUNDING_S) - 1
    joints = np.array([[(joint.x, joint.y, joint.z) for joint in body.joints] for body in bodies])
    return PersonOverTime(joints[np.maximum(newest, 0)], bodies[0].height)


def room(seed: int, chance: np.random.Generator, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario: a room with boxes and pillars, a robot and a person in it."""
    half, thin = ROOM_M / 2.0, 0.2
    obstacles: list[dict[str, Any]] = [
        {"kind": "box", "size_m": [*size, 1.0], "position_m": [sign * x, sign * y]}
        for size, x, y in (((ROOM_M, thin), 0.0, half), ((thin, ROOM_M), half, 0.0))
        for sign in (1.0, -1.0)
    ]
    free = [Pose2D(x, y) for x in (-2.0, 0.0, 2.0) for y in (-2.0, 0.0, 2.0)]
    chance.shuffle(free)
    robot, person, *places = free
    for number, (x, y, _) in enumerate(places[:4]):
        place = [x + chance.uniform(-0.4, 0.4), y + chance.uniform(-0.4, 0.4)]
        if number % 2:
            size = [chance.uniform(0.05, 0.25), 1.5]
            obstacles.append({"kind": "cylinder", "size_m": size, "position_m": place})
        else:
            size = [chance.uniform(0.1, 0.9), chance.uniform(0.1, 0.9), 1.0]
            yaw = chance.uniform(-180.0, 180.0)
            obstacles.append({"kind": "box", "size_m": size, "position_m": place, "yaw_deg": yaw})
    tables = {
        "robot": "nexus.toml",
        "seed": seed,
        "services": ["physics", "controller", "target"],
        "programs": {"physics": f"{Plane.__module__}:{Plane.__name__}"},
        "sim": {"duration_s": MINUTE_S},
        "start": {"x_m": robot.x, "y_m": robot.y, "yaw_deg": chance.uniform(-180.0, 180.0)},
        "sensor": {"also": ["lidar"]},
        "world": {"obstacles": obstacles},
        "target": {"path": {"kind": "driven", "x_m": person.x, "y_m": person.y}},
    }
    return from_tables(tables, named_file("nexus", "robot"), settings)


class Rider:
    """Commands the person and the robot by chance."""

    def __init__(self, chance: np.random.Generator, scenario: Scenario, options: Options) -> None:
        self._chance, self._options = chance, options
        self._solids = [_rectangle(solid) for solid in scenario.world.obstacles]
        self._clear_m = CLEAR_M + scenario.world.person.radius_m
        self._tick_s = scenario.sim.tick_s
        self._command, self._command_until, self._at_person = Twist2D(), 0, False
        self._walk, self._walk_until, self._at_robot = Twist2D(), 0, False
        self._speed = 0.0

    def drive(self, tick: int, samples: Samples) -> Mapping[str, bytes]:
        """Return the commands of a tick; none before robot and person are known."""
        if not (samples[GROUND_TRUTH.key] and samples[TARGET_ODOM.key]):
            return {}
        robot, person = (
            samples[topic.key][-1].pose.pose.to_planar() for topic in (GROUND_TRUTH, TARGET_ODOM)
        )
        commands = {}
        if tick % COMMAND_TICKS == 0:
            commands[CMD_VEL.key] = encode(m.Twist.planar(self.command(tick, robot, person)))
        walk = encode(m.Twist.planar(self.walk(tick, robot, person)))
        return commands | {TARGET_CMD_VEL.key: walk}

    def command(self, tick: int, robot: Pose2D, person: Pose2D) -> Twist2D:
        """Return the commanded twist of the robot: by chance, or straight at the person."""
        if tick >= self._command_until:
            self._command_until = tick + int(self._chance.integers(5, 300))
            kind = int(self._chance.integers(6))
            x, y = self._chance.uniform(-FASTEST_M_S, FASTEST_M_S, 2).tolist()
            yaw = float(self._chance.uniform(-FASTEST_RAD_S, FASTEST_RAD_S))
            reversed_twist = Twist2D(*(-part for part in self._command))
            special = {1: reversed_twist, 2: Twist2D(yaw=yaw), 3: Twist2D(x=x)}
            self._at_person = kind == 0
            self._command = special.get(kind, Twist2D(x, y, 0.3 * yaw))
        if not self._at_person:
            return self._command
        to_person, speed = robot.between(person), abs(self._command.x)
        along = math.atan2(to_person.y, to_person.x)
        return Twist2D(speed * math.cos(along), speed * math.sin(along), self._command.yaw)

    def walk(self, tick: int, robot: Pose2D, person: Pose2D) -> Twist2D:
        """Return the twist of the person: stand and turn, walk on, or walk at the robot."""
        if tick >= self._walk_until:
            self._walk_until = tick + int(self._chance.integers(100, 400))
            kind = self._chance.integers(3)
            self._at_robot = bool(kind == 2)
            yaw = float(self._chance.uniform(-1.0, 1.0))
            self._walk = Twist2D(x=self._options.speed_m_s * bool(kind), yaw=yaw)
        c, s = math.cos(person.yaw), math.sin(person.yaw)
        ahead = all(self._is_free(person.x + d * c, person.y + d * s) for d in (0.3, 0.6, 0.9))
        step = BRAKING_M_S2 * self._tick_s
        self._speed += min(max(self._walk.x * ahead - self._speed, -step), step)
        yaw = 0.0 if self._speed else self._walk.yaw
        if self._at_robot:
            bearing = wrap(math.atan2(robot.y - person.y, robot.x - person.x) - person.yaw)
            yaw = min(max(STEERING_1_S * bearing, -TURN_RAD_S), TURN_RAD_S)
        return Twist2D(x=self._speed, yaw=yaw)

    def _is_free(self, x: float, y: float) -> bool:
        """Return whether a person can stand at a point, clear of obstacles."""
        points = ((place.between(Pose2D(x, y)), half) for place, half in self._solids)
        return all(to_rectangle(point.x, point.y, half) > self._clear_m for point, half in points)


def _rectangle(solid: Box | Cylinder) -> tuple[Pose2D, tuple[float, float]]:
    """Return the pose of an obstacle, and half the length and half the width of its footprint."""
    if isinstance(solid, Cylinder):
        return Pose2D(*solid.position_m), (solid.size_m[0], solid.size_m[0])
    length, width, _ = solid.size_m
    return Pose2D(*solid.position_m, math.radians(solid.yaw_deg)), (length / 2.0, width / 2.0)
