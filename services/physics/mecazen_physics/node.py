"""The physics node: simulates commands and people, and publishes the state of each robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.config.people import Passerby
from mecazen.config.services import MAX_DT_S
from mecazen.config.world import Box
from mecazen.errors import ConfigError, RefusedError
from mecazen.keys import (
    BATTERY_STATE,
    GROUND_TRUTH,
    IMU,
    JOINT_COMMAND,
    JOINT_STATES,
    PEOPLE,
    ROBOT_DESCRIPTION,
    TARGET_ODOM,
    TARGET_SKELETON,
    Call,
    Topic,
    call_of_robot,
    of_robot,
)
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.robot import WHEELS
from mecazen.robots import join_key, seed_of
from mecazen.skeleton import JOINTS
from mecazen.urdf import build_meshes, build_urdf
from mecazen.wheels import Watchdog, WheelCommand, wheel_command
from mecazen.wire import NS_PER_S

from mecazen_physics.footprint import Footprint
from mecazen_physics.instruments import Battery, Encoders, Imu
from mecazen_physics.motors import real_motors
from mecazen_physics.people import MovingPerson, ReportedPerson
from mecazen_physics.simulation import Simulation
from mecazen_physics.world import reachable

NEEDS_JOINTS = f"needs {len(JOINTS)} joints"


class PhysicsNode(Node):
    """Robots with every roller, and everything that they can touch."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = scenario.physics
        self.steps_per_tick = _steps_per_tick(scenario.sim.tick_s, self.config.dt_s)
        self.parts = {name: scenario.of(name) for name in scenario.names}
        for name, part in self.parts.items():
            for solid in scenario.world.solids:
                if solid.bottom_m < part.robot.height:
                    kind = "box" if isinstance(solid, Box) else "cylinder"
                    at = ", ".join(f"{value:g}" for value in solid.position_m)
                    solid_at = f"{kind} at [{at}]; move it"
                    _check_start(part, name, Footprint.of_obstacle(solid), solid_at)
            if part.controller.base_frame_id != "base_link":
                build_urdf(part.robot, part.controller.base_frame_id)  # refuses a taken name
        self.has_legs = "skeleton" in scenario.sensor.features
        self.person_topic: Topic[Any] = TARGET_SKELETON if self.has_legs else TARGET_ODOM
        self.calls = {call_of_robot(ROBOT_DESCRIPTION, name): name for name in self.parts}
        self.followed = {name: name or "target" for name in scenario.names}
        """The name of the person whom each robot follows."""

    def configure(self, scenario: Scenario) -> None:
        if scenario.world != self.scenario.world:
            for robot in self.robots.values():
                robot.change_world(scenario.world)
        super().configure(scenario)
        for name, watchdog in self.watchdogs.items():
            watchdog.configure(scenario.of(name))

    def check_world(self, scenario: Scenario) -> None:
        """Refuse what would be added on a robot, and obstacles that it could drive onto."""
        for name, robot in self.robots.items():
            part, footprint = scenario.of(name), robot.footprint()
            low = reachable(part.robot, part.world)
            for added, thing in part.world.added.items():
                if isinstance(thing, Passerby):
                    x, y, radius = thing.path.x_m, thing.path.y_m, part.world.person.radius_m
                    place, is_in_reach = Footprint(x, y, rim=radius), True
                else:
                    place, is_in_reach = Footprint.of_obstacle(thing), thing in low
                is_new = self.scenario.world.added.get(added) != thing
                if is_in_reach and is_new and footprint.gap(place) < 0.0:
                    at = f"[{footprint.x:.2f}, {footprint.y:.2f}]"
                    raise ConfigError(f"{added}: would be inside the robot, which is at {at}")

    def reset(self, seed: int) -> None:
        robots = [(part.robot, part.start.pose) for part in self.parts.values()]
        self.simulation = Simulation(robots, self.config, self.scenario.world)
        self.robots = dict(zip(self.parts, self.simulation.robots, strict=True))
        self.watchdogs = {name: Watchdog(part) for name, part in self.parts.items()}
        self.instruments = {
            name: _instruments(part, seed_of(seed, name)) for name, part in self.parts.items()
        }
        self.encoders = {
            name: Encoders(part.sensors.encoders, part.sim.tick_s)
            for name, part in self.parts.items()
            if part.sensors.encoders.counts_per_turn
        }
        self.reported: dict[str, ReportedPerson] = {}
        self.moving: dict[str, bool] = {}
        """Whether each person in the world moves, by name."""
        self.numbers = {name: number for number, name in enumerate(self.followed.values())}
        """Numbers of the persons: first those whom robots follow."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Simulate a control period with the outputs of the tick before; return the state after it.

        At tick 0 the robots stand at their start poses.
        """
        if tick.number > 0:
            commands = []
            for name, part in self.parts.items():
                person = inputs.get(of_robot(TARGET_ODOM, name))
                if tick.number == 1 and person is not None:
                    x, y, _ = person.pose.pose.to_planar()
                    where = f"person, who is at [{x:g}, {y:g}]; move it, or target.path"
                    circle = Footprint(x, y, rim=part.world.person.radius_m)
                    _check_start(part, name, circle, where)
                commands.append(self._command(name, inputs))
                self._place_followed(name, inputs)
            self._place_walkers(inputs)
            self.simulation.advance(commands, self.steps_per_tick)
        outputs: dict[Topic[Any], m.Message] = {}
        for name in self.parts:
            for topic, message in self._sense(name, tick).items():
                outputs[of_robot(topic, name)] = message
        return outputs

    def _sense(self, name: str, tick: Tick) -> dict[Topic[Any], m.Message]:
        """Return a robot's joints, its true pose, and the measurements of its instruments."""
        robot, now = self.robots[name], tick.time
        state = robot.state
        positions, velocities = tuple(state.joint_position), tuple(state.joint_velocity)
        if name in self.encoders:
            count = len(WHEELS)
            counted, changes = self.encoders[name].measure(positions[:count])
            positions, velocities = counted + positions[count:], changes + velocities[count:]
        pose = m.Pose(m.Point(*state.position), m.Quaternion(*state.orientation))
        twist = m.Twist(linear=m.Vector3(*state.linear), angular=m.Vector3(*state.angular))
        outputs: dict[Topic[Any], m.Message] = {
            JOINT_STATES: m.JointState(
                header=m.Header(stamp=now, frame_id="base_link"),
                name=robot.joint_names,
                position=positions,
                velocity=velocities,
                effort=tuple(state.joint_effort),
            ),
            GROUND_TRUTH: m.Odometry(
                header=m.Header(stamp=now, frame_id="world"),
                child_frame_id="base_link",
                pose=m.PoseWithCovariance(pose=pose),
                twist=m.TwistWithCovariance(twist=twist),
            ),
        }
        for topic, instrument in self.instruments[name].items():
            if tick.number % instrument.period == 0:
                outputs[topic] = instrument.measure(state, now)
        return outputs

    def _command(self, name: str, inputs: Inputs) -> WheelCommand:
        """Return the command for the motors; they brake if commands stop."""
        topic = of_robot(JOINT_COMMAND, name)
        joints, command = inputs.get(topic), None
        if joints is not None:
            try:
                command = wheel_command(joints, self.parts[name].robot.wheels.joints)
            except RefusedError as refusal:
                inputs.refuse(topic, str(refusal))
        speeds = self.robots[name].state.joint_velocity[: len(WHEELS)]
        return self.watchdogs[name].command(command, inputs.age_s(topic), speeds)

    def _place_followed(self, robot: str, inputs: Inputs) -> None:
        """Place a followed person as reported; the person stops if no good sample comes."""
        topic, name = of_robot(self.person_topic, robot), self.followed[robot]
        message = inputs.get(topic)
        if message is not None:
            if self.has_legs:
                person = m.Person(name, height=message.height, joints=message.joints)
            else:
                person = m.Person(name, message.pose.pose, message.twist.twist)
            try:
                self._place(person, message.header.stamp, inputs.gap_s(topic))
            except RefusedError as refusal:
                inputs.refuse(topic, str(refusal))
        if inputs.age_s(topic) > self.config.watchdog_s:
            self._stop(name)

    def _place_walkers(self, inputs: Inputs) -> None:
        """Place all other persons as reported, and remove those that are not.

        They stop if no good sample comes.
        """
        people = inputs.get(PEOPLE)
        followed = self.followed.values()
        walkers = [name for name in self.moving if name not in followed]
        if people is not None:
            present = {person.id: person for person in people.persons if person.id not in followed}
            if self.has_legs and any(len(p.joints) != len(JOINTS) for p in present.values()):
                inputs.refuse(PEOPLE, NEEDS_JOINTS)
            else:
                for name in (name for name in walkers if name not in present):
                    del self.moving[name], self.reported[name]
                    for robot in self.robots.values():
                        robot.remove_person(self.numbers[name])
                for person in present.values():
                    self._place(person, people.header.stamp)
        if inputs.age_s(PEOPLE) > self.config.watchdog_s:
            for name in walkers:
                self._stop(name)

    def _place(self, person: m.Person, time: m.Time, gap_s: float = math.inf) -> None:
        """Place a person as reported at a time, `gap_s` after the last good sample.

        Raises:
            RefusedError: Joints are missing, or the person has moved too far.
        """
        name, pose, height = person.id, person.pose.to_planar(), person.height
        points: Sequence[Sequence[float]] = [pose[:2]]
        if self.has_legs:
            if len(person.joints) != len(JOINTS):
                raise RefusedError(NEEDS_JOINTS)
            points = [(joint.x, joint.y, joint.z) for joint in person.joints]
        reported = self.reported.setdefault(name, ReportedPerson())
        velocities = reported.velocities(points, time.ns / NS_PER_S, gap_s)
        if self.has_legs:
            height = height or self.scenario.world.person.height_m
            moving = MovingPerson.of_joints(np.array(points), velocities, height)
        else:
            moving = MovingPerson.upright(pose, person.twist.to_planar())
        self.moving[name] = True
        number = self.numbers.setdefault(name, len(self.numbers))
        for robot in self.robots.values():
            robot.place_person(number, moving)

    def _stop(self, name: str) -> None:
        if self.moving.get(name):
            self.moving[name] = False
            for robot in self.robots.values():
                robot.stop_person(self.numbers[name])

    def answer(self, call: Call[Any, Any], request: m.Message) -> m.String:
        part = self.parts[self.calls[call]]
        return m.String(data=build_urdf(part.robot, part.controller.base_frame_id))

    def files(self) -> Mapping[str, Mapping[str, bytes]]:
        names = self.calls.items()
        return {call.key: build_meshes(self.parts[name].robot) for call, name in names}

    def diagnostics(self) -> dict[str, object]:
        values: dict[str, object] = {}
        for name, robot in self.robots.items():
            x, y, _ = robot.state.position
            values[join_key("x_m", name)] = round(x, 3)
            values[join_key("y_m", name)] = round(y, 3)
        return values


