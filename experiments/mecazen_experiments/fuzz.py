"""Drives a guarded robot at random among things and a person, and counts what it touches."""

from __future__ import annotations

import gc
import math
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D, Twist2D, overlap, wrap
from mecazen.graph import TABLE
from mecazen.keys import (
    CMD_VEL,
    GROUND_TRUTH,
    GUARD_STATE,
    JOINT_COMMAND,
    JOINT_STATES,
    TARGET_CMD_VEL,
    TARGET_ODOM,
    TARGET_SKELETON,
)
from mecazen.loading import from_tables
from mecazen.node import Inputs, Outputs, Tick, World
from mecazen.robot import WHEEL_JOINTS
from mecazen.skeleton import INDEX
from mecazen.wire import encode
from mecazen_controller.kinematics import MecanumKinematics, WheelSpeeds
from mecazen_tools.simulate import InProcess

from mecazen_experiments.config import Settings
from mecazen_experiments.jobs import Job, Key, check_version, fingerprint, version

ROLLERS = ("programs={}",)
"""Settings with which the robot drives in DART, not in a plane without slip: many times slower."""
EPISODE_S = 60.0
ROOM_M = 7.0
"""Length of the walls."""
CLEAR_M = 0.5
"""Of the robot and of the person at the start, from anything else."""
WHEEL_LAG_S = 0.02
"""Time constant of the plane world's wheels."""
BRAKING_M_S2 = 6.0
"""Of the person: from 1.8 m/s in 0.3 s."""
COMMAND_TICKS = 5
"""The robot is commanded at 20 Hz."""
NEAR_M = 0.5
"""Gaps that are larger are not looked at."""
FOOT_M = 0.04
"""Radius about each joint of the feet."""
AWAY = math.radians(70.0)
"""The person walks only straight away from the robot, or up to this angle past it."""
FASTEST_M_S, FASTEST_RAD_S = 2.5, 4.0
"""Of commands; the wheels reach less."""


class Plane(World):
    """A robot whose wheels roll without slip, for a world without physics."""

    ROW = TABLE["physics"]

    def reset(self, seed: int) -> None:
        """Stand at the start."""
        self.pose, self.speeds = self.scenario.start.pose, np.zeros(4)
        self.kinematics = MecanumKinematics.of(self.scenario.robot)

    def step(self, tick: Tick, inputs: Mapping[str, Inputs]) -> Mapping[str, Outputs]:
        """Roll for a tick."""
        command = inputs[""].get(JOINT_COMMAND)
        if command is not None:
            lag = 1.0 - math.exp(-tick.period_s / WHEEL_LAG_S)
            self.speeds += lag * (np.array(command.velocity) - self.speeds)
        twist = self.kinematics.forward(WheelSpeeds(*self.speeds.tolist()))
        if tick.number:
            self.pose = self.pose.integrate(twist, tick.period_s)
        header = m.Header(stamp=tick.time)
        joints = m.JointState(header, WHEEL_JOINTS, velocity=tuple(self.speeds.tolist()))
        truth = m.planar_odometry(tick.time, "world", "base_link", self.pose, twist)
        return {"": {JOINT_STATES: joints, GROUND_TRUTH: truth}}


class Episode(msgspec.Struct, frozen=True):
    """What came of a minute."""

    key: Key
    contacts: int
    """Times at which the outline began to touch something."""
    least_gap_m: float
    driven_m: float
    held: float
    """Share of the time in which the guard let through less than was commanded."""


def jobs(seeds: Iterable[int], robot: Path, settings: Settings = ()) -> list[Job]:
    """Return minutes to drive, one for each seed: of the room, the commands and the person.

    Args:
        seeds: As many as minutes.
        robot: The robot file.
        settings: Override those of the rooms.
    """
    sha256 = fingerprint(_scenario(0, _random(0), robot, settings))
    return [Job("minute", None, robot, settings, Key(sha256, seed, version())) for seed in seeds]


def episode(job: Job) -> Episode:
    """Drive at random for a minute, in a room made from a seed.

    Raises:
        MecazenError: The run failed, or this process has another version of the code.
    """
    check_version(job)
    gc.collect()  # reference cycles hold the last run's world
    random = _random(job.key.seed)
    scenario = _scenario(job.key.seed, random, job.scenario, job.settings)
    with closing(InProcess(scenario)) as run:
        world, rider = _World(run, scenario), _Rider(random)
        run.begin()
        for tick in range(1, scenario.sim.ticks):
            run.clock.await_answers()
            if world.robot is not None and world.person is not None:
                if tick % COMMAND_TICKS == 0:
                    command = m.Twist.planar(rider.command(tick, world))
                    run.bus.put_bytes(CMD_VEL.key, encode(command, "json"))
                walk = m.Twist.planar(rider.walk(tick, world))
                run.bus.put_bytes(TARGET_CMD_VEL.key, encode(walk, "json"))
            run.step()
        run.end()
    return Episode(
        job.key, world.contacts, world.least_gap, world.driven, world.held / scenario.sim.ticks
    )


