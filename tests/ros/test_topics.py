"""How topics look in ROS, against values that are known by hand."""

import math

from mecazen import keys
from mecazen import messages as m
from mecazen_ros.cdr import decode, encode
from mecazen_ros.topics import full_name, publications, subscriptions

POSE = m.PoseWithCovariance(m.Pose(m.Point(1.0, 2.0)))
ODOMETRY = m.Odometry(m.Header(m.Time(3), "odom"), "base_link", POSE)


def shown(topic, message, namespace="", **options):
    """Return what ROS sees of a message, by topic."""
    entries = publications(topic, topic.key, namespace, **options)
    return {full_name(entry.name, namespace): entry.convert(message) for entry in entries}


def test_odometry_is_a_topic_and_a_frame_in_the_robots_namespace():
    for namespace, prefix in (("", ""), ("robot1", "robot1/")):
        messages = shown(keys.ODOM, ODOMETRY, namespace)
        assert set(messages) == {f"{prefix}odom", "tf"}
        (frame,) = messages["tf"].transforms
        assert frame.header.stamp == m.Time(3)
        for message in (frame, messages[f"{prefix}odom"]):
            names = message.header.frame_id, message.child_frame_id
            assert names == (f"{prefix}odom", f"{prefix}base_link")
    assert set(shown(keys.ODOM, ODOMETRY, odom_tf=False)) == {"odom"}


def test_exact_and_unmeasured_values_are_marked():
    covariance = tuple(0.5 if index == 7 else 0.0 for index in range(36))
    truth = m.Odometry(pose=m.PoseWithCovariance(covariance=covariance))
    message = shown(keys.GROUND_TRUTH, truth)["ground_truth/odom"]
    assert message.pose.covariance[:8] == (1e-9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    battery = shown(keys.BATTERY_STATE, m.BatteryState(voltage=12.5))["battery_state"]
    assert (battery.voltage, math.isnan(battery.current)) == (12.5, True)


def test_nested_frames_have_the_prefix_and_the_world_has_none():
    truth = m.Odometry(m.Header(frame_id="world"), "base_link", POSE)
    state = m.FollowerState(header=m.Header(frame_id="odom"), estimate=(truth, ODOMETRY))
    messages = shown(keys.FOLLOWER_STATE, state, "r")
    message = messages["r/follower/state"]
    assert message.header.frame_id == "r/odom"
    assert [part.header.frame_id for part in message.estimate] == ["world", "r/odom"]
    assert [part.child_frame_id for part in message.estimate] == ["r/base_link", "r/base_link"]
    # the person is a frame once seen
    (frame,) = messages["tf"].transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("r/odom", "r/person")
    assert frame.transform.translation == m.Vector3(1.0, 2.0, 0.0)
    assert shown(keys.FOLLOWER_STATE, m.FollowerState())["tf"] is None


def test_health_and_time_are_in_no_namespace():
    array = m.DiagnosticArray(status=(m.DiagnosticStatus(name="physics"),))
    messages = shown(keys.diagnostics("physics"), array, "robot1")
    assert messages["diagnostics"].status[0].name == "robot1/physics"
    assert set(shown(keys.CLOCK, m.Clock(), "robot1")) == {"clock"}


def test_only_open_topics_and_missing_sensors_are_received_from_ros():
    twists = ["geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"]
    opened = {"cmd_vel": twists, "emergency_stop": ["std_msgs/msg/Empty"], "target/cmd_vel": twists}
    sensors = {"scan", "skeleton/observation", "target/observation"}
    for has_source in (True, False):
        received = {
            topic.key: [entry.kind.ROS_TYPE for entry in entries]
            for topic in keys.TOPICS
            if (entries := subscriptions(topic, topic.key, has_source=has_source))
        }
        assert received.keys() == opened.keys() | (set() if has_source else sensors)
        assert opened.items() <= received.items()


def test_a_scan_follows_rep_117_in_both_directions():
    scan = m.LaserScan(range_min=0.1, range_max=12.0, ranges=(0.0, 0.05, 0.5, 12.0, 13.0))
    unknown, *ranges = shown(keys.SCAN, scan)["scan"].ranges
    assert math.isnan(unknown)
    assert ranges == [-math.inf, 0.5, 12.0, math.inf]
    ranges = (math.nan, math.inf, -math.inf, 0.0625, 0.5, 12.0, 40.0)
    payload = encode(m.LaserScan(range_min=0.125, range_max=12.0, ranges=ranges))
    assert decode(payload, m.LaserScan).ranges == (0.0, 13.0, 0.0625, 0.0625, 0.5, 12.0, 40.0)
