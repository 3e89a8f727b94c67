"""The graph: the nodes of a scenario with their inputs and outputs.

`rows` is the only description of the nodes. The runtime builds services from it. The documents, the
compose file, the access rules and the certificates are generated from it or checked against it. A
user node has its row in its class (`Node.ROW`); the scenario names the node and so adds it.
"""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import replace
from typing import Any

from mecazen import keys
from mecazen.config.scenario import OBSERVERS as OBSERVERS  # noqa: PLC0414  # of the graph
from mecazen.config.scenario import SHARED as SHARED  # noqa: PLC0414
from mecazen.keys import Topic
from mecazen.row import Row, due, every, latest

SIMULATED = frozenset(
    [
        *("pose", "skeleton", "tracker", "body", "lidar", "legs", "depth", "imu", "battery"),
        *("guard", "goal", "planner", "truth"),
    ]
)
"""All features of simulated scenarios; see `Scenario.features`."""
SEARCHES = frozenset(("body", "lidar", "guard"))
"""The features with which the follower searches for a lost person."""
REAL = frozenset(("hardware", "guard"))
"""The features of a real robot that change its nodes."""


def rows(features: Set[str]) -> tuple[Row, ...]:
    """Return the nodes that take part in a scenario with these features.

    A scenario has those whose services it names. `Scenario.features` has the features.
    """
    is_real = "hardware" in features
    nodes = [
        Row(
            "clock",
            "the time of a real robot: the wall clock"
            if is_real
            else "simulated time: begins a tick when the last one is answered or due",
            program="mecazen.runtime.host:ClockNode",
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
            service="hardware" if is_real else "physics",
            shared=True,
            owns_time=True,
            priority=1,
        )
    ]
    if is_real:
        nodes += _robot()
    else:
        nodes.append(_physics(features))
    odometry = [every(keys.JOINT_STATES)]
    if "truth" in features:
        odometry.append(every(keys.GROUND_TRUTH))
    nodes += [
        Row(
            "odometry",
            "where the robot is, from its wheels or from the truth",
            program="mecazen_controller.node:OdometryNode",
            inputs=tuple(odometry),
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
                due(keys.GUARD_CMD_VEL if "guard" in features else keys.CMD_VEL, revises=True),
            ),
            outputs=(keys.JOINT_COMMAND,),
            priority=3,
        ),
        _target(features),
        Row(
            "crowd",
            "other people, and the positions of all persons and robots",
            program="mecazen_target.crowd:CrowdNode",
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
    ]
    if "lidar" in features:
        summary = "scans the surroundings at the height of ankles"
        nodes.append(_sensor("lidar", "LidarNode", summary, keys.SCAN))
    if "tracker" in features:
        summary = "sees the joints of people, as a depth camera with a body-tracking SDK"
        nodes.append(_sensor("tracker", "TrackerNode", summary, keys.SKELETONS))
    if "depth" in features:
        summary = "takes depth pictures"
        nodes.append(_sensor("depth", "DepthNode", summary, keys.DEPTH, keys.CAMERA_INFO))
    if "body" in features:
        summary = "finds position and heading of persons from the joints that are seen"
        nodes.append(_perception("body", "BodyNode", summary, keys.SKELETONS, keys.OBSERVATION))
    if "legs" in features:
        summary = "finds persons by their legs in a scan"
        nodes.append(_perception("legs", "LegsNode", summary, keys.SCAN, keys.LEGS))
    seen: list[Topic[Any]] = [keys.OBSERVATION, keys.LEGS]
    if "planner" in features or features >= SEARCHES:
        seen.append(keys.SCAN)
    nodes.append(
        Row(
            "follower",
            "keeps the robot at its place beside the person",
            program="mecazen_follower.node:FollowerNode",
            inputs=(every(keys.ODOM), *map(due, seen)),
            outputs=(keys.FOLLOWER_STATE, keys.CMD_VEL),
            priority=2,
            resets_with=("controller",),
        )
    )
    if "guard" in features:
        nodes.append(
            Row(
                "guard",
                "lets through of cmd_vel what can be stopped before anything is touched",
                program="mecazen_guard.node:GuardNode",
                inputs=(every(keys.ODOM), due(keys.CMD_VEL, revises=True), due(keys.SCAN)),
                outputs=(keys.GUARD_STATE, keys.GUARD_CMD_VEL),
                priority=3,
                resets_with=("controller",),
            )
        )
    return (*nodes, *_observers())