def _instruments(part: Scenario, seed: int) -> dict[Topic[Any], Imu | Battery]:
    """Return the instruments of a robot that its scenario enables, with noise from `seed`."""
    instruments: dict[Topic[Any], Imu | Battery] = {}
    if "imu" in part.features:
        period = part.ticks_per("sensors.imu.rate_hz")
        instruments[IMU] = Imu(part.sensors.imu, period, part.sim.tick_s, seed)
    if "battery" in part.features:
        period = part.ticks_per("sensors.battery.rate_hz")
        motors = real_motors(part.robot, part.physics)
        sag_per_nm = motors.sag_per_nm if motors else 0.0
        instruments[BATTERY_STATE] = Battery(part.sensors.battery, sag_per_nm, period, seed)
    return instruments


def _steps_per_tick(tick_s: float, dt_s: float) -> int:
    steps = round(tick_s / dt_s)
    if steps < 1 or not math.isclose(steps * dt_s, tick_s, rel_tol=1e-9):
        most = math.ceil(tick_s / dt_s)
        allowed = [tick_s / number for number in (most, most - 1) if number > 0]
        which = ", ".join(repr(step) for step in allowed if step <= MAX_DT_S)
        raise ConfigError(
            f"physics.dt_s = {dt_s:g} must divide sim.tick_s = {tick_s:g}; nearest: {which}"
        )
    return steps


def _check_start(scenario: Scenario, name: str, obstacle: Footprint, what: str) -> None:
    """Refuse a robot that starts inside an obstacle or a person: it could only crawl away."""
    robot = Footprint.of_robot(scenario.robot.footprint, scenario.start.pose, 0.0, 0.0)
    if robot.gap(obstacle) < 0.0:
        key = f"robots.{name}.start" if name else "start"
        raise ConfigError(f"{key}: the robot stands inside the {what}")
