"""A robot is driven and asked from the ROS side: by zenoh-ros2-sdk, and by a node by hand."""

import math
import random
import struct

import pytest
from harness import SCENARIOS, Newest, wait
from mecazen import keys
from mecazen.messages import Empty, ParameterNames, ResetRequest
from ros import grammar
from ros.node import attachment

TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"
TRIGGER = "std_srvs/srv/Trigger"


@pytest.fixture(scope="module")
def running(up):
    return up(SCENARIOS / "teleop.toml")


@pytest.fixture(scope="module")
def node(running, raw_node):
    return raw_node(running.endpoint)


@pytest.fixture(scope="module")
def prefix(running):
    return f"/{running.scenario.bus.namespace}"


@pytest.fixture(scope="module", params=["peer", "client"])
def side(request, running, ros_side):
    """zenoh-ros2-sdk, which rmw_zenoh's own configuration makes a peer; or a client."""
    return ros_side(running.endpoint, request.param)


@pytest.fixture(scope="module")
def server(running, ros_side):
    return ros_side(running.endpoint, "client")


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


def test_the_guard_stops_what_ros_drives_towards_the_person(running, side, prefix, odom):
    # back to facing the person, since earlier commands have turned the robot
    running.bus.call(keys.SIM_RESET, ResetRequest())
    guarded = Newest(running.bus, keys.GUARD_CMD_VEL)

    def is_held() -> bool:
        side("publish", f"{prefix}/cmd_vel", TWIST, {"linear": {"x": 0.5}})
        return guarded.message is not None and guarded.message.linear.x < 0.25

    running.wait(is_held)


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


def test_a_late_subscriber_of_the_sdk_gets_what_is_latched(side):
    # for topics in a namespace the sdk asks for tokens that no node has
    side("subscribe", "/tf_static", "tf2_msgs/msg/TFMessage", ":1:,1:,:,:,,")
    (message,) = side("take", "/tf_static")
    frames = {one["child_frame_id"].rpartition("/")[2] for one in message["transforms"]}
    assert {"camera_link", "lidar_link"} <= frames


def test_a_late_subscriber_as_rmw_zenoh_has_it_gets_what_is_latched(
    running, node, raw_node, server, prefix
):
    for name in (f"{prefix}/robot_description", "/tf_static"):
        key = node.key_of("MP", name)
        for mode in ("client", "peer"):
            late = raw_node(running.endpoint, mode)
            heard = late.hear(key, latched=True)
            late.wait(lambda heard=heard: heard)
            grammar.attachment(heard[0].attachment)
            assert server("read", grammar.key(key).type, [heard[0].payload.hex()])


def test_a_volatile_subscriber_gets_nothing_of_what_was_before_it(raw_node, running):
    late = raw_node(running.endpoint)
    heard = late.hear(late.key_of("MP", "/tf_static"))
    clock = late.hear(late.key_of("MP", "/clock"))
    late.wait(lambda: len(clock) > 5)
    assert heard == []


def ask(node, server, key: str, **fields: object) -> dict[str, object]:
    """Ask a service as rmw_zenoh does; the answer repeats the request's sequence and identity."""
    kind = grammar.key(key).type
    request = bytes.fromhex(server("write", f"{kind}_Request", fields))
    own = attachment(77, gid=b"\xfe" * 16)
    (reply,) = node.call(key, request, attachment=own)
    assert reply.key == key
    said = grammar.attachment(reply.attachment)
    assert (said.sequence, said.gid) == (77, b"\xfe" * 16)
    (answer,) = server("read", f"{kind}_Response", [reply.payload.hex()])
    return answer


def test_triggers_pause_resume_and_reset(running, node, server, prefix):
    def state() -> object:
        return running.bus.call(keys.SIM_STATE, Empty())

    for name, paused in (("sim/pause", True), ("sim/resume", False)):
        assert ask(node, server, node.key_of("SS", f"{prefix}/{name}"))["success"] is True
        assert state().paused is paused
    before = state()
    assert ask(node, server, node.key_of("SS", f"{prefix}/sim/reset"))["success"] is True
    assert state().clock.ns < before.clock.ns


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


def test_the_state_of_the_simulation_is_told(node, server, prefix):
    said = ask(node, server, node.key_of("SS", f"{prefix}/get_simulation_state"))
    assert said["state"] == {"state": 1}
    assert said["result"]["result"] == 1


def test_a_nodes_parameters_are_listed_described_set_and_got(running, node, server, prefix):
    def call(name: str, **fields: object) -> dict[str, object]:
        return ask(node, server, node.key_of("SS", f"{prefix}/controller/{name}"), **fields)

    speed, timeout = "limits.yaw.max_velocity_rad_s", "reference_timeout_s"
    listed = call("list_parameters", prefixes=["limits.yaw"], depth=1)["result"]
    assert speed in listed["names"]
    assert timeout not in listed["names"]
    assert listed["prefixes"] == ["limits.yaw"]
    asked = [timeout, "use_sim_time", "mass_kg"]
    described = call("describe_parameters", names=asked)["descriptors"]
    assert [one["read_only"] for one in described] == [False, True, False]
    assert described[0]["description"] == "in s"
    limits = {"from_value": 0.0, "to_value": 1e9, "step": 0.0}
    assert described[0]["floating_point_range"] == [limits]
    assert call("get_parameter_types", names=asked)["types"] == [3, 1, 0]

    def number(name: str, value: float) -> dict[str, object]:
        return {"name": name, "value": {"type": 3, "double_value": value}}

    mixed = call("set_parameters", parameters=[number(speed, 2.5), number(timeout, -1.0)])
    assert [one["successful"] for one in mixed["results"]] == [True, False]
    assert mixed["results"][1]["reason"].startswith("reference_timeout_s: got -1.0")
    both = [number(speed, 1.0), number("use_sim_time", 1.0)]
    assert not call("set_parameters_atomically", parameters=both)["result"]["successful"]
    values = call("get_parameters", names=[speed, timeout])["values"]
    assert [one["double_value"] for one in values] == [2.5, 0.5]
    names = ParameterNames((f"controller.{speed}",))
    assert running.bus.call(keys.GET_PARAMETERS, names).parameters[0].value == "2.5"


