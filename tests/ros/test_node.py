"""Services as ROS nodes in this process: what a whole stack seldom does."""

import secrets
import struct
from contextlib import ExitStack
from functools import partial

import pytest
import zenoh
from harness import wait
from mecazen import keys
from mecazen.bus.session import OPERATOR, open_session, session_config
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Odometry, SimState, String, Twist, Vector3
from mecazen.wire import Stamp
from mecazen_ros import cdr
from mecazen_ros.node import RosNode, RosSession
from mecazen_ros.types import definition, message
from ros import grammar
from rosbags.typesys import Stores, get_typestore

URDF = '<robot name="r"><link name="base_link"/></robot>'
GOOD = cdr.encode(Twist())
TwistStamped = message("geometry_msgs/msg/TwistStamped")
SERVED = {
    keys.ROBOT_DESCRIPTION: lambda _, reply: reply.answer(String(data=URDF)),
    keys.SIM_RESET: lambda _, reply: reply.answer(SimState()),
}


@pytest.fixture
def name():
    """A namespace in ROS for each test: the tokens of another may still be there."""
    return f"test{secrets.token_hex(6)}"


@pytest.fixture
def host(router, name, write_scenario):
    """Host a service as a ROS node; return its bus and the commands that it got."""
    with ExitStack() as stack:

        def start(service, text="", *settings):
            connection = f"bus.connect=['{router}']", f"bus.namespace='{name}'", "bus.ros2=true"
            scenario = load_scenario(write_scenario(text), parse_settings((*connection, *settings)))
            bus, commands = ZenohBus(scenario.bus, renamed=scenario.renamed), []
            stack.callback(bus.close)
            for robot in scenario.names:
                for call, handler in SERVED.items():
                    bus.serve(keys.call_of_robot(call, robot), handler)
            ros = RosSession(scenario.bus, service, bus, lambda *command: commands.append(command))
            stack.callback(ros.close)
            RosNode(ros, service, "", scenario)
            return bus, commands

        yield start


@pytest.fixture
def node(router, raw_node):
    return raw_node(router)


def test_a_renamed_topic_is_published_while_subscribed(host, node, name):
    bus, _ = host("controller", "", "controller.odometry_key='wheels/odom'")
    listeners = bus.listeners(keys.ODOM)
    assert not listeners
    samples = []
    key = node.key_of("MP", f"/{name}/wheels/odom")
    subscriber = node.session.declare_subscriber(key, samples.append)
    wait(bus, lambda: listeners)
    publisher = bus.publisher(keys.ODOM)
    for sec in (1, 2):
        publisher.put(Odometry(child_frame_id=str(sec)), Stamp(sec, 1, 0))
    wait(bus, lambda: len(samples) == 2)
    messages = [cdr.decode(sample.payload.to_bytes(), Odometry) for sample in samples]
    assert [message.child_frame_id for message in messages] == [f"{name}/1", f"{name}/2"]
    attached = [grammar.attachment(sample.attachment.to_bytes()) for sample in samples]
    assert [sequence for sequence, _, _ in attached] == [1, 2]
    subscriber.undeclare()
    wait(bus, lambda: not listeners)


def test_ros_is_met_at_a_router_that_links_no_peers(host, raw_node, name, free_port):
    endpoint = f"tcp/127.0.0.1:{free_port}"  # as rmw_zenohd
    settings = session_config(BusConfig(connect=(endpoint,)), "router")
    settings.insert_json5("routing/router/peers_failover_brokering", "false")
    with zenoh.open(settings):
        host("controller", "", f"bus.ros_connect=['{endpoint}']")
        assert "controller" in {entity.node for entity in raw_node(endpoint).entities(name)}