def _physics(features: Set[str]) -> Row:
    rates: dict[Topic[Any], str] = {}
    if "imu" in features:
        rates[keys.IMU] = "sensors.imu.rate_hz"
    if "battery" in features:
        rates[keys.BATTERY_STATE] = "sensors.battery.rate_hz"
    return Row(
        "physics",
        "the world: robots with all their rollers",
        program="mecazen_physics.node:PhysicsNode",
        inputs=(
            every(keys.CLOCK),
            due(keys.JOINT_COMMAND, before=True),
            due(keys.TARGET_ODOM, before=True),
            due(keys.TARGET_SKELETON, before=True),
            due(keys.PEOPLE, before=True),
        ),
        outputs=(keys.JOINT_STATES, keys.GROUND_TRUTH, *rates),
        calls=(keys.ROBOT_DESCRIPTION,),
        rates={topic.key: rate for topic, rate in rates.items()},
        shared=True,
        priority=1,
    )


def _robot() -> tuple[Row, ...]:
    return (
        Row(
            "hardware",
            "a real robot in the place of physics: what its board reports",
            program="mecazen_hardware.node:HardwareNode",
            inputs=(every(keys.CLOCK),),
            outputs=(keys.JOINT_STATES, keys.IMU, keys.BATTERY_STATE),
            calls=(keys.ROBOT_DESCRIPTION,),
            shared=True,
            priority=1,
        ),
        Row(
            "motors",
            "sends wheel speeds to the board, as far as that is safe",
            program="mecazen_hardware.node:MotorsNode",
            inputs=(
                every(keys.JOINT_STATES),
                due(keys.JOINT_COMMAND, revises=True),
                latest(keys.EMERGENCY_STOP),
            ),
            calls=(keys.STOP_MOTORS, keys.RELEASE_MOTORS),
            service="hardware",
            priority=1,
        ),
    )


def _target(features: Set[str]) -> Row:
    inputs = [every(keys.GROUND_TRUTH), latest(keys.TARGET_CMD_VEL)]
    if "goal" in features:
        inputs.append(due(keys.PEOPLE, before=True))
    rates: dict[Topic[Any], str] = {}
    if "skeleton" in features:
        rates[keys.TARGET_SKELETON] = "sensors.skeleton_rate_hz"
    if "pose" in features:
        rates[keys.OBSERVATION] = "sensor.rate_hz"
    return Row(
        "target",
        "the walking person, and what the robot's sensor sees of them",
        program="mecazen_target.node:TargetNode",
        inputs=tuple(inputs),
        outputs=(keys.TARGET_ODOM, *rates),
        rates={topic.key: rate for topic, rate in rates.items()},
        priority=2,
    )


def _sensor(name: str, node: str, summary: str, *outputs: Topic[Any]) -> Row:
    return Row(
        name,
        summary,
        program=f"mecazen_sensors.node:{node}",
        inputs=(every(keys.TARGET_SKELETON), due(keys.GROUND_TRUTH), due(keys.PEOPLE)),
        outputs=outputs,
        rates={topic.key: f"sensors.{name}.rate_hz" for topic in outputs},
        service="sensors",
        priority=2,
    )


def _perception(
    name: str, node: str, summary: str, sensed: Topic[Any], perceived: Topic[Any]
) -> Row:
    return Row(
        name,
        summary,
        program=f"mecazen_follower.perception:{node}",
        inputs=(every(sensed),),
        outputs=(perceived,),
        service="follower",
        priority=2,
    )


