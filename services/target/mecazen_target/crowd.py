"""The crowd: all people in the world, including the walkers that this node simulates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.config.people import Body, Goal, Passerby, Recorded, Walker
from mecazen.errors import ConfigError
from mecazen.keys import GROUND_TRUTH, PEOPLE, TARGET_ODOM, TARGET_SKELETON, of_robot
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.robots import seed_of
from mecazen_people.body.recording import height_of
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.crowd import Pedestrians, agent_at, errand_of, random_errands
from mecazen_people.motion import PersonMotion, PersonPath
from mecazen_people.paths import check_path, make_path

ROBOT_MARGIN_M = 0.1
"""People keep farther from a robot's corners than from each other."""
MISSED_AT_MOST = 50
"""Maximum number of missed steps that are caught up in one tick after a delay."""


class AddedPerson(NamedTuple):
    """A person who was added to the world, and the time of the first sample [s]."""

    config: Passerby
    path: PersonPath
    body: WalkingPerson | None
    begin_s: float


class CrowdNode(Node):
    """Publishes the poses of all people and robots: followed persons, walkers, and robots."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = config = scenario.crowd
        self.period = scenario.ticks_per("sensors.skeleton_rate_hz")
        if any(name.startswith("walker_") for name in scenario.names):
            raise ConfigError("robots: names that begin with walker_ are those of the crowd")
        self.paths = [_path(scenario, n, walker) for n, walker in enumerate(config.walkers)]
        self.stays = {
            number: (walker.path.start_after_s, path.duration)
            for number, (walker, path) in enumerate(zip(config.walkers, self.paths, strict=True))
            if walker.enters_and_leaves and isinstance(walker.path, Recorded) and path is not None
        }
        """When walkers who enter and leave are present: from and to [s], by number."""
        self.errands = [errand_of(w.path) for w in config.walkers if isinstance(w.path, Goal)]
        bodies = [walker.body for walker in config.walkers]
        if config.reactive is not None:
            self.paths += [None] * config.reactive.count
            bodies += [config.reactive.body] * config.reactive.count
        self.heights = [height_of(body) for body in bodies]
        self.made: dict[Body, WalkingPerson] = {}
        self.bodies = [self._body(body) for body in bodies]
        self.radius = scenario.world.person.radius_m
        self.reach = {
            name: math.hypot(*scenario.of(name).robot.footprint) + ROBOT_MARGIN_M
            for name in scenario.names
        }

    def _body(self, config: Body) -> WalkingPerson | None:
        """Return a body if a sensor sees it; equal ones share their gait, which takes 0.2 s."""
        if "skeleton" not in self.scenario.sensor.features:
            return None
        if config not in self.made:
            self.made[config] = WalkingPerson(config)
        return self.made[config].twin()

    def configure(self, scenario: Scenario) -> None:
        super().configure(scenario)
        if self.pedestrians is not None:
            self.pedestrians.surround(scenario.world.solids)

    def reset(self, seed: int) -> None:
        self.seed = seed
        self.last = 0
        self.robots: dict[str, m.Odometry] = {}
        self.targets: dict[str, m.Odometry] = {}
        self.skeletons: dict[str, m.Skeleton] = {}
        self.pedestrians: Pedestrians | None = None
        self.motions: dict[int, PersonMotion] = {}
        """The last motions of the walkers who are present, by number."""
        self.added: dict[str, AddedPerson] = {}

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return all people and robots, in ticks in which a sample is due."""
        for name in self.scenario.names:
            self.robots[name] = inputs[of_robot(GROUND_TRUTH, name)]
            if (odometry := inputs.get(of_robot(TARGET_ODOM, name))) is not None:
                self.targets[name] = odometry
            if (skeleton := inputs.get(of_robot(TARGET_SKELETON, name))) is not None:
                self.skeletons[name] = skeleton
        if tick.number % self.period:
            return {}
        missed, is_first = tick.number - self.last, self.pedestrians is None
        self.last = tick.number
        steps = min(missed // self.period, MISSED_AT_MOST)
        gap_s = None if is_first else missed * self.scenario.sim.tick_s
        added = list(self._passersby(tick.time_ns / 1e9, gap_s))
        persons = []
        for name, odometry in self.targets.items():
            skeleton = self.skeletons.get(name, m.Skeleton())
            pose, twist = odometry.pose.pose, odometry.twist.twist
            persons.append(
                m.Person(name or "target", pose, twist, skeleton.height, skeleton.joints)
            )
        before, time_s = self.motions, tick.time_ns / 1e9
        self.motions = self._walk(time_s, steps, [*persons, *added])
        for number, motion in self.motions.items():
            name, height, body = f"walker_{number + 1}", self.heights[number], self.bodies[number]
            age_s = gap_s if number in before else None
            persons.append(_person(name, motion, height, body, age_s, self.seed, number))
        persons += added
        robots = [
            m.NamedPose(name or "robot", m.Pose.planar(odometry.pose.pose.to_planar()))
            for name, odometry in self.robots.items()
        ]
        header = m.Header(stamp=tick.time, frame_id="world")
        return {PEOPLE: m.People(header, tuple(persons), tuple(robots))}

    def _passersby(self, time: float, gap_s: float | None) -> Iterator[m.Person]:
        """Yield the people who were added to the world, at a time [s]."""
        passersby = self.scenario.world.passersby
        self.added = {n: p for n, p in self.added.items() if passersby.get(n) == p.config}
        for name, config in passersby.items():
            is_new = name not in self.added
            if is_new:
                body = self._body(Body(height_m=config.height_m))
                self.added[name] = AddedPerson(config, make_path(config.path), body, time)
            person = self.added[name]
            motion, seed = person.path.at(time - person.begin_s), seed_of(self.seed, name)
            age_s = None if is_new else gap_s
            yield _person(name, motion, config.height_m, person.body, age_s, seed)

    def _walk(self, time: float, steps: int, others: Sequence[m.Person]) -> dict[int, PersonMotion]:
        """Return the motions of walkers who are present at a time [s], by number.

        The time is a number of steps after the last one. They give way to all others.
        """
        motions = {
            number: path.at(time)
            for number, path in enumerate(self.paths)
            if path is not None and self._is_present(number, path, time)
        }
        agents = [agent_at(*motion[:2], self.radius) for motion in motions.values()]
        agents += [
            agent_at(person.pose.to_planar(), person.twist.to_planar(), self.radius)
            for person in others
        ]
        for name, robot in self.robots.items():
            pose, twist = robot.pose.pose.to_planar(), robot.twist.twist.to_planar()
            agents.append(agent_at(pose, twist, self.reach[name]))
        if self.pedestrians is None:
            obstacles, errands = self.scenario.world.solids, list(self.errands)
            if self.config.reactive is not None:
                occupied = [a[:2] for a in agents] + [errand.start[:2] for errand in errands]
                errands += random_errands(self.config.reactive, self.seed, occupied, obstacles)
            self.pedestrians = Pedestrians(errands, obstacles, self.radius, self.seed)
        for _ in range(steps):
            self.pedestrians.step(time, self.period * self.scenario.sim.tick_s, agents)
        reacting = [number for number, path in enumerate(self.paths) if path is None]
        motions |= zip(reacting, self.pedestrians.motions, strict=True)
        return dict(sorted(motions.items()))

    def _is_present(self, number: int, path: PersonPath, time: float) -> bool:
        """Return whether a walker is present; who enters waits until no robot is in the way."""
        if number not in self.stays:
            return True
        begin, end = self.stays[number]
        if number in self.motions or not begin <= time < end:
            return begin <= time < end
        place = path.at(time).pose
        return all(
            odometry.pose.pose.to_planar().distance(place) > self.reach[name] + self.radius
            for name, odometry in self.robots.items()
        )

    def diagnostics(self) -> dict[str, object]:
        return {"walkers": len(self.paths) + len(self.added)}


def _person(
    name: str,
    motion: PersonMotion,
    height: float,
    body: WalkingPerson | None,
    gap_s: float | None,
    *seed: int,
) -> m.Person:
    """Return a person, `gap_s` [s] after their last sample; None in the first one."""
    joints: tuple[m.Point, ...] = ()
    if body is not None:
        posture = body.reset(motion, *seed) if gap_s is None else body.follow(motion, gap_s)
        joints = tuple([m.Point(*joint) for joint in posture.joints.tolist()])
    pose, twist = m.Pose.planar(motion.pose), m.Twist.planar(motion.twist)
    return m.Person(name, pose, twist, height, joints)


def _path(scenario: Scenario, number: int, walker: Walker) -> PersonPath | None:
    """Return the path of a walker; None if the walker reacts to others."""
    if isinstance(walker.path, Goal):
        return None
    try:
        path = make_path(walker.path)
        check_path(path, scenario.world, height_of(walker.body), scenario.sim.duration_s)
    except ConfigError as error:
        raise ConfigError(f"crowd.walkers.{number}.path: {error}") from None
    return path
