"""Services as ROS nodes: a Zenoh session that does what rmw_zenoh does is the other side."""

import secrets
from contextlib import ExitStack
from types import SimpleNamespace

import pytest
import zenoh
from harness import wait
from mecazen import keys
from mecazen import messages as m
from mecazen.bus.session import open_session, session_config
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario
from mecazen.messages import Odometry, SimState, String, Twist, Vector3
from mecazen.parameters import settings_of
from mecazen.programs import graph_of
from mecazen.wire import Stamp
from mecazen_ros import cdr
from mecazen_ros.bridge import open_side
from mecazen_ros.interfaces import message, service
from mecazen_ros.parameters import PARAMETER_SERVICES
from mecazen_ros.protocol import Attachment, data_key, dds_type
from mecazen_ros.types import service_hash, type_hash

STAMP = Stamp(0, 1, 0)
GID = bytes(range(16))
ATTACHED = Attachment(1, 1, GID).pack()
TwistStamped = message("TwistStamped")
TRIGGER = service("std_srvs/srv/Trigger")
NAMES = service("rcl_interfaces/srv/GetParameters").request
SET = service("rcl_interfaces/srv/SetParameters").request
URDF = '<robot name="r"><link name="base_link"/></robot>'
DESCRIBED = {keys.ROBOT_DESCRIPTION: lambda _, reply: reply.answer(String(data=URDF))}


def key_of(name, kind):
    return data_key(0, name, dds_type(kind.ROS_TYPE), type_hash(kind))


@pytest.fixture
def ros(router, write_scenario):
    """Host a service as ROS nodes, and open a session that ROS has."""
    name = f"test{secrets.token_hex(6)}"
    with ExitStack() as stack:

        def open_bus():
            bus = ZenohBus(BusConfig(connect=(router,), namespace=name))
            stack.callback(bus.close)
            return bus

        def host(service, text="", served=None, *, meet=router, **more):
            settings = (f"bus.connect=['{router}']", f"bus.namespace='{name}'", "bus.ros2=true")
            settings += tuple(f"bus.{key}={value}" for key, value in more.items())
            scenario = load_scenario(write_scenario(text), settings)
            bus = ZenohBus(scenario.bus)
            stack.callback(bus.close)
            for robot in scenario.names:
                for call, handler in (served or {}).items():
                    bus.serve(keys.call_of_robot(call, robot), handler)
            side = open_side(scenario.bus, service)
            stack.callback(side.close)
            commands = []  # that the nodes of the process take

            def put(topic, message):
                commands.append((topic.key, message))
                bus.publisher(topic).put(message, None)

            side.show(service, "", bus, put, scenario, graph_of(scenario))
            other = stack.enter_context(open_session(BusConfig(connect=(meet,)), "client"))
            return SimpleNamespace(
                name=name, bus=bus, session=other, open_bus=open_bus, commands=commands
            )

        yield host


def tokens(session, name, some):
    """Wait until the graph of a namespace, as ROS hears of it, has what is asked of it."""
    found = {}  # by whole keys: a token that is declared meanwhile comes twice
    end = zenoh.handlers.FifoChannel(1000)
    subscriber = session.liveliness().declare_subscriber("@ros2_lv/**", end, history=True)
    while not some(found):
        key = str(subscriber.recv().key_expr)
        parts = key.split("/")
        if parts[7] == f"%{name}":
            found[key] = parts[5], parts[8], *parts[9:11]
    return sorted(found.values())


def test_a_topic_is_heard_in_ros_while_somebody_subscribes(ros):
    there = ros("controller")
    odometry = there.bus.publisher(keys.ODOM)
    hearing = there.bus.listeners(keys.ODOM)
    assert not hearing
    samples = []
    name = f"{there.name}/odom"
    subscriber = there.session.declare_subscriber(key_of(name, Odometry), samples.append)
    wait(there.bus, lambda: hearing)
    for sec in (1, 2):
        odometry.put(Odometry(child_frame_id=str(sec)), Stamp(sec, 1, 0))
    wait(there.bus, lambda: len(samples) == 2)
    shown = [cdr.decode(one.payload.to_bytes(), Odometry) for one in samples]
    assert [one.child_frame_id for one in shown] == [f"{there.name}/1", f"{there.name}/2"]
    attached = [Attachment.unpack(one.attachment.to_bytes()) for one in samples]
    assert [one.sequence for one in attached] == [1, 2]
    assert attached[0].gid == attached[1].gid
    subscriber.undeclare()
    wait(there.bus, lambda: not hearing)