def _observers() -> tuple[Row, ...]:
    return (
        Row(
            "viewer",
            "shows everything in Rerun",
            program="mecazen_viewer.service:ViewerService",
            inputs=tuple(map(latest, keys.TOPICS)),
            shared=True,
            observes=True,
        ),
        Row(
            "recorder",
            "writes everything into an MCAP file",
            program="mecazen_recorder.service:RecorderService",
            inputs=tuple(map(latest, keys.TOPICS)),
            shared=True,
            observes=True,
        ),
        Row(
            COLLECTOR,
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


def services(nodes: Iterable[Row]) -> dict[str, tuple[Row, ...]]:
    """Return the rows of each service, by service name."""
    by_service: dict[str, tuple[Row, ...]] = {}
    for row in nodes:
        by_service[row.part_of] = (*by_service.get(row.part_of, ()), row)
    return by_service


CROWD = "crowd"
"""The service that takes part if other people walk or several robots see each other."""
COLLECTOR = "collector"
"""The service that records the trajectory of a distributed run; the run waits for its start."""


def _all_nodes() -> tuple[Row, ...]:
    plain = {row.name: row.inputs for row in rows(frozenset())}
    nodes = [
        replace(row, inputs=tuple(dict.fromkeys((*row.inputs, *plain.get(row.name, ())))))
        for row in rows(SIMULATED)
    ]
    return (*nodes, *(row for row in rows(REAL) if row.part_of == "hardware"))


GRAPH = _all_nodes()
"""All nodes of all scenarios, with all their inputs and outputs; each world has its own clock."""
NODES = {row.name: row for row in GRAPH if not row.owns_time}
"""All nodes but the clocks, by name."""
SERVICES = tuple(services(GRAPH))
"""Names of all services."""
WORLDS = tuple(row.part_of for row in GRAPH if row.owns_time)
"""Services that own time; a scenario has one of them."""


class Graph:
    """The nodes of a scenario: who publishes what, and how often.

    Args:
        nodes: The rows of the nodes.
        robots: The robots' names, if there are several; a key may begin with one of them.
    """

    def __init__(self, nodes: Iterable[Row], robots: Iterable[str] = ()) -> None:
        self.rows = tuple(nodes)
        self._robots = frozenset(robots) - {""}
        self._givers: dict[str, Row] = {}
        for row in self.rows:
            for key in row.gives:
                self._givers.setdefault(key, row)

    @property
    def services(self) -> dict[str, tuple[Row, ...]]:
        """The rows of each service, by service name."""
        return services(self.rows)

    @property
    def topics(self) -> tuple[Topic[Any], ...]:
        """All topics that a node publishes or subscribes to, each once."""
        topics = {topic.key: topic for row in self.rows for topic in row.outputs}
        for row in self.rows:
            for i in row.inputs:
                topics.setdefault(i.topic.key, i.topic)
        return tuple(topics.values())

    def row(self, name: str) -> Row:
        """Return the row of a node.

        Raises:
            KeyError: No node has that name.
        """
        return {row.name: row for row in self.rows}[name]

    def giver(self, key: str) -> Row | None:
        """Return the node that publishes a topic or answers a query; None: no such node."""
        return self._givers.get(self._name(key))

    def rate(self, key: str, seen: frozenset[str] = frozenset()) -> str | float | None:
        """Return the rate of a topic [Hz] or its configuration key; None: one sample per tick.

        An output without a rate has the rate of the node's own inputs of rule "every".
        """
        key = self._name(key)
        row = self.giver(key)
        if row is None or key in seen:
            return None
        if key in row.rates:
            return row.rates[key]
        rates = (self.rate(i.topic.key, seen | {key}) for i in row.inputs if i.rule == "every")
        return next((rate for rate in rates if rate is not None), None)

    def _name(self, key: str) -> str:
        """Return a key without the name of its robot."""
        robot, _, name = key.partition("/")
        return name if robot in self._robots else key
