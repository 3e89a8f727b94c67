"""The graph: all nodes with their inputs and outputs, and the rules by which inputs join a tick.

`GRAPH` is the only table of nodes. The runtime builds services from it. The documents, the compose
file, the access rules and the certificates are generated from it or checked against it. A user
node has its row in its class (`Node.ROW`); the scenario names the node and so adds it to the graph.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.keys import Topic
from mecazen.row import Input, Row, Rule, due, every, latest

_CLOCK = Row(
    "clock",
    "simulated time: advances the world when a tick is answered or due",
    outputs=(keys.CLOCK, keys.PARAMETERS),
    calls=(
        keys.SIM_STATE,
        keys.SIM_SCENARIO,
        keys.SIM_PAUSE,
        keys.SIM_RESUME,
        keys.SIM_STEP,
        keys.SIM_RESET,
        keys.SIM_SPEED,
        keys.GET_PARAMETERS,
        keys.SET_PARAMETERS,
    ),
    service="physics",
    shared=True,
    owns_time=True,
    priority=1,
)

GRAPH: tuple[Row, ...] = (
    _CLOCK,
    Row(
        "physics",
        "the world: robots with all their rollers",
        program="mecazen_physics.node:PhysicsWorld",
        inputs=(
            every(keys.JOINT_COMMAND),
            every(keys.TARGET_ODOM),
            due(keys.TARGET_SKELETON),
            due(keys.PEOPLE),
        ),
        outputs=(keys.JOINT_STATES, keys.GROUND_TRUTH, keys.IMU, keys.BATTERY_STATE),
        calls=(keys.ROBOT_DESCRIPTION,),
        rates={
            keys.IMU.key: "sensors.imu.rate_hz",
            keys.BATTERY_STATE.key: "sensors.battery.rate_hz",
        },
        offers={keys.IMU.key: "imu", keys.BATTERY_STATE.key: "battery"},
        shared=True,
        priority=1,
    ),
    replace(
        _CLOCK,
        name="wall_clock",
        summary="the time of a real robot: the wall clock",
        service="hardware",
        needs="hardware",
    ),
    Row(
        "hardware",
        "a real robot in the place of physics: what its board reports",
        program="mecazen_hardware.node:HardwareWorld",
        outputs=(keys.JOINT_STATES, keys.IMU, keys.BATTERY_STATE),
        calls=(keys.ROBOT_DESCRIPTION,),
        shared=True,
        needs="hardware",
        priority=1,
    ),
    Row(
        "motors",
        "sends wheel speeds to the board, as far as that is safe",
        program="mecazen_hardware.node:Motors",
        inputs=(
            every(keys.JOINT_STATES),
            due(keys.JOINT_COMMAND, revises=True),
            latest(keys.EMERGENCY_STOP),
        ),
        calls=(keys.STOP_MOTORS, keys.RELEASE_MOTORS),
        service="hardware",
        needs="hardware",
        priority=1,
    ),
    Row(
        "odometry",
        "where the robot is, from its wheels or from the truth",
        program="mecazen_controller.node:OdometryNode",
        inputs=(every(keys.JOINT_STATES),),
        outputs=(keys.ODOM,),
        calls=(keys.SET_ODOMETRY,),
        rates={keys.ODOM.key: "controller.update_rate_hz"},
        service="controller",
        priority=3,
    ),
    Row(
        "controller",
        "wheel speeds for a commanded twist, within limits",
        program="mecazen_controller.node:ControllerNode",
        inputs=(
            every(keys.JOINT_STATES),
            due(keys.CMD_VEL, revises=True, unless="guard"),
            due(keys.GUARD_CMD_VEL, revises=True, needs="guard"),
        ),
        outputs=(keys.JOINT_COMMAND,),
        priority=3,
    ),
    Row(
        "target",
        "the walking person, and what the robot's sensor sees of them",
        program="mecazen_target.node:TargetNode",
        inputs=(
            every(keys.GROUND_TRUTH),
            latest(keys.TARGET_CMD_VEL),
            due(keys.PEOPLE, needs="goal", before=True),
        ),
        outputs=(keys.TARGET_ODOM, keys.TARGET_SKELETON, keys.OBSERVATION),
        rates={
            keys.TARGET_SKELETON.key: "sensors.skeleton_rate_hz",
            keys.OBSERVATION.key: "sensor.rate_hz",
        },
        offers={keys.TARGET_SKELETON.key: "skeleton", keys.OBSERVATION.key: "pose"},
        priority=2,
    ),
    Row(
        "crowd",
        "other people, and where everybody is",
        program="mecazen_crowd.node:CrowdNode",
        inputs=(
            every(keys.CLOCK),
            every(keys.GROUND_TRUTH),
            due(keys.TARGET_ODOM),
            due(keys.TARGET_SKELETON),
        ),
        outputs=(keys.PEOPLE,),
        rates={keys.PEOPLE.key: "sensors.skeleton_rate_hz"},
        shared=True,
        priority=2,
    ),
    Row(
        "lidar",
        "scans the surroundings at the height of ankles",
        program="mecazen_sensors.node:LidarNode",
        inputs=(every(keys.TARGET_SKELETON), due(keys.GROUND_TRUTH), due(keys.PEOPLE)),
        outputs=(keys.SCAN,),
        rates={keys.SCAN.key: "sensors.lidar.rate_hz"},
        service="sensors",
        needs="lidar",
        priority=2,
    ),
    Row(
        "tracker",
        "sees the joints of people, as a depth camera with a body-tracking SDK",
        program="mecazen_sensors.node:TrackerNode",
        inputs=(every(keys.TARGET_SKELETON), due(keys.GROUND_TRUTH), due(keys.PEOPLE)),
        outputs=(keys.SKELETONS,),
        rates={keys.SKELETONS.key: "sensors.tracker.rate_hz"},
        service="sensors",
        needs="tracker",
        priority=2,
    ),
    Row(
        "depth",
        "takes depth pictures",
        program="mecazen_sensors.node:DepthNode",
        inputs=(every(keys.TARGET_SKELETON), due(keys.GROUND_TRUTH), due(keys.PEOPLE)),
        outputs=(keys.DEPTH, keys.CAMERA_INFO),
        rates={
            keys.DEPTH.key: "sensors.depth.rate_hz",
            keys.CAMERA_INFO.key: "sensors.depth.rate_hz",
        },
        service="sensors",
        needs="depth",
        priority=2,
    ),
    Row(
        "body",
        "finds position and heading of persons from the joints that are seen",
        program="mecazen_follower.perception.node:Body",
        inputs=(every(keys.SKELETONS),),
        outputs=(keys.OBSERVATION,),
        service="follower",
        needs="body",
        priority=2,
    ),
    Row(
        "legs",
        "finds persons by their legs in a scan",
        program="mecazen_follower.perception.node:Legs",
        inputs=(every(keys.SCAN),),
        outputs=(keys.LEGS,),
        service="follower",
        needs="legs",
        priority=2,
    ),
    Row(
        "follower",
        "keeps the robot at its place beside the person",
        program="mecazen_follower.node:FollowerNode",
        inputs=(every(keys.ODOM), due(keys.OBSERVATION), due(keys.LEGS), due(keys.SCAN)),
        outputs=(keys.FOLLOWER_STATE, keys.CMD_VEL),
        priority=2,
        resets_with=("controller",),
    ),
    Row(
        "guard",
        "lets through of cmd_vel what can be stopped before anything is touched",
        program="mecazen_guard.node:GuardNode",
        inputs=(every(keys.ODOM), due(keys.CMD_VEL, revises=True), due(keys.SCAN)),
        outputs=(keys.GUARD_STATE, keys.GUARD_CMD_VEL),
        needs="guard",
        priority=3,
        resets_with=("controller",),
    ),
    Row(
        "viewer",
        "shows everything in Rerun",
        program="mecazen_viewer.service:ViewerService",
        inputs=tuple(latest(topic) for topic in keys.TOPICS),
        shared=True,
        observes=True,
    ),
    Row(
        "recorder",
        "writes everything into an MCAP file",
        program="mecazen_recorder.service:RecorderService",
        inputs=tuple(latest(topic) for topic in keys.TOPICS),
        shared=True,
        observes=True,
    ),
    Row(
        "collector",
        "writes down the trajectory of a distributed run",
        inputs=(
            latest(keys.GROUND_TRUTH),
            latest(keys.ODOM),
            latest(keys.TARGET_ODOM),
            latest(keys.FOLLOWER_STATE),
            latest(keys.CMD_VEL),
        ),
        shared=True,
    ),
)

CROWD = "crowd"
"""The service that takes part if other people walk or several robots see each other."""
COLLECTOR = "collector"
"""The service that records the trajectory of a distributed run; the run waits for its start."""


def services(rows: Iterable[Row] = GRAPH) -> dict[str, tuple[Row, ...]]:
    """Return the rows of each service, by service name."""
    found: dict[str, tuple[Row, ...]] = {}
    for row in rows:
        found[row.part_of] = (*found.get(row.part_of, ()), row)
    return found


TABLE = {row.name: row for row in GRAPH}
"""The rows by node name."""
SERVICES = tuple(services())
"""Names of all services in the table."""
OBSERVERS = tuple(row.part_of for row in GRAPH if row.observes)
"""Services that no tick waits for and whose exit is no error."""
WORLDS = tuple(row.part_of for row in GRAPH if row.owns_time)
"""Services that own time; a scenario has one of them."""
SHARED = tuple(name for name, rows in services().items() if rows[0].shared)
"""Services that run once for all robots."""


class Graph:
    """The nodes of a scenario.

    Args:
        rows: The rows of the nodes.
        robots: The robots' names, if there are several.

    Raises:
        ConfigError: Two nodes publish the same topic or answer the same query.
    """

    def __init__(self, rows: Iterable[Row], robots: Iterable[str] = ()) -> None:
        self.rows = tuple(rows)
        self._robots = frozenset(robots) - {""}
        self._rows = {row.name: row for row in self.rows}
        self._givers: dict[str, Row] = {}
        for row in self.rows:
            for key in (*(topic.key for topic in row.outputs), *(call.key for call in row.calls)):
                other = self._givers.setdefault(key, row)
                if other is not row and row.feature(key) == other.feature(key):
                    raise ConfigError(f"{other.name} and {row.name} both give {key}")

    @property
    def services(self) -> dict[str, tuple[Row, ...]]:
        """The rows of each service, by service name."""
        return services(self.rows)

    @property
    def topics(self) -> tuple[Topic[Any], ...]:
        """All topics that a node publishes or subscribes to, each once."""
        found = {topic.key: topic for row in self.rows for topic in row.outputs}
        for row in self.rows:
            found.update((i.topic.key, i.topic) for i in row.inputs if i.topic.key not in found)
        return tuple(found.values())

    def row(self, name: str) -> Row:
        """Return the row of a node.

        Raises:
            KeyError: No node has that name.
        """
        return self._rows[name]

    def is_world(self, row: Row) -> bool:
        """Return whether a node is the world: all robots share it, and its service owns time."""
        return row.shared and any(
            other.owns_time for other in self.rows if other.part_of == row.part_of
        )

    def resolved(self, row: Row, *, lockstep: bool = False) -> tuple[Input, ...]:
        """Return a node's inputs with the rules that apply in a run.

        A topic that no node publishes is never due. In lockstep every topic that a node publishes
        is due, so that results do not depend on the order of arrival.
        """

        def rule(i: Input) -> Rule:
            if i.rule == "every":
                return i.rule
            given = self.giver(i.topic.key) is not None
            return "due" if given and (lockstep or i.rule == "due") else "latest"

        return tuple(replace(i, rule=rule(i)) for i in row.inputs)

    def giver(self, key: str) -> Row | None:
        """Return the node that publishes a topic or answers a query, by key; None: no such node.

        The key may start with the name of a robot, if there are several.
        """
        robot, _, rest = key.partition("/")
        return self._givers.get(rest if robot in self._robots else key)

    def rate(self, key: str, seen: frozenset[str] = frozenset()) -> str | float | None:
        """Return the rate of a topic [Hz] or its configuration key; None: one sample per tick.

        An output without a rate has the rate of the node's own inputs of rule "every".
        """
        robot, _, rest = key.partition("/")
        key = rest if robot in self._robots else key
        row = self.giver(key)
        if row is None or key in seen:
            return None
        if key in row.rates:
            return row.rates[key]
        seen |= {key}
        rates = (self.rate(i.topic.key, seen) for i in row.inputs if i.rule == "every")
        return next((rate for rate in rates if rate is not None), None)