@pytest.fixture
def bridge(free_port):
    """A router without mecazen, as zenoh-bridge-ros2dds is one; its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port}"
    with open_session(BusConfig(connect=(endpoint,)), "router"):
        yield endpoint


def test_behind_a_dds_bridge_samples_are_plain_cdr(host, raw_node, name, bridge):
    bus, commands = host("controller", "", f"bus.ros_bridge=['{bridge}']")
    node = raw_node(bridge)
    samples = node.subscribe(f"{name}/odom")
    wait(bus, lambda: bus.listeners(keys.ODOM))
    bus.publisher(keys.ODOM).put(Odometry(child_frame_id="base_link"), Stamp(1, 1, 0))
    wait(bus, lambda: samples)
    payload, attached = samples[0].payload, samples[0].attachment
    odometry = grammar.message(payload, Odometry.ROS_TYPE, definition(Odometry))
    assert (odometry["child_frame_id"], attached) == (f"{name}/base_link", b"")
    store = get_typestore(Stores.ROS2_JAZZY)
    make = {kind.rpartition("/")[2]: store.types[kind] for kind in store.types}
    for x, stamped in ((0.25, False), (0.5, True)):
        sent = make["Twist"](make["Vector3"](x, 0.0, 0.0), make["Vector3"](0.0, 0.0, 0.0))
        if stamped:
            sent = make["TwistStamped"](make["Header"](make["Time"](1, 2), "base_link"), sent)
        payload = store.serialize_cdr(sent, sent.__msgtype__).tobytes()
        put = partial(node.put, f"{name}/cmd_vel", payload, attachment=None)
        command = keys.CMD_VEL, Twist(Vector3(x))
        wait(bus, lambda put=put, command=command: put() or command in commands)
    assert not bus.refused


def test_a_dds_bridge_learns_of_topics_and_services(host, raw_node, name, bridge):
    bus, _ = host("physics", "", f"bus.ros_bridge=['{bridge}']")
    node = raw_node(bridge)
    found = node.session.liveliness().get("@/*/@ros2_lv/*/**")
    tokens = {grammar.bridge_token(str(reply.ok.key_expr)) for reply in found}
    trigger, frames = "std_srvs/srv/Trigger", "tf2_msgs/msg/TFMessage"
    assert ("SS", f"{name}/sim/reset", trigger, None) in tokens
    assert ("MP", f"{name}/joint_states", "sensor_msgs/msg/JointState", "0") in tokens
    assert ("MP", "clock", "rosgraph_msgs/msg/Clock", "0") in tokens
    assert ("MP", "tf_static", frames, "1") in tokens
    latched = node.subscribe("tf_static", latched=True)
    wait(bus, lambda: latched)
    replies = []
    request = {"payload": b"\0\1\0\0\0", "attachment": b"rqh" + bytes(17)}  # as the bridge's
    node.session.get(f"{name}/sim/reset", replies.append, **request)
    wait(bus, lambda: replies)
    response = cdr.decode(replies[0].ok.payload.to_bytes(), message(f"{trigger}_Response"))
    assert response.success


def test_a_missing_dds_bridge_is_named(free_port):
    config = BusConfig(ros_bridge=(f"tcp/127.0.0.1:{free_port}",))
    with pytest.raises(BusError, match="is zenoh-bridge-ros2dds running"):
        RosSession(config, OPERATOR, None, None)


def test_humble_has_no_hashes_and_another_domain_is_found(host, node, name):
    bus, _ = host("controller", "", "bus.ros_distro='humble'", "bus.ros_domain_id=7")
    key = f"7/{name}/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
    node.session.declare_subscriber(key, lambda _: None)
    wait(bus, lambda: bus.listeners(keys.ODOM))


def test_malformed_commands_are_refused_and_counted(host, node, name):
    bus, commands = host("controller")
    key = node.key_of("MS", f"/{name}/cmd_vel", "/Twist")
    samples = [
        (key, b"", {}),
        (key, GOOD[:-1], {}),
        (key, cdr.encode(Twist(Vector3(1e9))), {}),
        (key, bytes(1 << 17), {}),
        (key, GOOD, {"attachment": b""}),
        (key, GOOD, {"attachment": struct.pack("<qqB", -1, 0, 16) + bytes(16)}),
        (key.replace("cmd_vel", "*"), GOOD, {}),
    ]
    for key_expression, payload, options in samples:
        put = partial(node.put, key_expression, payload, **options)
        before = bus.refused["ros2/cmd_vel"]
        # a link may drop some
        wait(bus, lambda put=put, before=before: put() or bus.refused["ros2/cmd_vel"] > before)
    assert commands == []
    wait(bus, lambda: node.put(key, GOOD) or commands)
    assert commands[0] == (keys.CMD_VEL, Twist())


def test_a_request_without_an_attachment_is_refused(host, node, name):
    bus, _ = host("physics")
    key = node.key_of("SS", f"/{name}/sim/reset")
    node.session.get(key, lambda _: None, payload=bytes(5), attachment=b"short")
    wait(bus, lambda: bus.refused["ros2/sim/reset"])


def test_only_the_guard_receives_commands_where_there_is_one(host, node, name):
    services = 'services = ["physics", "controller", "target", "sensors", "guard"]\n'
    host("controller", services + '[sensor]\nkind = "pose"\nalso = ["lidar"]\n')
    assert not [entity for entity in node.entities(name) if entity.kind == "MS"]
