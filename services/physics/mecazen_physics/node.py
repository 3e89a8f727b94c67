"""Physics: the robots of a scenario in their world, as the clock advances it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.graph import TABLE
from mecazen.keys import (
    GROUND_TRUTH,
    JOINT_COMMAND,
    JOINT_STATES,
    PEOPLE,
    ROBOT_DESCRIPTION,
    TARGET_ODOM,
    TARGET_SKELETON,
    Call,
    Topic,
)
from mecazen.limits import FASTEST_PERSON
from mecazen.messages import (
    Header,
    JointState,
    Message,
    Odometry,
    People,
    Person,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    String,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from mecazen.node import Inputs, Outputs, Tick, World
from mecazen.robot import WHEEL_JOINTS, WHEELS
from mecazen.robots import join_key
from mecazen.skeleton import JOINTS
from mecazen.world import Box

from mecazen_physics.config import MAX_DT_S, PhysicsConfig
from mecazen_physics.footprint import Footprint
from mecazen_physics.motors import WheelCommand
from mecazen_physics.people import TOO_FAR, Floats, JointMotion, MovingPerson, Seen
from mecazen_physics.simulation import Simulation
from mecazen_physics.urdf import build_urdf, meshes

NEEDS_JOINTS = f"needs {len(JOINTS)} joints"
SLOW_DOWN_S = 1.0
"""Over this time the wheels are brought to rest when their controller has gone."""


class PhysicsWorld(World):
    """Robots with every roller, and what they can touch."""

    ROW = TABLE["physics"]

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = scenario.section(PhysicsConfig, "physics")
        self.steps_per_tick = _steps(scenario.sim.tick_s, self.config.dt_s)
        self.parts = {name: scenario.of(name) for name in scenario.names}
        for name, part in self.parts.items():
            _refuse_inside(part, name)
        self.has_legs = "skeleton" in scenario.sensor.features
        self.followed = {name or "target" for name in scenario.names}

    def reset(self, seed: int) -> None:
        """Put the robots back to the start, in a world made anew."""
        del seed
        self.world = self.make_world()
        self.walkers: dict[str, int] = {}
        """The numbers of those whom no robot follows, after those of the others."""
        self.walking: dict[int, MovingPerson] = {}
        """Those of them who were reported, unless that is too long ago."""
        self.motions: dict[str, JointMotion] = {}
        """Of those of them who have joints."""
        self.robots = {
            name: _Commanded(self.world, number, self.config.watchdog_s, part)
            for number, (name, part) in enumerate(self.parts.items())
        }

    def make_world(self) -> Simulation:
        """Return the world of a new run."""
        robots = [(part.robot, part.start.pose) for part in self.parts.values()]
        return Simulation(robots, self.config, self.scenario.world)

    def step(self, tick: Tick, inputs: Mapping[str, Inputs]) -> Mapping[str, Outputs]:
        """Simulate a control period; return the state of each robot at its end."""
        if tick.number > 0:
            if tick.number == 1:
                self._refuse_overlaps(inputs)
            commands = [robot.command(inputs[name]) for name, robot in self.robots.items()]
            self._place_walkers(next(iter(inputs.values())))
            self.world.advance(commands, self.steps_per_tick)
        return {name: robot.state(tick) for name, robot in self.robots.items()}

    def _refuse_overlaps(self, inputs: Mapping[str, Inputs]) -> None:
        """Refuse a start at which a robot and its person are in the same place.

        Raises:
            ConfigError: They are; the robot could only crawl away.
        """
        radius = self.scenario.world.person.radius_m
        for name, part in self.parts.items():
            if (odometry := inputs[name].get(TARGET_ODOM)) is None:
                continue
            x, y, _ = odometry.pose.pose.to_planar()
            if _footprint(part).gap(Footprint(x, y, rim=radius)) < 0.0:
                where = _of_robot("start", name)
                raise ConfigError(
                    f"{where}: the robot stands inside the person, who is at [{x:g}, {y:g}]; "
                    "move it, or target.path"
                )

    def _place_walkers(self, inputs: Inputs) -> None:
        """Put those whom no robot follows where they are; they stand where nobody says it."""
        people = inputs.get(PEOPLE)
        if people is not None:
            walkers = [one for one in people.persons if one.id not in self.followed]
            if self.has_legs and any(len(one.joints) != len(JOINTS) for one in walkers):
                inputs.refuse(PEOPLE, NEEDS_JOINTS)
                return
            self.walking = {self._number(one.id): self._walker(one, people) for one in walkers}
        elif inputs.age_s(PEOPLE) > self.config.watchdog_s:
            self.walking = {number: one.standing() for number, one in self.walking.items()}
        else:
            return
        for number, one in self.walking.items():
            self.world.place_person(number, one)
        if people is None:
            self.walking = {}

    def _number(self, walker: str) -> int:
        return self.walkers.setdefault(walker, len(self.robots) + len(self.walkers))

    def _walker(self, one: Person, people: People) -> MovingPerson:
        if not self.has_legs:
            return MovingPerson.upright(one.pose.to_planar(), _slowed(one.twist))
        motion = self.motions.setdefault(one.id, JointMotion(self.scenario.world.person.height_m))
        return motion.person(_positions(one.joints), people.header.stamp.ns / 1e9, one.height)

    def answer(self, call: Call[Any, Any], request: Message, robot: str) -> String:
        """Return a robot's URDF."""
        return String(data=build_urdf(self.parts[robot].robot))

    def files(self, robot: str) -> Mapping[str, Mapping[str, bytes]]:
        """Return the meshes that the URDF names."""
        return {ROBOT_DESCRIPTION.key: meshes(self.parts[robot].robot)}

    def diagnostics(self) -> dict[str, object]:
        """Return where the robots are."""
        values: dict[str, object] = {}
        for name, robot in self.robots.items():
            x, y, _ = robot.robot.state.position
            values[join_key("x_m", name)] = round(x, 3)
            values[join_key("y_m", name)] = round(y, 3)
        return values