def test_ros_sees_a_node_its_topics_and_services(ros):
    there = ros("physics", served=DESCRIBED)
    found = tokens(there.session, there.name, lambda found: len(found) == 22)
    assert ("NN", "physics") in found
    assert ("MP", "physics", "%clock", "rosgraph_msgs::msg::dds_::Clock_") in found
    assert ("MP", "physics", "%tf_static", "tf2_msgs::msg::dds_::TFMessage_") in found
    reset = f"%{there.name}%sim%reset"
    assert ("SS", "physics", reset, "std_srvs::srv::dds_::Trigger_") in found


def test_what_all_robots_share_is_published_once_and_the_rest_for_each(ros):
    robots = '[[robots]]\nname = "a"\n[[robots]]\nname = "b"\nstart = { x_m = 3.0 }\n'
    there = ros("physics", robots, DESCRIBED)
    # the node, 7 + 6 services, time, parameters, health, and for each robot description, tf_static,
    # tf and 2 topics
    found = tokens(there.session, there.name, lambda found: len(found) == 27)
    topics = [one[2] for one in found if one[3:] == ("sensor_msgs::msg::dds_::JointState_",)]
    assert topics == [f"%{there.name}%{robot}%joint_states" for robot in "ab"]
    assert len([one for one in found if one[2:3] == ("%clock",)]) == 1


def test_ros_is_met_at_a_router_of_its_own_that_links_no_peers(ros, free_port):
    # as rmw_zenohd
    endpoint = f"tcp/127.0.0.1:{free_port}"
    settings = session_config(BusConfig(connect=(endpoint,)), "router")
    settings.insert_json5("routing/router/peers_failover_brokering", "false")
    with zenoh.open(settings):
        there = ros("controller", meet=endpoint, ros_connect=[endpoint])
        found = tokens(there.session, there.name, lambda found: len(found) == 13)
    assert ("NN", "controller") in found


def test_humble_has_a_constant_in_the_place_of_each_hash(ros):
    there = ros("controller", ros_distro='"humble"')
    hearing = there.bus.listeners(keys.ODOM)
    key = f"0/{there.name}/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
    there.session.declare_subscriber(key, lambda _: None)
    wait(there.bus, lambda: hearing)


@pytest.mark.parametrize("kind", [Twist, TwistStamped])
def test_a_twist_from_ros_is_a_command_without_a_stamp_for_everybody(ros, kind):
    there = ros("controller")
    commands = there.commands
    other = there.open_bus()
    elsewhere = []
    other.subscribe(keys.CMD_VEL, lambda *sample: elsewhere.append(sample))
    twist = Twist(Vector3(0.5))
    sent = twist if kind is Twist else TwistStamped(twist=twist)
    publisher = there.session.declare_publisher(key_of(f"{there.name}/cmd_vel", kind))

    def put():
        publisher.put(cdr.encode(sent), attachment=ATTACHED)
        other.drain()
        return commands and elsewhere

    wait(there.bus, put)
    assert commands[0] == (keys.CMD_VEL.key, twist)
    assert elsewhere[0] == (twist, None)


def test_what_is_no_twist_is_refused_and_counted_as_from_ros(ros):
    there = ros("controller")
    commands = there.commands
    key = key_of(f"{there.name}/cmd_vel", Twist)
    # a router drops what it knows no subscription of
    shown = "MS", "controller", f"%{there.name}%cmd_vel", dds_type(Twist.ROS_TYPE)
    tokens(there.session, there.name, lambda found: shown in found.values())
    fast = cdr.encode(Twist(Vector3(1e9)))
    good = cdr.encode(Twist())

    def sent(payload, until):
        there.session.put(key, payload, attachment=ATTACHED)  # a link may drop one
        return until()

    for wrong in (b"", b"\0\1\0\0", good[:-1], fast, bytes(1 << 17)):
        there.session.put(key, wrong, attachment=ATTACHED)
    there.session.put(key.replace("cmd_vel", "*"), good, attachment=ATTACHED)
    wait(there.bus, lambda: sent(good, lambda: commands))
    assert all(command == (keys.CMD_VEL.key, Twist()) for command in commands)
    wait(there.bus, lambda: sent(good[:-1], lambda: there.bus.refused["ros2/cmd_vel"]))


