"""How topics look in ROS."""

import math

from mecazen import keys
from mecazen import messages as m
from mecazen.graph import TABLE
from mecazen_ros.cdr import decode, encode
from mecazen_ros.interfaces import message
from mecazen_ros.topics import Namespace, name_of, publications, rep_117, subscriptions

ODOMETRY = m.Odometry(m.Header(m.Time(3), "odom"), "base_link")


def seen(topic, namespace="", urdf=""):
    where = Namespace(namespace, urdf)
    return {where.whole(one.name): one for one in publications(topic, topic.key, where)}


def test_odometry_is_a_topic_and_a_frame_as_well():
    found = seen(keys.ODOM)
    assert set(found) == {"odom", "tf"}
    (frame,) = found["tf"].convert(ODOMETRY).transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("odom", "base_link")
    assert frame.header.stamp == m.Time(3)


def test_what_is_exact_has_a_small_variance_and_what_is_not_keeps_its_own():
    covariance = tuple(0.5 if index == 7 else 0.0 for index in range(36))
    given = m.Odometry(pose=m.PoseWithCovariance(covariance=covariance))
    shown = seen(keys.GROUND_TRUTH)["ground_truth/odom"].convert(given).pose.covariance
    assert shown[:8] == (1e-9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)


def test_a_battery_has_nan_for_what_is_not_measured():
    shown = seen(keys.BATTERY_STATE)["battery_state"].convert(m.BatteryState(voltage=12.5))
    assert (shown.voltage, shown.power_supply_status) == (12.5, 0)
    assert math.isnan(shown.current)
    assert math.isnan(shown.percentage)


def test_of_several_robots_each_has_its_names_and_frames_in_one_tree():
    found = seen(keys.ODOM, "robot1")
    assert set(found) == {"robot1/odom", "tf"}
    (frame,) = found["tf"].convert(ODOMETRY).transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("robot1/odom", "robot1/base_link")
    shown = found["robot1/odom"].convert(ODOMETRY)
    assert (shown.header.frame_id, shown.child_frame_id) == ("robot1/odom", "robot1/base_link")


def test_frames_within_a_message_have_the_prefix_and_the_world_has_none():
    truth = m.Odometry(m.Header(frame_id="world"), "base_link")
    state = m.FollowerState(header=m.Header(frame_id="odom"), estimate=(truth, ODOMETRY))
    shown = seen(keys.FOLLOWER_STATE, "r")["r/follower/state"].convert(state)
    assert shown.header.frame_id == "r/odom"
    assert [one.header.frame_id for one in shown.estimate] == ["world", "r/odom"]
    assert [one.child_frame_id for one in shown.estimate] == ["r/base_link", "r/base_link"]


def test_the_person_is_a_frame_once_seen():
    show = seen(keys.FOLLOWER_STATE)["tf"].convert
    assert show(m.FollowerState()) is None
    pose = m.PoseWithCovariance(m.Pose(m.Point(1.0, 2.0)))
    state = m.FollowerState(m.Header(frame_id="odom"), estimate=(m.Odometry(pose=pose),))
    (frame,) = show(state).transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("odom", "person")
    assert frame.transform.translation == m.Vector3(1.0, 2.0, 0.0)


def test_a_scan_has_rep_117s_infinity_and_nan():
    scan = m.LaserScan(range_min=0.1, range_max=12.0, ranges=(0.0, 0.05, 0.5, 12.0, 13.0))
    nothing, *others = rep_117(scan).ranges
    assert math.isnan(nothing)
    assert others == [-math.inf, 0.5, 12.0, math.inf]


def test_health_and_time_are_in_no_namespace():
    health = keys.diagnostics("physics")
    found = seen(health, "robot1")
    assert set(found) == {"diagnostics"}
    array = m.DiagnosticArray(status=(m.DiagnosticStatus(name="physics"),))
    assert found["diagnostics"].convert(array).status[0].name == "robot1/physics"
    assert set(seen(keys.CLOCK, "robot1")) == {"clock"}


def test_only_open_topics_are_taken_from_ros_and_a_twist_with_or_without_a_stamp():
    taken = {topic.key: [e.kind for e in subscriptions(topic, topic.key)] for topic in keys.TOPICS}
    twists = [m.Twist, message("TwistStamped")]
    assert {key: kinds for key, kinds in taken.items() if kinds} == {
        "cmd_vel": twists,
        "emergency_stop": [m.Empty],
        "target/cmd_vel": twists,
    }
    stamped = subscriptions(keys.CMD_VEL, "cmd_vel")[1]
    assert stamped.convert(message("TwistStamped")(twist=m.Twist(m.Vector3(1.0)))).linear.x == 1.0


def test_the_topics_of_a_real_robots_sensors_are_taken_where_no_node_gives_them():
    taken = {t.key for t in keys.TOPICS if subscriptions(t, t.key, is_given=False)}
    opened = {t.key for t in keys.TOPICS if t.open}
    assert taken - opened == {"scan", "skeleton/observation", "target/observation"}


def test_a_scan_from_ros_has_no_infinity_and_no_nan():
    ranges = (math.nan, math.inf, -math.inf, 0.0625, 0.5, 12.0, 40.0)
    sent = encode(m.LaserScan(range_min=0.125, range_max=12.0, ranges=ranges))
    seen = decode(sent, m.LaserScan)
    assert seen.ranges == (0.0, 13.0, 0.0625, 0.0625, 0.5, 12.0, 40.0)


def test_what_a_node_gives_never_comes_back_through_ros():
    given = {name_of(row, t) for row in TABLE.values() for t in row.outputs}
    taken = {entry.name for topic in keys.TOPICS for entry in subscriptions(topic, topic.key)}
    assert not given & taken
    assert "follower/cmd_vel" in given