def _refuse_inside(scenario: Scenario, name: str) -> None:
    """Refuse a robot that starts inside something.

    Raises:
        ConfigError: It does; the message says where that is.
    """
    robot = _footprint(scenario)
    for solid in scenario.world.solids:
        above = isinstance(solid, Box) and solid.bottom_m >= scenario.robot.height
        if not above and robot.gap(Footprint.of_obstacle(solid)) < 0.0:
            kind = "box" if isinstance(solid, Box) else "cylinder"
            at = ", ".join(f"{value:g}" for value in solid.position_m)
            raise ConfigError(
                f"{_of_robot('start', name)}: the robot stands inside the {kind} at [{at}]; move it"
            )


def _footprint(scenario: Scenario) -> Footprint:
    """Return a robot at its start, seen from above."""
    return Footprint.of_robot(scenario.robot.footprint, scenario.start.pose, 0.0, 0.0)


def _of_robot(key: str, name: str) -> str:
    return f"robots.{name}.{key}" if name else key


def _steps(tick_s: float, dt_s: float) -> int:
    """Return how many steps a control period has.

    Raises:
        ConfigError: It is not a whole number; the message names steps that are allowed.
    """
    steps = round(tick_s / dt_s)
    if steps < 1 or not math.isclose(steps * dt_s, tick_s, rel_tol=1e-9):
        most = math.ceil(tick_s / dt_s)
        allowed = [tick_s / number for number in (most, most - 1) if number > 0]
        which = ", ".join(repr(step) for step in allowed if step <= MAX_DT_S)
        raise ConfigError(
            f"physics.dt_s = {dt_s:g} must divide sim.tick_s = {tick_s:g}; nearest: {which}"
        )
    return steps


def _slowed(twist: Twist) -> Twist2D:
    """Return the velocity of somebody, as far as it counts."""
    x, y, _ = twist.to_planar()
    slower = FASTEST_PERSON / max(math.hypot(x, y), FASTEST_PERSON)
    return Twist2D(x * slower, y * slower)


