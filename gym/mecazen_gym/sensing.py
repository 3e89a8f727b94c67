"""Many persons and the sensors that see them, as arrays, with repeatable random numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
from mecazen.config import Scenario
from mecazen.config.people import Driven, Goal
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from mecazen_people.motion import with_gait
from mecazen_people.paths import make_path
from mecazen_target.sensor import latency_ticks

from mecazen_gym.planar import Ints, between

Words = npt.NDArray[np.uint64]
Mask = npt.NDArray[np.bool_]

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio: the increment of SplitMix64."""
LEVELS = 2**16
"""Number of values of a drawn number; four are drawn at once."""
NEVER = -(2**40)
"""A tick long before the first."""
FRAME, FAULT, ODOMETRY, EPISODE = range(4)
"""Kinds of random numbers, each with its own numbers of draws."""


def scrambled(words: Words) -> Words:
    """Return the outputs of SplitMix64 for its states (n), which may be any numbers.

    G. L. Steele et al., Fast splittable pseudorandom number generators, OOPSLA 2014. An output
    depends on its state alone: so does each environment on its seed, whatever others do.
    """
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))


def draw(streams: Words, kind: int, number: npt.ArrayLike) -> Ints:
    """Return four independent numbers from 0 to `LEVELS` - 1 for each stream (4, n).

    `number` is that of the draw, for all streams or for each (n).
    """
    counter = np.atleast_1d(np.asarray(number, np.uint64)) * np.uint64(4) + np.uint64(kind)
    words = scrambled(streams + (counter + np.uint64(1)) * GOLDEN)
    shifts = np.arange(0, 64, 16, dtype=np.uint64)[:, None]
    return ((words >> shifts) & np.uint64(LEVELS - 1)).astype(np.int64)


def uniform(drawn: Ints) -> Floats:
    """Return drawn numbers as uniform ones, in the middles of `LEVELS` parts of 0 to 1."""
    return (drawn + 0.5) / LEVELS


NORMAL: Floats = np.array([NormalDist().inv_cdf((k + 0.5) / LEVELS) for k in range(LEVELS)])
"""The normal distribution's quantile for each drawn number; the largest is 4.3."""


class Persons:
    """The persons of `n` environments, each on one of some walks, from one table of poses.

    A walk is the `target` of a scenario; it needs poses for `ticks`, at the highest speed.
    """

    def __init__(self, scenarios: Sequence[Scenario], ticks: int, n: int) -> None:
        tables = [_poses(scenario, ticks) for scenario in scenarios]
        moved = [(table != table[:, :1]).any(axis=0) for table in tables]
        self._first = np.array([row.argmax() if row.any() else ticks for row in moved])
        self._poses = np.ascontiguousarray(np.concatenate(tables, axis=1))
        self._ticks = ticks
        self._walk: Ints = np.zeros(n, np.int64)
        self._speed: Floats | None = None

    def reset(self, envs: Ints, walks: Ints, speeds: Floats | None) -> None:
        """Let some persons begin walks (k), at speeds (k) with the given factors."""
        self._walk[envs] = walks
        if speeds is not None:
            self._speed = np.ones(len(self._walk)) if self._speed is None else self._speed
            self._speed[envs] = speeds

    def at(self, ticks: Ints, envs: Ints | slice = slice(None)) -> Floats:
        """Return the poses in world (3, k) of some persons at ticks (k); yaw is not wrapped."""
        begin = self._walk[envs] * self._ticks
        if self._speed is None:
            return self._poses.take(begin + np.clip(ticks, 0, self._ticks - 1), axis=1)
        times = np.clip(ticks * self._speed[envs], 0.0, self._ticks - 2.0)
        whole = times.astype(np.int64)
        before, after = (self._poses.take(begin + whole + k, axis=1) for k in (0, 1))
        poses: Floats = before + (times - whole) * (after - before)
        return poses

    def have_moved(self, ticks: Ints) -> Mask:
        """Return whether each person has moved at ticks (n): then the scores count."""
        times = ticks if self._speed is None else ticks * self._speed
        moved: Mask = times > self._first[self._walk] - 1
        return moved