RANDOM = random.Random(17)


def wrong_payloads(good: bytes) -> list[bytes]:
    """Truncated, longer, of other encodings, not finite, and thousands damaged at random."""
    double = struct.Struct("<d")
    found = [good[:n] for n in range(len(good))]
    found += [good + bytes(n) for n in (4, 8, 1000)]
    found += [bytes([a, b]) + good[2:] for a, b in ((0, 2), (0, 3), (0, 7), (1, 1), (255, 255))]
    found += [
        good[:4] + double.pack(value) + good[12:]
        for value in (math.nan, math.inf, -math.inf, 1e300, -1e200)
    ]
    found += [b"", b"{}", b'{"linear":{"x":1}}', bytes(100_000), b"\xff" * 65536]
    return found


def test_malformed_payloads_are_refused_and_counted_and_nothing_ends(
    running, node, server, prefix, odom
):
    key = node.key_of("MS", f"{prefix}/cmd_vel", "/Twist")
    stamped = node.key_of("MS", f"{prefix}/cmd_vel", "/TwistStamped")
    heard = []
    running.bus.subscribe(keys.CMD_VEL, lambda twist, stamp: heard.append(twist), every=True)
    good = bytes.fromhex(server("write", TWIST, {"linear": {"x": -0.1}}))
    wrong = wrong_payloads(good)
    for payload in wrong:
        node.put(key, payload)
        node.put(stamped, payload)
    for attached in (None, b"", b"\x00", attachment(-1), attachment(1, -1), attachment()[:-1]):
        node.put(key, good, attachment=attached)
    for _ in range(10_000):
        node.put(key, RANDOM.randbytes(RANDOM.choice((0, 3, 4, 12, 52, 60))))
        node.put(stamped, b"\x00\x01\x00\x00" + RANDOM.randbytes(RANDOM.choice((0, 60, 68, 72))))
    marker = bytes.fromhex(server("write", TWIST, {"linear": {"x": -0.125}}))

    def is_heard() -> bool:
        node.put(key, marker)  # again: a full link drops samples, as rmw_zenoh's do
        return bool(heard) and heard[-1].linear.x == -0.125

    running.wait(is_heard)
    # random bytes are a Twist only with the right header, and it is refused by its numbers
    assert {twist.linear.x for twist in heard} <= {-0.125}
    health = []
    running.bus.subscribe(keys.diagnostics("guard"), lambda array, _: health.append(array))
    running.wait(lambda: health)
    assert "cmd_vel" in repr(health[-1])
    running.wait(lambda: is_heard() and odom.message.twist.twist.linear.x < -0.1)


def test_malformed_requests_are_answered_or_dropped_and_change_nothing(
    running, node, server, prefix
):
    key = node.key_of("SS", f"{prefix}/step_simulation")
    before = running.bus.call(keys.SIM_STATE, Empty())
    good = bytes.fromhex(
        server("write", "simulation_interfaces/srv/StepSimulation_Request", {"steps": 1})
    )
    for payload in (b"", good[:-1], good + bytes(8), b"\xff" * 12, bytes(100_000)):
        for reply in node.call(key, payload):
            (said,) = server(
                "read", "simulation_interfaces/srv/StepSimulation_Response", [reply.payload.hex()]
            )
            assert said["result"]["result"] != 1
    for attached in (None, b"", attachment(-1), attachment()[:-1]):
        assert node.call(key, good, attachment=attached) == []
    assert not before.paused
    assert not running.bus.call(keys.SIM_STATE, Empty()).paused


def test_a_key_with_another_hash_moves_nothing(running, node, server, prefix, odom):
    key = node.key_of("MS", f"{prefix}/cmd_vel", "/Twist")
    heard = []
    running.bus.subscribe(keys.CMD_VEL, lambda twist, stamp: heard.append(twist), every=True)
    payload, marker = (
        bytes.fromhex(server("write", TWIST, {"linear": {"x": speed}}))
        for speed in (-0.25, -0.0625)
    )

    def is_heard() -> bool:
        node.put(key, marker)
        return bool(heard)

    running.wait(is_heard)
    for other in (
        key.replace("RIHS01_9", "RIHS01_8"),
        key.replace("Twist_", "Wrench_"),
        "1" + key[1:],
        key.rpartition("/")[0] + "/*",
        key.partition("/")[0] + "/**",
    ):
        node.put(other, payload)
    count = len(heard)
    running.wait(lambda: is_heard() and len(heard) > count + 5)
    assert -0.25 not in {twist.linear.x for twist in heard}


def test_the_stack_is_whole_after_all_this(running):
    wait(running.bus, lambda: running.supervisor.poll(0.0) is None)
    assert running.bus.call(keys.SIM_STATE, Empty()).tick > 0
