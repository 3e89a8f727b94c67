"""Drives a guarded robot at random among obstacles and a person, and counts contacts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mecazen import messages as m
from mecazen.arrays import to_rectangle
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import (
    CMD_VEL,
    GROUND_TRUTH,
    GUARD_STATE,
    TARGET_CMD_VEL,
    TARGET_ODOM,
    TARGET_SKELETON,
)
from mecazen.loading import from_tables, parse_settings
from mecazen.skeleton import INDEX, SIDES
from mecazen.ticks import ROUNDING_S
from mecazen.wire import encode
from mecazen_tools.observe import Samples, collect
from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Floats, Poses

from mecazen_experiments.config import Settings
from mecazen_experiments.freezes import freeze
from mecazen_experiments.gaps import drives_at, gap_to_obstacle, onsets, to_outline
from mecazen_experiments.jobs import Job, Key, fingerprint, version
from mecazen_experiments.report import Kind, Record
from mecazen_experiments.statistics import most_per_hour

ROLLERS = ("programs={}",)
"""Settings for driving in DART instead of a plane without slip: many times slower."""
FOLLOWED = ('services=["physics", "controller", "target", "follower"]',)
"""Settings for a follower that drives the robot, instead of random commands."""
EPISODE_S = 60.0
ROOM_M = 7.0
"""Length of the walls [m]."""
CLEAR_M = 0.5
"""Minimum distance of a walking person from obstacles [m]."""
BRAKING_M_S2 = 6.0
"""Deceleration of the person: from 1.8 m/s in 0.3 s."""
COMMAND_TICKS = 5
"""Number of ticks between commands to the robot: 20 Hz."""
FOOT_M = 0.04
"""Radius around each joint of the feet [m]."""
FASTEST_M_S, FASTEST_RAD_S = 2.5, 4.0
"""Limits of the commands; the wheels reach less."""

FEET = [INDEX[f"{side}_{name}"] for side in SIDES for name in ("ankle", "heel", "foot")]


class Episode(msgspec.Struct, frozen=True):
    """The scores of a minute."""

    contacts: int
    """Number of contacts with people that the robot caused, see `gaps.drives_at`, and with
    obstacles."""
    contacts_all: int
    """Number of all contacts."""
    least_gap_m: float
    driven_m: float
    held: float
    """Share of the time in which the guard reduced the command."""


def jobs(seeds: Iterable[int], robot: Path, settings: Settings = ()) -> list[Job]:
    """Return jobs of one minute for each seed, which determines room, commands and person.

    Args:
        seeds: One seed per minute.
        robot: The robot file.
        settings: Overrides of the settings of the rooms.
    """
    sha256 = fingerprint(_scenario(0, _random(0), robot, settings))
    return [Job("minute", None, robot, settings, Key(sha256, seed, version())) for seed in seeds]


def _measure(job: Job, *, freezes: bool) -> tuple[Episode, str]:
    """Drive at random for a minute, in a room made from a seed."""
    random = _random(job.key.seed)
    scenario = _scenario(job.key.seed, random, job.scenario, job.settings)
    rider = _Rider(random, scenario)
    topics = GROUND_TRUTH, TARGET_ODOM, TARGET_SKELETON, GUARD_STATE
    with Simulation(scenario) as sim:
        if freezes:
            freeze(sim, job.key.seed)
        samples = collect(sim, *topics, drive=rider.drive)
        sha256 = sim.trajectory.sha256()
    truth, person, bodies, guarded = samples.values()
    gaps, ahead, walls = _gaps(scenario, truth, person, bodies)
    every = np.fmin(gaps, walls)
    begins = onsets(gaps)
    caused = int(np.sum(drives_at(gaps, ahead, scenario.sim.tick_s)[begins]))
    held = {state.header.stamp.ns: state.factor < 1.0 for state in reversed(guarded)}
    places = [odom.pose.pose.to_planar() for odom in truth]
    episode = Episode(
        caused + len(onsets(walls)),
        len(begins) + len(onsets(walls)),
        float(every.min()),
        sum(after.distance(before) for before, after in pairwise(places)),
        sum(held.values()) / scenario.sim.ticks,
    )
    return episode, sha256


def _gaps(
    scenario: Scenario,
    truth: Sequence[m.Odometry],
    person: Sequence[m.Odometry],
    bodies: Sequence[m.Skeleton],
) -> tuple[Floats, Floats, Floats]:
    """Return the gaps (n) [m] to the person, now and after the robot's next move, and to obstacles.

    They are 0 or less in contact.
    """
    robot = scenario.robot
    poses = Poses(*np.array([odom.pose.pose.to_planar() for odom in truth]).T)
    later = Poses(*(np.append(column[1:], column[-1]) for column in poses))
    walls = [gap_to_obstacle(robot, poses, thing) for thing in scenario.world.obstacles]
    to_person: list[list[Floats]] = [[], []]
    centres = [[odom.pose.pose.to_planar()[:2]] for odom in person]
    feet = [[(body.joints[n].x, body.joints[n].y) for n in FEET] for body in bodies]
    for samples, points, radius in (
        (person, centres, scenario.world.person.radius_m),
        (bodies, feet, FOOT_M),
    ):
        # a moving robot is compared with the person's position a tick ago
        at = np.searchsorted(_times(samples), _times(truth)) - 1
        around = np.array([np.full_like(points[0], np.nan), *points])[at + 1]
        for found, of in zip(to_person, (poses, later), strict=True):
            found += list((to_outline(of, robot.footprint, around) - radius).T)
    now, ahead = (np.fmin.reduce(found) for found in to_person)
    return now, ahead, np.fmin.reduce(walls)


def _times(samples: Sequence[Any]) -> list[int]:
    return [sample.header.stamp.ns for sample in samples]


EPISODE, FREEZES = (
    Kind(name, Record[Episode], partial(_measure, freezes=freezes), msgspec.structs.asdict)
    for name, freezes in (("fuzz", False), ("freezes", True))
)
"""Contacts of a guarded robot in a minute, without and with services that freeze."""


def tell(done: Iterable[Record[Episode]]) -> str:
    """Return a line that reports the contacts in some minutes."""
    done = list(done)
    if not done:
        return "nothing is driven yet"
    scores = [one.scores for one in done]
    touched = [str(one.key.seed) for one in done if one.scores.contacts]
    contacts = sum(one.contacts for one in scores)
    return (
        f"{len(done)} min, {sum(one.driven_m for one in scores):.0f} m driven, held "
        f"{sum(one.held for one in scores) / len(done):.0%} of the time, least gap "
        f"{min(one.least_gap_m for one in scores):.3f} m, "
        f"contacts {sum(one.contacts_all for one in scores)}, {contacts} of them caused by the "
        f"robot, at most {most_per_hour(contacts, len(done) / 60.0):.1f} per hour"
    ) + (f" with seeds {', '.join(touched)}" if touched else "")


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
        "programs": {"physics": "mecazen_tools.plane:Plane"},
        "sim": {"duration_s": EPISODE_S},
        "start": {"x_m": robot.x, "y_m": robot.y, "yaw_deg": turned},
        "sensor": {"also": ["lidar"]},
        "world": {"obstacles": obstacles},
        "target": {"path": {"kind": "driven", "x_m": person.x, "y_m": person.y}},
    }
    return from_tables(tables, file, parse_settings(settings))


class _Rider:
    """Commands the robot and the person at random."""

    def __init__(self, random: np.random.Generator, scenario: Scenario) -> None:
        self._random = random
        self._things = [(_place(thing), _half(thing)) for thing in scenario.world.obstacles]
        self._radius = scenario.world.person.radius_m
        self._tick_s = scenario.sim.tick_s
        self._commands = "follower" not in scenario.services
        self._robot, self._robot_until = Twist2D(), 0
        self._at_person = False
        self._wanted, self._person_until = Twist2D(), 0
        self._speed = 0.0

    def drive(self, tick: int, samples: Samples) -> Mapping[str, bytes]:
        """Return the commands of a tick; none before robot and person are known."""
        seen = [samples[topic.key] for topic in (GROUND_TRUTH, TARGET_ODOM)]
        if not all(seen):
            return {}
        robot, person = (odometry[-1].pose.pose.to_planar() for odometry in seen)
        put = {}
        if tick % COMMAND_TICKS == 0 and self._commands:
            put[CMD_VEL.key] = encode(m.Twist.planar(self.command(tick, robot, person)))
        seen_s = samples[TARGET_ODOM.key][-1].header.stamp.ns / 1e9
        is_frozen = (tick - 1) * self._tick_s > seen_s + ROUNDING_S
        if is_frozen:  # otherwise the person would jump afterwards
            self._speed = 0.0
        walk = m.Twist() if is_frozen else m.Twist.planar(self.walk(tick, person))
        return put | {TARGET_CMD_VEL.key: encode(walk)}

    def _is_free(self, x: float, y: float) -> bool:
        """Return whether a person can stand at a point, clear of obstacles."""
        return all(
            from_outline(at, half, x, y) > CLEAR_M + self._radius for at, half in self._things
        )

    def command(self, tick: int, robot: Pose2D, person: Pose2D) -> Twist2D:
        """Return the commanded twist of the robot."""
        if tick >= self._robot_until:
            self._robot_until = tick + int(self._random.integers(5, 300))
            self._robot = self._next(self._robot)
        to, twist = robot.between(person), self._robot
        if self._at_person:
            along = math.atan2(to.y, to.x)
            speed = abs(twist.x)
            twist = Twist2D(speed * math.cos(along), speed * math.sin(along), twist.yaw)
        return twist

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

    def walk(self, tick: int, person: Pose2D) -> Twist2D:
        """Return the twist of the person in a tick."""
        if tick >= self._person_until:
            self._person_until = tick + int(self._random.integers(100, 400))
            speed = float(self._random.uniform(0.3, 1.8)) * bool(self._random.integers(2))
            self._wanted = Twist2D(x=speed, yaw=float(self._random.uniform(-1.0, 1.0)))
        c, s = math.cos(person.yaw), math.sin(person.yaw)
        ahead = all(self._is_free(person.x + d * c, person.y + d * s) for d in (0.3, 0.6, 0.9))
        step = BRAKING_M_S2 * self._tick_s
        wanted = self._wanted.x if ahead else 0.0
        self._speed += min(max(wanted - self._speed, -step), step)
        return Twist2D(x=self._speed, yaw=0.0 if self._speed else self._wanted.yaw)


def _place(thing: Box | Cylinder) -> Pose2D:
    yaw_deg = thing.yaw_deg if isinstance(thing, Box) else 0.0
    return Pose2D(*thing.position_m, math.radians(yaw_deg))


def _half(thing: Box | Cylinder) -> tuple[float, float]:
    """Return half the length and half the width of an obstacle's footprint."""
    if isinstance(thing, Cylinder):
        return thing.size_m[0], thing.size_m[0]
    return thing.size_m[0] / 2.0, thing.size_m[1] / 2.0


def from_outline(robot: Pose2D, half: tuple[float, float], x: float, y: float) -> float:
    """Return the distance of a point from an outline at `robot` [m]; negative inside."""
    at = robot.between(Pose2D(x, y))
    return float(to_rectangle(at.x, at.y, half))
