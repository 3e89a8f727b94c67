"""The table of keys: every key, its message, its rate and who publishes it.

No key has a leading slash. Several robots share a bus by Zenoh's session namespace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from mecazen import messages as m

MessageT = TypeVar("MessageT", bound=m.Message)
RequestT = TypeVar("RequestT", bound=m.Message)
AnswerT = TypeVar("AnswerT", bound=m.Message)


@dataclass(frozen=True)
class Topic(Generic[MessageT]):
    """A key that samples are published on."""

    key: str
    type: type[MessageT]
    rate: str
    publisher: str
    meaning: str


@dataclass(frozen=True)
class Call(Generic[RequestT, AnswerT]):
    """A key that is queried: a request, and one answer or an error."""

    key: str
    request: type[RequestT]
    answer: type[AnswerT]
    server: str
    meaning: str


CLOCK = Topic("clock", m.Clock, "tick", "physics", "simulated time")
JOINT_STATES = Topic("joint_states", m.JointState, "tick", "physics", "4 wheels, then every roller")
GROUND_TRUTH = Topic(
    "ground_truth/odom", m.Odometry, "tick", "physics", "the robot's true pose, in world"
)
JOINT_COMMAND = Topic(
    "joint_command", m.JointState, "tick", "controller", "velocity or effort per wheel"
)
ODOM = Topic("odom", m.Odometry, "tick", "controller", "odometry, in odom")
CMD_VEL = Topic("cmd_vel", m.Twist, "tick", "follower or anyone", "body velocity wanted")
TARGET_CMD_VEL = Topic(
    "target/cmd_vel", m.Twist, "any", "anyone", "moves a person that is driven by hand"
)
TARGET_ODOM = Topic("target/odom", m.Odometry, "tick", "target", "the person's true pose")
OBSERVATION = Topic(
    "target/observation", m.Observation, "sensor", "target", "what the robot's sensor saw"
)
FOLLOWER_STATE = Topic(
    "follower/state", m.FollowerState, "tick", "follower", "estimate, goal, errors, tracking"
)

TOPICS: tuple[Topic[m.Message], ...] = (
    CLOCK,
    JOINT_STATES,
    GROUND_TRUTH,
    JOINT_COMMAND,
    ODOM,
    CMD_VEL,
    TARGET_CMD_VEL,
    TARGET_ODOM,
    OBSERVATION,
    FOLLOWER_STATE,
    Topic("diagnostics/*", m.DiagnosticArray, "1 Hz", "each service", "rates, counts, health"),
)  # type: ignore[assignment]  # a tuple of topics of different messages

ROBOT_DESCRIPTION = Call(
    "robot_description", m.Empty, m.String, "physics", "the robot as URDF; meshes by its paths"
)
SIM_STATE = Call("sim/state", m.Empty, m.SimState, "physics", "what simulated time does")
SIM_SCENARIO = Call(
    "sim/scenario", m.Empty, m.String, "physics", "the whole effective configuration, as TOML"
)
SIM_PAUSE = Call("sim/pause", m.Empty, m.SimState, "physics", "hold simulated time")
SIM_RESUME = Call("sim/resume", m.Empty, m.SimState, "physics", "let it go on")
SIM_STEP = Call("sim/step", m.StepRequest, m.SimState, "physics", "N ticks while paused")
SIM_RESET = Call("sim/reset", m.ResetRequest, m.SimState, "physics", "back to the start, in place")
SIM_SPEED = Call("sim/speed", m.SpeedRequest, m.SimState, "physics", "times real time")
SET_ODOMETRY = Call(
    "set_odometry", m.OdometryRequest, m.Odometry, "controller", "where odometry believes it is"
)

CALLS: tuple[Call[m.Message, m.Message], ...] = (
    ROBOT_DESCRIPTION,
    SIM_STATE,
    SIM_SCENARIO,
    SIM_PAUSE,
    SIM_RESUME,
    SIM_STEP,
    SIM_RESET,
    SIM_SPEED,
    SET_ODOMETRY,
)  # type: ignore[assignment]


def diagnostics(service: str) -> Topic[m.DiagnosticArray]:
    """Return the topic of one service's diagnostics."""
    return Topic(f"diagnostics/{service}", m.DiagnosticArray, "1 Hz", service, "health")


def topic_of(key: str) -> Topic[m.Message] | None:
    """Return the table's entry for `key`, or None."""
    for topic in TOPICS:
        if topic.key == key or (topic.key.endswith("/*") and key.startswith(topic.key[:-1])):
            return topic
    return None