class _Commanded:
    """A robot of the world: what commands it and the person beside it, and its state."""

    def __init__(
        self, world: Simulation, number: int, watchdog_s: float, scenario: Scenario
    ) -> None:
        self.world, self.number = world, number
        self.robot = world.robots[number]
        self.watchdog_s = watchdog_s
        self.has_legs = "skeleton" in scenario.sensor.features
        self.wheels = WheelCommand((0.0,) * len(WHEELS))
        self.last_speeds = self.wheels.values
        """Of the wheels [rad/s], when they were last commanded."""
        self.walking: MovingPerson | None = None
        """The person as last reported, unless that is too long ago."""
        self.motion = JointMotion(scenario.world.person.height_m)
        """Of a person who has joints."""
        self.seen = Seen()

    def command(self, inputs: Inputs) -> WheelCommand:
        """Place the person; return what the motors are to do, at rest where nobody says it."""
        joints = inputs.get(JOINT_COMMAND)
        if joints is not None:
            try:
                self.wheels = _wheel_command(joints)
            except KeyError:
                reason = f"needs a velocity or an effort of {WHEEL_JOINTS}"
                inputs.refuse(JOINT_COMMAND, reason)
        self._slow_down_if_silent(inputs.age_s(JOINT_COMMAND))
        person = self._skeleton(inputs) if self.has_legs else self._upright(inputs)
        topic: Topic[Any] = TARGET_SKELETON if self.has_legs else TARGET_ODOM
        if person is not None:
            self.walking = person
            self.world.place_person(self.number, person)
        elif self.walking is not None and inputs.age_s(topic) > self.watchdog_s:
            self.world.place_person(self.number, self.walking.standing())
            self.walking = None
        return self.wheels

    def _upright(self, inputs: Inputs) -> MovingPerson | None:
        person = inputs.get(TARGET_ODOM)
        if person is None:
            return None
        pose = person.pose.pose.to_planar()
        if self.seen.refuses([(pose.x, pose.y)], inputs.gap_s(TARGET_ODOM)):
            inputs.refuse(TARGET_ODOM, TOO_FAR)
            return None
        return MovingPerson.upright(pose, _slowed(person.twist.twist))

    def _skeleton(self, inputs: Inputs) -> MovingPerson | None:
        body = inputs.get(TARGET_SKELETON)
        if body is not None and len(body.joints) != len(JOINTS):
            inputs.refuse(TARGET_SKELETON, NEEDS_JOINTS)
            return None
        if body is None:
            return None
        joints = _positions(body.joints)
        if self.seen.refuses(joints.tolist(), inputs.gap_s(TARGET_SKELETON)):
            inputs.refuse(TARGET_SKELETON, TOO_FAR)
            return None
        return self.motion.person(joints, body.header.stamp.ns / 1e9, body.height)

    def _slow_down_if_silent(self, silent_s: float) -> None:
        """Let the wheels slow down to rest when nobody commands them any more."""
        if silent_s <= self.watchdog_s:
            if not self.wheels.is_effort:
                self.last_speeds = self.wheels.values
            return
        if self.wheels.is_effort:
            self.last_speeds = self.robot.state.joint_velocity[: len(WHEELS)]
        left = max(0.0, 1.0 - (silent_s - self.watchdog_s) / SLOW_DOWN_S)
        self.wheels = WheelCommand(tuple(speed * left for speed in self.last_speeds))

    def state(self, tick: Tick) -> Outputs:
        """Return the robot's joints and its true pose."""
        state, now = self.robot.state, tick.time
        x, y, z = state.position
        qx, qy, qz, qw = state.orientation
        pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
        twist = Twist(linear=_vector(state.linear), angular=_vector(state.angular))
        return {
            JOINT_STATES: JointState(
                header=Header(stamp=now, frame_id="base_link"),
                name=self.robot.joint_names,
                position=tuple(state.joint_position),
                velocity=tuple(state.joint_velocity),
                effort=tuple(state.joint_effort),
            ),
            GROUND_TRUTH: Odometry(
                header=Header(stamp=now, frame_id="world"),
                child_frame_id="base_link",
                pose=PoseWithCovariance(pose=pose),
                twist=TwistWithCovariance(twist=twist),
            ),
        }


_of_wheels = itemgetter(*WHEEL_JOINTS)
"""Takes the four wheels' values, in their order, from those of any joints by name."""


def _wheel_command(joints: JointState) -> WheelCommand:
    """Return the wheels' velocities [rad/s], or efforts [N·m] where there are no velocities.

    Raises:
        KeyError: A wheel has neither.
    """
    is_effort = bool(joints.effort) and not joints.velocity
    values = joints.effort if is_effort else joints.velocity
    return WheelCommand(_of_wheels(dict(zip(joints.name, values, strict=False))), is_effort)


def _positions(joints: Sequence[Point]) -> Floats:
    """Return joints as an array (20, 3) [m]."""
    return np.array([(joint.x, joint.y, joint.z) for joint in joints])


def _vector(values: tuple[float, float, float]) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])
