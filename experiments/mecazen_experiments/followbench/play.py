"""Plays an episode of Follow-Bench: in each step the robot moves, then the target, then others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config.world import Box
from mecazen.geometry import Pose2D
from mecazen.portable import Floats

from mecazen_experiments.followbench import sight, unicycle
from mecazen_experiments.followbench.episodes import Episode, Walk
from mecazen_experiments.followbench.pedestrians.grid import Grid
from mecazen_experiments.followbench.pedestrians.walkers import Errand, Other, Outline, Walkers
from mecazen_experiments.followbench.unicycle import Unicycle
from mecazen_experiments.followbench.view import Planner, Seen, View

OUTLINE = Outline(
    ahead=unicycle.CENTRE + unicycle.HALF[0],
    behind=unicycle.HALF[0] - unicycle.CENTRE,
    side=unicycle.HALF[1],
    yaw=0.0,
)
"""The robot's outline relative to its axle, which people avoid."""


class Record(NamedTuple):
    """The course of an episode: row 0 is the start, row k the state after step k."""

    robot: Floats
    """Poses of the rear axle (k, 3)."""
    target: Floats
    """Places of the target (k, 2) [m]."""
    humans: Floats
    """Places of the others (k, n, 2) [m]."""
    visible: npt.NDArray[np.bool_]
    """Whether the target is visible (k)."""
    collided: bool
    """Whether the last step ended in a contact."""
    max_steps: int
    max_search_steps: int
    step_s: float


class World:
    """The people of an episode, and the robot among them."""

    def __init__(self, episode: Episode) -> None:
        self.episode = episode
        self.boxes: Floats = np.array(episode.boxes).reshape(-1, 5)
        obstacles, grid = _obstacles(episode), grid_of(episode)
        # as in Follow-Bench, people also avoid the centres of boxes and an object at the origin
        self._things = [Other(0.0, 0.0, 0.0, 0.0, 0.0)]
        for x, y, yaw, length, width in episode.boxes:
            outline = Outline(length / 2.0, length / 2.0, width / 2.0, yaw)
            self._things.append(Other(x, y, 0.0, 0.0, 0.0, outline))

        def walkers(walks: tuple[Walk, ...]) -> Walkers:
            errands = [_errand(walk) for walk in walks]
            radius = unicycle.PERSON_RADIUS
            return Walkers(errands, obstacles, radius, episode.manners, grid)

        self.target, self.humans = walkers((episode.target,)), walkers(episode.humans)
        self.robot = Unicycle(episode.robot)
        self.steps = 0
        self.ranges: Floats = np.full(sight.BEAMS, sight.RANGE)
        self._known = sight.KnownArea()

    def step(self, v: float, w: float) -> bool:
        """Advance by a step; return whether the robot touches anything after its own move."""
        dt, time = self.episode.step_s, (self.steps + 1) * self.episode.step_s
        self.robot = self.robot.step(v, w, dt, self.episode.size)
        touches = unicycle.touches(self.robot.pose, self.places, self.boxes)
        self.ranges = sight.scan(self.robot.pose, self.places, self.boxes)
        self._known.update(self.ranges)
        pose = self.robot.pose
        vx, vy = _velocity(self.robot)
        robot = Other(pose.x, pose.y, vx, vy, 0.0, OUTLINE._replace(yaw=pose.yaw))
        humans = [_other(person) for person in self.humans.states]
        unheeded = robot._replace(is_heeded=False)
        self.target.step(time, dt, [unheeded, *self._things, *humans])
        self.humans.step(time, dt, [robot, *self._things, _other(self.target.states[0])])
        self.steps += 1
        return touches

    @property
    def places(self) -> Floats:
        """The target's place, then those of the others (1 + n, 2) [m]."""
        return np.array([one[:2] for one in (*self.target.states, *self.humans.states)])

    def sees(self) -> list[bool]:
        """Return whether the robot sees the target, then each of the others."""
        seen: list[bool] = self._known.sees(self.robot.pose, self.places).tolist()
        return seen

    def view(self, seen: list[bool]) -> View:
        """Return the planner's view of the world."""
        target, *humans = (Seen(*one) for one in (*self.target.states, *self.humans.states))
        return View(
            self.steps * self.episode.step_s,
            self.robot.pose,
            self.robot.v,
            self.robot.w,
            target if seen[0] else None,
            tuple(one for one, is_seen in zip(humans, seen[1:], strict=True) if is_seen),
            self.ranges,
            self.episode.place,
            self.episode.distance,
        )


def play(episode: Episode, planner: Planner, seed: int) -> Record:
    """Play an episode, which ends at the first contact, and return its record."""
    world = World(episode)
    planner.reset(seed)
    seen = world.sees()
    robot, places, visible = [world.robot.pose], [world.places], [seen[0]]
    touches = False
    while not touches and world.steps < episode.max_steps:
        touches = world.step(*planner.command(world.view(seen)))
        seen = world.sees()
        robot.append(world.robot.pose)
        places.append(world.places)
        visible.append(seen[0])
    everybody = np.array(places)
    return Record(
        robot=np.array(robot),
        target=everybody[:, 0],
        humans=everybody[:, 1:],
        visible=np.array(visible),
        collided=touches,
        max_steps=episode.max_steps,
        max_search_steps=episode.max_search_steps,
        step_s=episode.step_s,
    )


def grid_of(episode: Episode) -> Grid:
    """Return the grid of an episode.

    As in Follow-Bench, people avoid blocked cells only within a square at the origin.
    """
    grid = Grid(_obstacles(episode), (0.0, 0.0), episode.size, episode.inflation_cells)
    side = min(grid.heeded.shape)
    grid.heeded[side:] = False
    grid.heeded[:, side:] = False
    return grid


def _obstacles(episode: Episode) -> list[Box]:
    return [
        Box(size_m=(length, width, 1.0), position_m=(x, y), yaw_deg=float(np.degrees(yaw)))
        for x, y, yaw, length, width in episode.boxes
    ]


def _errand(walk: Walk) -> Errand:
    return Errand(
        walk.start,
        walk.goals,
        safe=walk.safe_dist,
        plans=walk.plans,
        within=walk.goal_threshold,
    )


def _other(state: tuple[float, float, float, float]) -> Other:
    return Other(*state, unicycle.PERSON_RADIUS)


def _velocity(robot: Unicycle) -> tuple[float, float]:
    ahead = Pose2D(yaw=robot.pose.yaw).compose(Pose2D(robot.v))
    return ahead.x, ahead.y