def tell(done: Iterable[Episode]) -> str:
    """Return what came of some minutes, in a line."""
    done = list(done)
    if not done:
        return "nothing is driven yet"
    touched = [one.key.seed for one in done if one.contacts]
    return (
        f"{len(done)} min, {sum(one.driven_m for one in done):.0f} m driven, held "
        f"{sum(one.held for one in done) / len(done):.0%} of the time, least gap "
        f"{min(one.least_gap_m for one in done):.3f} m, "
        f"contacts {sum(one.contacts for one in done)}"
    ) + (f" with seeds {', '.join(map(str, touched))}" if touched else "")


def _random(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def _scenario(seed: int, random: np.random.Generator, file: Path, settings: Settings) -> Scenario:
    """Return a scenario: a room with boxes and pillars, a robot and a person in it."""
    half, thin = ROOM_M / 2.0, 0.2
    obstacles: list[dict[str, Any]] = [
        {"kind": "box", "size_m": [*size, 1.0], "position_m": at}
        for size, at in (
            ([ROOM_M, thin], [0.0, half]),
            ([ROOM_M, thin], [0.0, -half]),
            ([thin, ROOM_M], [half, 0.0]),
            ([thin, ROOM_M], [-half, 0.0]),
        )
    ]
    free = [Pose2D(x, y) for x in (-2.0, 0.0, 2.0) for y in (-2.0, 0.0, 2.0)]
    random.shuffle(free)
    robot, person, *others = free
    for number, place in enumerate(others[:4]):
        at = [place.x + random.uniform(-0.4, 0.4), place.y + random.uniform(-0.4, 0.4)]
        if number % 2:
            obstacles.append(
                {"kind": "cylinder", "size_m": [random.uniform(0.05, 0.25), 1.5], "position_m": at}
            )
        else:
            size = [random.uniform(0.1, 0.9), random.uniform(0.1, 0.9), 1.0]
            yaw = random.uniform(-180.0, 180.0)
            obstacles.append({"kind": "box", "size_m": size, "position_m": at, "yaw_deg": yaw})
    turned = math.degrees(random.uniform(-math.pi, math.pi))
    tables: dict[str, Any] = {
        "robot": file.name,
        "seed": seed,
        "services": ["physics", "controller", "target"],
        "programs": {"physics": "mecazen_experiments.fuzz:Plane"},
        "sim": {"duration_s": EPISODE_S},
        "start": {"x_m": robot.x, "y_m": robot.y, "yaw_deg": turned},
        "sensor": {"also": ["lidar"]},
        "world": {"obstacles": obstacles},
        "target": {"path": {"kind": "driven", "x_m": person.x, "y_m": person.y}},
    }
    return from_tables(tables, file, settings)


class _World:
    """Where everybody is, and what the robot touches."""

    def __init__(self, run: InProcess, scenario: Scenario) -> None:
        self._half = scenario.robot.footprint
        self._things = [(_place(thing), _half(thing), thing) for thing in scenario.world.obstacles]
        self._radius = scenario.world.person.radius_m
        self.robot: Pose2D | None = None
        self.person: Pose2D | None = None
        self._feet: list[tuple[float, float]] = []
        self._touches, self._last_ns = False, -1
        self.contacts, self.least_gap, self.driven, self.held = 0, math.inf, 0.0, 0
        run.bus.subscribe(GROUND_TRUTH, self._on_robot)
        run.bus.subscribe(TARGET_ODOM, self._on_person)
        run.bus.subscribe(TARGET_SKELETON, self._on_skeleton)
        run.bus.subscribe(GUARD_STATE, self._on_guard)

    def _on_robot(self, odom: m.Odometry, _: object) -> None:
        last, self.robot = self.robot, odom.pose.pose.to_planar()
        self.driven += self.robot.distance(last or self.robot)
        gap = min(self._gaps(self.robot))
        self.least_gap = min(self.least_gap, gap)
        touches = gap < 0.0
        self.contacts += touches and not self._touches
        self._touches = touches

    def _on_person(self, odom: m.Odometry, _: object) -> None:
        self.person = odom.pose.pose.to_planar()

    def _on_skeleton(self, body: m.Skeleton, _: object) -> None:
        joints = [
            body.joints[INDEX[f"{side}_{name}"]]
            for side in ("left", "right")
            for name in ("ankle", "heel", "foot")
        ]
        self._feet = [(joint.x, joint.y) for joint in joints]

    def _on_guard(self, state: m.GuardState, _: object) -> None:
        self.held += state.factor < 1.0 and state.header.stamp.ns > self._last_ns
        self._last_ns = state.header.stamp.ns

    def _gaps(self, robot: Pose2D) -> list[float]:
        """Return the distance of the outline from each thing and from the person [m]."""
        reach = NEAR_M + math.hypot(*self._half)
        gaps = [NEAR_M]
        for at, half, thing in self._things:
            if from_outline(at, half, robot.x, robot.y) < reach:
                gaps.append(gap(robot, self._half, thing))
        if self.person is not None:
            gaps.append(from_outline(robot, self._half, *self.person[:2]) - self._radius)
        return gaps + [from_outline(robot, self._half, *foot) - FOOT_M for foot in self._feet]

    def is_free(self, x: float, y: float) -> bool:
        """Return whether somebody could stand at a place."""
        return all(
            from_outline(at, half, x, y) > CLEAR_M + self._radius for at, half, _ in self._things
        )


class _Rider:
    """Who commands the robot and the person, at random."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._robot, self._robot_until = Twist2D(), 0
        self._at_person = False
        self._wanted, self._person_until = Twist2D(), 0
        self._speed = 0.0

    def command(self, tick: int, world: _World) -> Twist2D:
        """Return the twist that the robot is to have; it is known where both are."""
        assert world.robot is not None
        assert world.person is not None
        if tick >= self._robot_until:
            self._robot_until = tick + int(self._random.integers(5, 300))
            self._robot = self._next(self._robot)
        to = world.robot.between(world.person)
        robot = self._robot
        if self._at_person:
            along = math.atan2(to.y, to.x)
            speed = abs(robot.x)
            robot = Twist2D(speed * math.cos(along), speed * math.sin(along), robot.yaw)
        return robot

    def _next(self, last: Twist2D) -> Twist2D:
        kind = self._random.integers(6)
        self._at_person = bool(kind == 0)
        x, y = self._random.uniform(-FASTEST_M_S, FASTEST_M_S, 2)
        yaw = self._random.uniform(-FASTEST_RAD_S, FASTEST_RAD_S)
        made = Twist2D(float(x), float(y), float(yaw))
        if kind == 1:
            return Twist2D(-last.x, -last.y, -last.yaw)
        if kind == 2:
            return Twist2D(yaw=made.yaw)
        if kind == 3:
            return Twist2D(x=made.x)
        return made._replace(yaw=0.3 * made.yaw)

    def walk(self, tick: int, world: _World) -> Twist2D:
        """Return the twist of the person in a tick."""
        robot, person = world.robot, world.person
        assert robot is not None
        assert person is not None
        if tick >= self._person_until:
            self._person_until = tick + int(self._random.integers(100, 400))
            speed = float(self._random.uniform(0.3, 1.8)) * bool(self._random.integers(2))
            self._wanted = Twist2D(x=speed, yaw=float(self._random.uniform(-1.0, 1.0)))
        from_robot = math.atan2(person.y - robot.y, person.x - robot.x)
        c, s = math.cos(person.yaw), math.sin(person.yaw)
        ahead = all(world.is_free(person.x + d * c, person.y + d * s) for d in (0.3, 0.6, 0.9))
        walks = ahead and abs(wrap(from_robot - person.yaw)) < AWAY
        step = BRAKING_M_S2 * 0.01
        wanted = self._wanted.x if walks else 0.0
        self._speed += min(max(wanted - self._speed, -step), step)
        return Twist2D(x=self._speed, yaw=0.0 if self._speed else self._wanted.yaw)


def _place(thing: Box | Cylinder) -> Pose2D:
    yaw_deg = thing.yaw_deg if isinstance(thing, Box) else 0.0
    return Pose2D(*thing.position_m, math.radians(yaw_deg))


def _half(thing: Box | Cylinder) -> tuple[float, float]:
    """Return half the length and half the width of what a thing stands on."""
    if isinstance(thing, Cylinder):
        return thing.size_m[0], thing.size_m[0]
    return thing.size_m[0] / 2.0, thing.size_m[1] / 2.0


def gap(robot: Pose2D, half: tuple[float, float], thing: Box | Cylinder) -> float:
    """Return the distance of an outline from a thing [m]; negative where they overlap."""
    x, y = thing.position_m
    if isinstance(thing, Cylinder):
        return from_outline(robot, half, x, y) - thing.size_m[0]
    other = _place(thing)
    size = _half(thing)
    # of two rectangles that are apart, a corner of one is nearest; overlapping ones are 0 or less
    apart = [
        from_outline(one, extent, corner.x, corner.y)
        for one, extent, two, its in ((robot, half, other, size), (other, size, robot, half))
        for corner in (
            two.compose(Pose2D(a * its[0], b * its[1])) for a in (1, -1) for b in (1, -1)
        )
    ]
    return -1e-6 if overlap(robot, half, other, size) and min(apart) > 0.0 else min(apart)


def from_outline(robot: Pose2D, half: tuple[float, float], x: float, y: float) -> float:
    """Return the distance of a point from an outline at `robot` [m]; inside negative."""
    at = robot.between(Pose2D(x, y))
    dx, dy = abs(at.x) - half[0], abs(at.y) - half[1]
    return math.hypot(max(dx, 0.0), max(dy, 0.0)) + min(max(dx, dy), 0.0)
