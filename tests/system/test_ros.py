"""A whole system as ROS 2 nodes: a Zenoh session that does what rmw_zenoh does drives it."""

import math

import pytest
from harness import SCENARIOS, tools
from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus_config import BusConfig
from mecazen.loading import load_scenario
from mecazen.messages import Clock, Empty, Odometry, Twist, Vector3
from mecazen_ros import cdr
from mecazen_ros.interfaces import message, service
from mecazen_ros.protocol import Attachment, data_key, dds_type
from mecazen_ros.types import service_hash, type_hash
from mecazen_tools.cli.app import app
from mecazen_tools.simulate import simulate, simulate_distributed
from typer.testing import CliRunner

ATTACHED = Attachment(1, 1, bytes(16)).pack()


def key_of(name, kind):
    return data_key(0, name, dds_type(kind.ROS_TYPE), type_hash(kind))


@pytest.fixture
def ros(stack):
    """The scenario `teleop` as ROS nodes, and a session that ROS has."""
    running = stack(SCENARIOS / "teleop.toml", "bus.ros2=true")
    running.start()
    with open_session(BusConfig(connect=(running.endpoint,)), "client") as session:
        yield running, session, running.scenario.bus.namespace


def test_a_twist_from_ros_drives_the_robot_and_its_odometry_and_frames_come_back(ros):
    running, session, robot = ros
    heard = {name: [] for name in ("clock", f"{robot}/odom", "tf")}
    for (name, samples), kind in zip(
        heard.items(), (Clock, Odometry, message("TFMessage")), strict=True
    ):
        session.declare_subscriber(
            key_of(name, kind),
            lambda sample, samples=samples, kind=kind: samples.append(
                cdr.decode(sample.payload.to_bytes(), kind)
            ),
        )
    commands = session.declare_publisher(key_of(f"{robot}/cmd_vel", Twist))
    forward = cdr.encode(Twist(linear=Vector3(0.3)))

    clocks = []

    def driven():  # it starts at -1 m
        if len(heard["clock"]) != len(clocks):  # a command for each tick that is heard of
            clocks[:] = heard["clock"]
            commands.put(forward, attachment=ATTACHED)
        return any(one.pose.pose.position.x > -0.9 for one in heard[f"{robot}/odom"])

    running.wait(driven)
    children = {t.child_frame_id for one in heard["tf"] for t in one.transforms}
    assert {f"{robot}/base_link", f"{robot}/front_left_wheel"} <= children

    trigger = service("std_srvs/srv/Trigger")
    hashed = service_hash("std_srvs/srv/Trigger", *trigger)
    key = data_key(0, f"{robot}/sim/pause", dds_type("std_srvs/srv/Trigger"), hashed)
    request = cdr.encode(trigger.request())
    (reply,) = session.get(key, payload=request, attachment=ATTACHED, timeout=10.0)
    assert cdr.decode(reply.ok.payload.to_bytes(), trigger.response).success
    assert running.bus.call(keys.SIM_STATE, Empty()).paused


def test_a_parameter_set_from_ros_is_the_simulations_and_the_robot_keeps_it(stack):
    running = stack(SCENARIOS / "back.toml", "bus.ros2=true")
    running.start()
    robot = running.scenario.bus.namespace
    kind = "rcl_interfaces/srv/SetParameters"
    setting = service(kind)
    hashed = service_hash(kind, *setting)
    key = data_key(0, f"{robot}/follower/set_parameters", dds_type(kind), hashed)
    farther = message("ParameterValue")(3, double_value=1.5)
    names = ("standoff_m", "standof")
    request = setting.request(tuple(message("Parameter")(name, farther) for name in names))
    attached = Attachment(1, 1, bytes(16)).pack()
    with open_session(BusConfig(connect=(running.endpoint,)), "client") as session:
        (reply,) = session.get(key, payload=cdr.encode(request), attachment=attached, timeout=10.0)
    results = cdr.decode(reply.ok.payload.to_bytes(), setting.response).results
    assert [one.successful for one in results] == [True, False]
    assert results[1].reason.startswith("follower.standof: no such parameter; did you mean")

    to = tools(running.scenario.bus)
    shown = CliRunner().invoke(app, ["param", "get", "follower.standoff_m", *to])
    assert shown.stdout == "follower.standoff_m=1.5\n"
    places, kept = {}, []

    def keep(topic):
        def note(message, _):
            places[topic] = message.pose.pose.position
            if len(places) == 2:
                robot, person = places.values()
                far = math.hypot(robot.x - person.x, robot.y - person.y)
                # the person walks: the robot is a few centimetres off what it is told to keep
                kept[:] = [*kept, far] if abs(far - 1.5) < 0.1 else []

        running.bus.subscribe(topic, note)

    keep(keys.GROUND_TRUTH)
    keep(keys.TARGET_ODOM)
    running.wait(lambda: len(kept) > 100)


def test_ros_changes_no_trajectory():
    path, settings = SCENARIOS / "back.toml", ("sim.duration_s=2.0", "seed=7")
    alone = simulate(load_scenario(path, settings), "back")[0].trajectory_sha256
    seen = simulate_distributed(path, (*settings, "bus.ros2=true"), "back")[0]
    assert seen.trajectory_sha256 == alone