def test_only_the_guard_takes_commands_where_there_is_one(ros):
    text = '[sensor]\nkind = "pose"\nalso = ["lidar"]\n'
    there = ros(
        "controller", 'services = ["physics", "controller", "target", "sensors", "guard"]\n' + text
    )
    found = tokens(there.session, there.name, lambda found: len(found) == 11)
    assert not [one for one in found if one[0] == "MS"]


def test_a_service_answers_with_the_requests_number_and_a_refusal_is_an_answer(ros):
    answers = iter([lambda reply: reply.answer(SimState(tick=3)), lambda reply: reply.refuse("no")])
    served = {keys.SIM_RESET: lambda _, reply: next(answers)(reply)}
    there = ros("physics", served=served | DESCRIBED)
    hashed = service_hash("std_srvs/srv/Trigger", *TRIGGER)
    name = f"{there.name}/sim/reset"
    key = data_key(0, name, dds_type("std_srvs/srv/Trigger"), hashed)
    replies = []

    def ask(number, attachment=None):
        got = []
        there.session.get(
            key,
            got.append,
            payload=cdr.encode(TRIGGER.request()),
            attachment=attachment or Attachment(number, 1, GID).pack(),
        )
        return got

    first = ask(41)
    wait(there.bus, lambda: first)
    second = ask(42)
    wait(there.bus, lambda: second)
    for number, reply in ((41, first), (42, second)):
        attached = Attachment.unpack(reply[0].ok.attachment.to_bytes())
        assert (attached.sequence, attached.gid) == (number, GID)
        replies.append(cdr.decode(reply[0].ok.payload.to_bytes(), TRIGGER.response))
    assert replies == [TRIGGER.response(True, "tick 3"), TRIGGER.response(False, "no")]
    ask(43, b"short")
    wait(there.bus, lambda: there.bus.refused["ros2/sim/reset"])


def test_the_owner_of_time_answers_for_the_parameters_of_all_nodes(ros):
    standoff = m.ParameterDescriptor("follower.standoff_m", "1.5", "float")
    asked = []

    def set_(request, reply):
        asked.append(settings_of(request))
        reply.refuse("too far")

    served = {
        keys.GET_PARAMETERS: lambda _, reply: reply.answer(m.ParameterDescriptors((standoff,))),
        keys.SET_PARAMETERS: set_,
    }
    there = ros("physics", served=served | DESCRIBED)
    services = {one.name: one for one in PARAMETER_SERVICES}

    def ask(node, name, request):
        service, got = services[name], []
        hashed = service_hash(service.kind, *service.interface)
        key = data_key(0, f"{there.name}/{node}/{name}", dds_type(service.kind), hashed)
        attached = Attachment(1, 1, GID).pack()
        there.session.get(key, got.append, payload=request, attachment=attached)
        wait(there.bus, lambda: got)
        return cdr.decode(got[0].ok.payload.to_bytes(), service.interface.response)

    names = cdr.encode(NAMES(("standoff_m",)))
    (value,) = ask("follower", "get_parameters", names).values
    assert value.double_value == 1.5
    assert ask("target", "get_parameters", names).values == (message("ParameterValue")(),)
    assert ask("target", "get_parameters", names[:-1]).values == ()
    new = message("Parameter")("standoff_m", message("ParameterValue")(3, double_value=2.0))
    for name in ("set_parameters", "set_parameters_atomically"):
        response = ask("follower", name, cdr.encode(SET((new,))))
        result = message("SetParametersResult")(False, "too far")
        assert getattr(response, "results", None) == (result,) or response.result == result
    assert asked == [{"follower.standoff_m": "2.0"}] * 2


def test_who_subscribes_late_still_gets_the_description(ros):
    there = ros("physics", served=DESCRIBED)
    samples = []
    subscriber = zenoh.ext.declare_advanced_subscriber(
        there.session,
        key_of(f"{there.name}/robot_description", String),
        samples.append,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    wait(there.bus, lambda: samples)
    assert 'name="base_link"' in cdr.decode(samples[0].payload.to_bytes(), String).data
    subscriber.undeclare()


@pytest.mark.parametrize("namespace", ["robot-1", "1st", "fleet/2"])
def test_a_namespace_that_ros_does_not_allow_is_a_clear_error(write_scenario, namespace):
    settings = (f"bus.namespace='{namespace}'", "bus.ros2=true")
    with pytest.raises(ConfigError, match="can't be a namespace in ROS"):
        load_scenario(write_scenario(), settings)
