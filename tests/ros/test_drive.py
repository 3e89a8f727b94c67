"""ROS drives, hears and asks a robot; a real one has its sensors in ROS."""

import math
import struct

import pytest
from hardware.stand import emulated
from harness import SCENARIOS, Newest
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, LaserScan
from mecazen_ros import cdr
from mecazen_ros.types import message
from mecazen_tools.simulate import simulate, simulate_distributed
from ros import grammar
from ros.node import GID

TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"
TRIGGER = "std_srvs/srv/Trigger"
FIELDS = {"linear": {"x": -0.2, "y": 0.1}, "angular": {"z": 0.3}}
NO_ARGUMENT = b"\x00\x01\x00\x00\x00"


@pytest.fixture(scope="module")
def running(up):
    return up(SCENARIOS / "teleop.toml")


@pytest.fixture(scope="module")
def prefix(running):
    return f"/{running.scenario.bus.namespace}"


@pytest.fixture(scope="module")
def peer(running, start_peer):
    """zenoh-ros2-sdk, which rmw_zenoh's own configuration makes a peer."""
    return start_peer(running.endpoint, "peer")


@pytest.fixture(scope="module")
def node(running, raw_node):
    return raw_node(running.endpoint)


@pytest.mark.parametrize(("kind", "fields"), [(TWIST, FIELDS), (STAMPED, {"twist": FIELDS})])
def test_a_twist_from_ros_drives_the_robot(running, peer, prefix, kind, fields):
    odom = Newest(running.bus, keys.ODOM)

    def difference(x: float, y: float, yaw: float) -> float:
        return math.dist(odom.message.twist.twist.to_planar(), (x, y, yaw))

    def moves() -> bool:
        peer("publish", f"{prefix}/cmd_vel", kind, fields)
        return difference(-0.2, 0.1, 0.3) < 0.03  # limits, the loop and slip take less than 10 %

    running.wait(lambda: odom.message is not None and difference(0.0, 0.0, 0.0) < 0.02)
    running.wait(moves)


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_the_sdk_receives_what_the_robot_publishes(running, start_peer, prefix, mode):
    sdk = start_peer(running.endpoint, mode)
    graph = sdk("graph")
    assert graph["topics"][f"{prefix}/cmd_vel"] == [TWIST, STAMPED]
    assert graph["services"][f"{prefix}/sim/reset"] == [TRIGGER]
    for topic, kind in (
        ("/clock", "rosgraph_msgs/msg/Clock"),
        ("/tf", "tf2_msgs/msg/TFMessage"),
        (f"{prefix}/scan", "sensor_msgs/msg/LaserScan"),
    ):
        sdk("subscribe", topic, kind)
        first, second = sdk("take", topic, 2)
        assert first != second


def test_simulation_interfaces_answer_the_sdk(running, peer, prefix):
    def call(kind: str, name: str, **fields: object) -> object:
        response = peer("call", f"{prefix}/{name}", f"simulation_interfaces/srv/{kind}", fields)
        assert bool(response["result"]["error_message"]) == (response["result"]["result"] != 1)
        return response["result"]["result"]

    # PAUSED, and PLAYING
    assert call("SetSimulationState", "set_simulation_state", state={"state": 2}) == 1
    paused = running.call(keys.SIM_STATE, Empty())
    assert paused.paused
    assert call("StepSimulation", "step_simulation", steps=7) == 1
    assert running.call(keys.SIM_STATE, Empty()).tick == paused.tick + 7
    assert call("SetSimulationState", "set_simulation_state", state={"state": 1}) == 1
    # while it runs, zero steps, and values that are unknown: each gets a response
    assert call("StepSimulation", "step_simulation", steps=3) == 4
    assert call("StepSimulation", "step_simulation", steps=0) == 0
    assert call("SetSimulationState", "set_simulation_state", state={"state": 77}) == 0
    assert call("ResetSimulation", "reset_simulation", scope=77) == 0
    assert call("ResetSimulation", "reset_simulation", scope=0) == 1


def test_a_response_repeats_number_and_identity_of_the_request(running, node, prefix):
    for name, is_paused in (("pause", True), ("resume", False)):
        key = node.key_of("SS", f"{prefix}/sim/{name}")
        (reply,) = node.call(key, NO_ARGUMENT, attachment=struct.pack("<qqB", 41, 1, 16) + GID)
        sequence, _, gid = grammar.attachment(reply.attachment)
        assert (reply.key, sequence, gid) == (key, 41, GID)
        response = cdr.decode(reply.payload, message(f"{TRIGGER}_Response"))
        assert response.success
        assert response.message.startswith("tick ")
        assert running.call(keys.SIM_STATE, Empty()).paused == is_paused


def test_the_sensors_of_a_real_robot_are_those_of_ros(resources, up, raw_node):
    """A robot behind a guard: no node publishes the scan."""
    board = resources.enter_context(emulated())  # until the stack has ended
    services = 'services=["hardware","controller"]'
    settings = "robot=rosmaster_x3", f"hardware.port={board.line.name}"
    running = up(SCENARIOS / "teleop.toml", services, *settings)
    node, prefix = raw_node(running.endpoint), f"/{running.scenario.bus.namespace}"
    scans, health = (
        Newest(running.bus, topic) for topic in (keys.SCAN, keys.diagnostics("hardware"))
    )
    scan = LaserScan(range_min=0.1, range_max=12.0, ranges=(0.5, math.inf, math.nan))
    scan_key, stop_key = (node.key_of("MS", f"{prefix}/{n}") for n in ("scan", "emergency_stop"))

    def is_received() -> bool:
        node.put(scan_key, cdr.encode(scan))
        node.put(stop_key, NO_ARGUMENT)
        values = health.message.status[0].values if health.message else []
        return scans.message and any("emergency stop" in pair.value for pair in values)

    running.wait(is_received)
    assert scans.message.ranges == (0.5, 13.0, 0.0)
    release = node.key_of("SS", f"{prefix}/emergency_stop/release")
    (reply,) = node.call(release, NO_ARGUMENT)
    response = cdr.decode(reply.payload, message(f"{TRIGGER}_Response"))
    assert (response.success, response.message) == (True, "released")


def test_ros_changes_no_trajectory():
    path, settings = SCENARIOS / "back.toml", ("sim.duration_s=2.0", "seed=7")
    alone = simulate(load_scenario(path, parse_settings(settings)), "back")[0].trajectory_sha256
    seen = simulate_distributed(path, (*settings, "bus.ros2=true"), "back")[0]
    assert seen.trajectory_sha256 == alone
