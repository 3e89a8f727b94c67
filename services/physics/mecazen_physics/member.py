"""One robot on the bus: what physics says of it, and what commands it."""

from __future__ import annotations

import math
from operator import itemgetter

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario, join_key, seed_of
from mecazen.description import RobotDescription, serve_description
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import (
    Clock,
    Header,
    JointState,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from mecazen.robot import WHEEL_JOINTS, WHEELS
from mecazen.wire import Stamp

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.motors import WheelCommand
from mecazen_physics.urdf import build_urdf, meshes
from mecazen_physics.world import World

FARTHEST_M = 1e6
"""Largest coordinate of a person: beyond it collisions are no numbers."""
FASTEST_M_S = 10.0
"""At most this fast a person pushes the robot, however fast they are said to be."""

SLOW_DOWN_S = 1.0
"""Over this time the wheels are brought to rest when their controller has gone."""


class Member:
    """A robot of a run, by its name, in its namespace.

    At every tick `clock`, `joint_states` and `ground_truth/odom` are published of it, and the
    tick's `joint_command` and `target/odom` awaited.
    """

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        self.name = name
        self.bus = bus
        self.services = frozenset(scenario.services)
        self.watchdog_s = scenario.section(PhysicsConfig, "physics").watchdog_s
        self.tick_s = scenario.sim.tick_s
        self.lockstep = scenario.sim.mode == "lockstep"
        self.answers = {"controller", "target"} & self.services
        self.clock = bus.publisher(keys.CLOCK)
        self.joint_states = bus.publisher(keys.JOINT_STATES)
        self.ground_truth = bus.publisher(keys.GROUND_TRUTH)
        serve_description(bus, RobotDescription(build_urdf(scenario.robot), meshes(scenario.robot)))

    def reset(self, world: World, number: int, stamp: Stamp) -> None:
        """Begin a run at the tick of `stamp`, as a robot of `world`."""
        self.world, self.number = world, number
        self.robot = world.robots[number]
        self.seed = seed_of(stamp.seed, self.name)
        self.tick = 0
        self.command: tuple[float, ...] = (0.0,) * len(WHEELS)
        self.last_command = self.command
        self.command_is_effort = False
        self.command_tick = 0
        self.walking: Pose2D | None = None
        """Where the person was said to be, as long as somebody says it again and again."""
        self.person_tick = 0
        self.begin_tick(0, stamp)

    def begin_tick(self, tick: int, stamp: Stamp) -> None:
        """Await the answers to a tick."""
        self.tick, self.stamp = tick, Stamp(stamp.time_ns, stamp.run, self.seed)
        self.awaited = set(self.answers)

    @property
    def gone(self) -> set[str]:
        """Those whose answer is awaited, and who are not alive."""
        return self.awaited - self.bus.presence.names

    def join_key(self, part: str) -> str:
        """Return what a service of this robot is called."""
        return join_key(part, self.name)

    def on_joint_command(self, joints: JointState, stamp: Stamp | None) -> None:
        """Take velocities [rad/s] or efforts [N·m] of the wheels, by name."""
        if self._is_intrusion("controller", stamp):
            return
        efforts = bool(joints.effort) and not joints.velocity
        values = dict(zip(joints.name, joints.effort if efforts else joints.velocity, strict=False))
        try:
            self.command = _of_wheels(values)
        except KeyError:
            self.bus.refuse(
                keys.JOINT_COMMAND.key, f"needs a velocity or an effort of {WHEEL_JOINTS}"
            )
            return
        self.command_is_effort = efforts
        self.command_tick = self.tick
        if stamp is not None and stamp.time_ns == self.stamp.time_ns:
            self.awaited.discard("controller")

    def on_target_odom(self, person: Odometry, stamp: Stamp | None) -> None:
        """Place the person's body."""
        if self._is_intrusion("target", stamp):
            return
        pose, twist = person.pose.pose.to_planar(), person.twist.twist.to_planar()
        if max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
            self.bus.refuse(keys.TARGET_ODOM.key, f"pose out of range: {tuple(pose)}")
            return
        slower = FASTEST_M_S / max(math.hypot(twist.x, twist.y), FASTEST_M_S)
        self._place(pose, Twist2D(twist.x * slower, twist.y * slower))
        self.walking, self.person_tick = pose, self.tick
        if stamp is not None and stamp.time_ns == self.stamp.time_ns:
            self.awaited.discard("target")

    def _place(self, pose: Pose2D, velocity: Twist2D) -> None:
        self.world.place_person(self.number, pose, velocity)

    def _is_intrusion(self, part: str, stamp: Stamp | None) -> bool:
        """Return whether an outsider speaks in lockstep for a service that takes part."""
        return self.lockstep and stamp is None and part in self.answers

    def end_tick(self) -> WheelCommand:
        """Stop whom nobody moves any more; return what the motors are to do."""
        self._stop_if_commands_are_gone()
        self._stop_person_if_gone()
        return WheelCommand(self.command, self.command_is_effort)

    def _stop_if_commands_are_gone(self) -> None:
        """Let the wheels slow down to rest when nobody commands them any more."""
        silent_s = (self.tick - self.command_tick) * self.tick_s
        if silent_s <= self.watchdog_s:
            self.last_command = self.command
            return
        if self.command_is_effort:
            self.last_command = tuple(self.robot.state().joint_velocity[: len(WHEELS)])
            self.command_is_effort = False
        left = max(0.0, 1.0 - (silent_s - self.watchdog_s) / SLOW_DOWN_S)
        self.command = tuple(speed * left for speed in self.last_command)

    def _stop_person_if_gone(self) -> None:
        """Let the person stand where they were last said to be, when nobody says more."""
        silent_s = (self.tick - self.person_tick) * self.tick_s
        if self.walking is not None and silent_s > self.watchdog_s:
            self._place(self.walking, Twist2D())
            self.walking = None

    def publish(self) -> None:
        """Publish the state of this tick."""
        state = self.robot.state()
        stamp, now = self.stamp, self.stamp.time
        self.clock.put(Clock(clock=now), stamp)
        self.joint_states.put(
            JointState(
                header=Header(stamp=now, frame_id="base_link"),
                name=self.robot.joint_names,
                position=tuple(state.joint_position),
                velocity=tuple(state.joint_velocity),
                effort=tuple(state.joint_effort),
            ),
            stamp,
        )
        x, y, z = state.position
        qx, qy, qz, qw = state.orientation
        self.ground_truth.put(
            Odometry(
                header=Header(stamp=now, frame_id="world"),
                child_frame_id="base_link",
                pose=PoseWithCovariance(
                    pose=Pose(
                        position=Point(x=x, y=y, z=z),
                        orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
                    )
                ),
                twist=TwistWithCovariance(
                    twist=Twist(linear=_vector(state.linear), angular=_vector(state.angular))
                ),
            ),
            stamp,
        )


_of_wheels = itemgetter(*WHEEL_JOINTS)
"""Takes the four wheels' values, in their order, from those of any joints by name."""


def _vector(values: tuple[float, float, float]) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])
