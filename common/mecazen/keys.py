"""The table of keys: every key with its message; `mecazen.graph` lists the nodes that use them.

No key has a leading slash. If there are several robots, a robot's keys begin with its namespace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Generic, TypeVar

from mecazen import messages as m
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.wire import MAX_PAYLOAD_BYTES, MAX_SAMPLE_BYTES

RequestT = TypeVar("RequestT", bound=m.Message)
AnswerT = TypeVar("AnswerT", bound=m.Message)


@dataclass(frozen=True, eq=False)
class Topic(Generic[MessageT]):
    """A key on which samples are published."""

    key: str
    type: type[MessageT]
    meaning: str
    open: bool = False
    """Whether any client may publish on it, besides its node."""
    sensed: bool = False
    """Whether sensors of a real robot may publish it, if no node of the scenario does."""
    shared: bool = False
    """Whether all robots share it; then it is in no robot's namespace."""
    max_bytes: int = MAX_SAMPLE_BYTES
    """Maximum size of a payload [bytes]; longer samples are refused unread."""
    robot: str = ""
    """Robot whose namespace the key is in; empty if it is in none."""
    by_hand: bool = False
    """Whether it has only the samples without a stamp: those of programs that are no nodes."""

    @property
    def name(self) -> str:
        """The key within the robot's namespace."""
        return self.key.removeprefix(f"{self.robot}/") if self.robot else self.key


@dataclass(frozen=True, eq=False)
class Call(Generic[RequestT, AnswerT]):
    """A key that answers queries: a request gets one answer or an error."""

    key: str
    request: type[RequestT]
    answer: type[AnswerT]
    meaning: str
    changes: bool = False
    """Whether the call changes state; then only the operator may use it."""


# the world and the robot
CLOCK = Topic("clock", m.Clock, "simulated time")
JOINT_STATES = Topic("joint_states", m.JointState, "4 wheels, then every roller")
GROUND_TRUTH = Topic("ground_truth/odom", m.Odometry, "the robot's true pose, in world")
IMU = Topic("imu", m.Imu, "angular velocity and specific force, in base_link")
BATTERY_STATE = Topic("battery_state", m.BatteryState, "the battery's voltage")
JOINT_COMMAND = Topic("joint_command", m.JointState, "velocity or effort per wheel")
ODOM = Topic("odom", m.Odometry, "odometry, in odom")
CMD_VEL = Topic("cmd_vel", m.Twist, "commanded body velocity, in base_link", open=True)
GUARD_CMD_VEL = Topic("guard/cmd_vel", m.Twist, "cmd_vel as limited by the guard")
GUARD_STATE = Topic("guard/state", m.GuardState, "the guard's action and its reason")
EMERGENCY_STOP = Topic("emergency_stop", m.Empty, "stops the motors until released", open=True)

# people and how they are perceived
TARGET_CMD_VEL = Topic("target/cmd_vel", m.Twist, "velocity of a person driven by hand", open=True)
TARGET_ODOM = Topic("target/odom", m.Odometry, "the person's true pose, in world")
TARGET_SKELETON = Topic("target/skeleton", m.Skeleton, "the person's true joints, in world")
PEOPLE = Topic(
    "people", m.People, "the true poses of all persons and robots", shared=True, max_bytes=1 << 20
)  # 500 persons with their joints
SCAN = Topic(
    "scan", m.LaserScan, "the lidar's ranges", sensed=True, max_bytes=1 << 18
)  # 8192 beams of 20 bytes in JSON
SKELETONS = Topic("skeleton/observation", m.Skeletons, "bodies seen by the tracker", sensed=True)
LEGS = Topic("legs/observation", m.Observation, "persons by their legs in the scan")
DEPTH = Topic("camera/depth", m.Image, "depth picture [mm]", max_bytes=MAX_PAYLOAD_BYTES)
CAMERA_INFO = Topic("camera/camera_info", m.CameraInfo, "how the depth camera projects")
OBSERVATION = Topic("target/observation", m.Observation, "the perceived person", sensed=True)
FOLLOWER_STATE = Topic("follower/state", m.FollowerState, "estimate, goal, errors, tracking")

# the run
PARAMETERS = Topic("sim/parameters", m.Parameters, "changes of the configuration", shared=True)
DIAGNOSTICS = Topic("diagnostics/*", m.DiagnosticArray, "a service's rates, counts and health")
"""Diagnostics of all services; `diagnostics` returns the topic of one service."""

