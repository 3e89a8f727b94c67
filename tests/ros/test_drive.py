"""A robot is driven, heard and asked from the ROS side, by zenoh-ros2-sdk."""

import math

import pytest
from harness import SCENARIOS, Newest
from mecazen import keys
from mecazen.messages import Empty

TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"
TRIGGER = "std_srvs/srv/Trigger"


@pytest.fixture(scope="module")
def running(up):
    return up(SCENARIOS / "teleop.toml")


@pytest.fixture(scope="module")
def prefix(running):
    return f"/{running.scenario.bus.namespace}"


@pytest.fixture(scope="module", params=["peer", "client"])
def side(request, running, ros_side):
    """zenoh-ros2-sdk, which rmw_zenoh's own configuration makes a peer; or a client."""
    return ros_side(running.endpoint, request.param)


@pytest.fixture
def odom(running):
    """The newest odometry, of a robot that stands."""
    newest = Newest(running.bus, keys.ODOM)

    def speed() -> float:
        twist = newest.message.twist.twist
        return math.hypot(twist.linear.x, twist.linear.y, twist.angular.z)

    running.wait(lambda: newest.message is not None and speed() < 0.02)
    return newest


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (TWIST, {"linear": {"x": -0.2, "y": 0.1}, "angular": {"z": 0.3}}),
        (STAMPED, {"twist": {"linear": {"x": -0.2, "y": 0.1}, "angular": {"z": 0.3}}}),
    ],
)
def test_a_twist_from_ros_drives_the_robot(running, side, prefix, odom, kind, fields):
    def moves() -> bool:
        side("publish", f"{prefix}/cmd_vel", kind, fields)
        twist = odom.message.twist.twist
        # what is commanded within a tenth: limits, the loop and slip take less
        return (
            abs(twist.linear.x + 0.2) < 0.02
            and abs(twist.linear.y - 0.1) < 0.02
            and abs(twist.angular.z - 0.3) < 0.03
        )

    running.wait(moves)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("/clock", "rosgraph_msgs/msg/Clock"),
        ("/tf", "tf2_msgs/msg/TFMessage"),
        ("odom", "nav_msgs/msg/Odometry"),
        ("joint_states", "sensor_msgs/msg/JointState"),
        ("scan", "sensor_msgs/msg/LaserScan"),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
    ],
)
def test_the_sdk_hears_what_the_robot_publishes(side, prefix, name, kind):
    topic = name if name.startswith("/") else f"{prefix}/{name}"
    side("subscribe", topic, kind, "2::,5:,:,:,,")
    first, second = side("take", topic, 2)
    assert first != second
    if kind.endswith("JointState"):
        assert len(first["name"]) == len(first["position"]) == len(first["velocity"]) >= 40
    if kind.endswith("LaserScan"):
        assert len(first["ranges"]) > 100
        assert first["range_max"] > max(r for r in first["ranges"] if math.isfinite(r))


def test_the_sdk_sees_topics_and_services_with_their_types(side, prefix):
    said = side("graph")
    assert said["topics"][f"{prefix}/odom"] == ["nav_msgs/msg/Odometry"]
    assert said["topics"][f"{prefix}/cmd_vel"] == [TWIST, STAMPED]
    assert said["services"][f"{prefix}/sim/reset"] == [TRIGGER]


def test_simulation_interfaces_answer_the_sdk(running, side, prefix):
    def call(name: str, **fields: object) -> object:
        return side("call", f"{prefix}/{name}", f"simulation_interfaces/srv/{kinds[name]}", fields)

    kinds = {
        "set_simulation_state": "SetSimulationState",
        "step_simulation": "StepSimulation",
        "reset_simulation": "ResetSimulation",
    }
    ok = {"result": {"result": 1, "error_message": ""}}
    # PAUSED, and PLAYING
    assert call("set_simulation_state", state={"state": 2}) == ok
    held = running.bus.call(keys.SIM_STATE, Empty())
    assert held.paused
    assert call("step_simulation", steps=7) == ok
    assert running.bus.call(keys.SIM_STATE, Empty()).tick == held.tick + 7
    assert call("set_simulation_state", state={"state": 1}) == ok
    # zero steps, and an unknown state: each gets an answer
    for name, fields in (
        ("step_simulation", {"steps": 3}),
        ("step_simulation", {"steps": 0}),
        ("set_simulation_state", {"state": {"state": 77}}),
        ("reset_simulation", {"scope": 77}),
    ):
        refused = call(name, **fields)
        assert refused["result"]["result"] != 1
        assert refused["result"]["error_message"]
    assert call("reset_simulation", scope=0) == ok