def _poses(scenario: Scenario, ticks: int) -> Floats:
    """Return the person's pose at each tick (3, ticks), as target has it."""
    config = scenario.target
    if isinstance(config.path, Driven | Goal):
        kind = config.path.__struct_config__.tag
        raise ConfigError(f"target.path.kind = {kind!r}: the plane needs a path known in advance")
    path, tick_s = make_path(config.path), scenario.sim.tick_s
    motions = [path.at(tick * tick_s) for tick in range(ticks)]
    if config.gait is not None and "skeleton" not in scenario.features:
        motions = [with_gait(motion, config.gait) for motion in motions]
    poses = np.array([motion.pose for motion in motions]).T
    poses[2] = np.unwrap(poses[2])
    return poses


class PoseSensors:
    """The sensors "pose" of `n` robots, with the settings of a scenario.

    Attributes:
        seen: The person in base_link at the newest frame that showed them (3, n).
        seen_tick: Tick of that frame's capture (n); far in the past if there is none.
        past: Ticks before the present for which `observe` needs poses.
    """

    def __init__(self, scenario: Scenario, n: int, persons: Persons) -> None:
        self._config, self._persons = scenario.sensor, persons
        tick_s = scenario.sim.tick_s
        self._every = scenario.ticks_per("sensor.rate_hz")
        self._latency = latency_ticks(self._config, tick_s)
        self._occlusions = np.rint(np.array(self._config.occlusions_s).reshape(-1, 2) / tick_s)
        self._nowhere = np.array(scenario.follower.standoff.person(Pose2D()))[:, None]
        yaw = math.radians(self._config.yaw_std_deg)
        self._std = np.array((self._config.position_std_m, self._config.position_std_m, yaw))
        self.past = self._latency + self._every
        self.seen, self.seen_tick = np.zeros((3, n)), np.zeros(n, np.int64)
        self.streams = np.zeros(n, np.uint64)
        """Streams of the random numbers (n)."""
        self.noise = np.ones(n)
        """Factor of the noise of each sensor (n)."""

    def reset(self, envs: Ints, streams: Words, noise: Floats | None) -> None:
        """Forget some persons, until a frame shows them, and take new streams and noise (k)."""
        self.seen[:, envs], self.seen_tick[envs] = self._nowhere, NEVER
        self.streams[envs] = streams
        if noise is not None:
            self.noise[envs] = noise

    def observe(self, envs: Ints, begin: Ints, end: Ints, poses: Floats, newest: Ints) -> None:
        """Take the newest frame after the tick `begin` (n), until `end`, that shows the person.

        `poses` are those of the robots (rows, 3, n) at successive ticks, the last at `newest` (n).
        """
        back = 0
        while envs.size:
            frame = end[envs] // self._every - back
            is_due = frame * self._every > begin[envs]
            envs, frame, back = envs[is_due], frame[is_due], back + 1
            capture = frame * self._every - self._latency
            pose, is_seen = self._frame(envs, frame, capture, poses, newest)
            shown = envs[is_seen]
            self.seen[:, shown], self.seen_tick[shown] = pose[:, is_seen], capture[is_seen]
            envs = envs[~is_seen]

    def _frame(
        self, envs: Ints, frame: Ints, capture: Ints, poses: Floats, newest: Ints
    ) -> tuple[Floats, Mask]:
        """Return the persons in base_link (3, k) as a frame measures them, and which are seen."""
        config = self._config
        row = np.maximum(len(poses) - 1 - newest[envs] + capture, 0)
        robot, person = poses[row, :, envs].T, self._persons.at(capture, envs)
        pose, (dx, dy, _) = between(robot, person), person - robot
        distance = np.sqrt(dx * dx + dy * dy)
        drawn = draw(self.streams[envs], FRAME, frame)
        is_seen = (capture >= 0) & (distance <= config.max_range_m)
        is_seen &= uniform(drawn[3]) >= config.dropout_probability
        if config.fov_deg < 360.0:
            is_seen &= pose[0] >= math.cos(math.radians(config.fov_deg / 2.0)) * distance
        for hidden, shown in self._occlusions:
            is_seen &= (capture < hidden) | (capture >= shown)
        pose += NORMAL[drawn[:3]] * self._std[:, None] * self.noise[envs]
        faults = config.faults
        if faults.outlier_probability or faults.flip_probability:
            drawn = draw(self.streams[envs], FAULT, frame)
            outlying, direction, flipped, _ = uniform(drawn)
            offset = np.where(outlying < faults.outlier_probability, faults.outlier_m, 0.0)
            pose[0] += offset * np.cos(math.tau * direction)
            pose[1] += offset * np.sin(math.tau * direction)
            pose[2] += np.where(flipped < faults.flip_probability, math.pi, 0.0)
        return pose, is_seen