ROBOT_DESCRIPTION = Call("robot_description", m.Empty, m.String, "the robot as URDF; meshes below")
SIM_STATE = Call("sim/state", m.Empty, m.SimState, "the state of simulated time")
SIM_SCENARIO = Call("sim/scenario", m.Empty, m.String, "the whole configuration, as TOML")
SIM_PAUSE = Call("sim/pause", m.Empty, m.SimState, "hold simulated time", changes=True)
SIM_RESUME = Call("sim/resume", m.Empty, m.SimState, "let it go on", changes=True)
SIM_STEP = Call("sim/step", m.StepRequest, m.SimState, "N ticks while paused", changes=True)
SIM_RESET = Call("sim/reset", m.ResetRequest, m.SimState, "back to the start", changes=True)
SIM_SPEED = Call("sim/speed", m.SpeedRequest, m.SimState, "times real time", changes=True)
GET_PARAMETERS = Call(
    "sim/get_parameters", m.ParameterNames, m.ParameterDescriptors, "settings that can be changed"
)
SET_PARAMETERS = Call(
    "sim/set_parameters", m.Parameters, m.Parameters, "change all or none, next tick", changes=True
)
SET_ODOMETRY = Call(
    "set_odometry", m.OdometryRequest, m.Odometry, "set the pose of the odometry", changes=True
)
STOP_MOTORS = Call(
    "emergency_stop/engage", m.Empty, m.String, "stop the motors until released", changes=True
)
RELEASE_MOTORS = Call(
    "emergency_stop/release", m.Empty, m.String, "let the motors run again", changes=True
)

TOPICS: tuple[Topic[m.Message], ...] = tuple(v for v in vars().values() if type(v) is Topic)
"""All topics, in the order of this file."""
HAND_CMD_VEL = replace(CMD_VEL, by_hand=True)
"""The samples of `cmd_vel` that come from programs outside the scenario."""
CALLS: tuple[Call[m.Message, m.Message], ...] = tuple(v for v in vars().values() if type(v) is Call)
"""All calls, in the order of this file."""


@cache
def of_robot(topic: Topic[MessageT], robot: str) -> Topic[MessageT]:
    """Return a robot's topic with its full key; a shared topic is returned unchanged."""
    if not robot or topic.shared:
        return topic
    return replace(topic, key=f"{robot}/{topic.key}", robot=robot)


@cache
def command_topic(key: str) -> Topic[m.Twist]:
    """Return the topic of a source of commands in `controller.commands`."""
    return HAND_CMD_VEL if key == CMD_VEL.key else replace(CMD_VEL, key=key)


@cache
def lock_topic(key: str) -> Topic[m.Bool]:
    """Return the topic of a lock in `controller.commands`."""
    return Topic(key, m.Bool, "true: commands of no higher priority are ignored", open=True)


@cache
def call_of_robot(call: Call[RequestT, AnswerT], robot: str) -> Call[RequestT, AnswerT]:
    """Return a robot's call with its full key."""
    return replace(call, key=f"{robot}/{call.key}") if robot else call


def renamed(robot: str, command_key: str, odometry_key: str) -> dict[str, str]:
    """Return the keys of a robot that differ from those of their topics, by topic key."""
    keys = {CMD_VEL.key: command_key, ODOM.key: odometry_key}
    return {
        join_key(topic, robot): join_key(key, robot) for topic, key in keys.items() if topic != key
    }


def diagnostics(service: str) -> Topic[m.DiagnosticArray]:
    """Return the topic of one service's diagnostics."""
    return replace(DIAGNOSTICS, key=f"diagnostics/{service}")


EntryT = TypeVar("EntryT", bound=Topic[Any] | Call[Any, Any])


def resolve(key: str, table: Sequence[EntryT]) -> tuple[str, EntryT | None]:
    """Split a key into a robot's name of any kind and an entry of the table; ("", None): unknown.

    >>> robot, topic = resolve("two/odom", TOPICS)
    >>> robot, topic is ODOM
    ('two', True)
    """
    parts = key.split("/")
    for depth in range(len(parts)):
        name = "/".join(parts[depth:])
        for entry in table:
            prefix = entry.key[:-1] if entry.key.endswith("/*") else None
            if entry.key == name or (prefix and name.startswith(prefix)):
                return "/".join(parts[:depth]), entry
    return "", None


def topic_of(key: str) -> Topic[m.Message] | None:
    """Return the topic of a key, which may begin with a robot's name; None if it is unknown."""
    return resolve(key, TOPICS)[1]
