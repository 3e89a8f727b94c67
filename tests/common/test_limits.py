"""Numbers beyond their limit are refused where bytes are decoded, in one line that says which."""

import math

import pytest
from harness import ask_bytes, error_of, forward
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import LocalBus
from mecazen.bus.base import decode_sample
from mecazen.errors import BusError
from mecazen.limits import refuse_implausible
from mecazen.messages import Point, Skeleton, Skeletons
from mecazen.wire import RefusedError, encode


def at(x):
    return m.Odometry(pose=m.PoseWithCovariance(pose=m.Pose(position=m.Point(x=x))))


def moving(**twist):
    return m.Odometry(twist=m.TwistWithCovariance(twist=m.Twist(**twist)))


MESSAGES = {
    "at": at,
    "moving": lambda speed: moving(linear=m.Vector3(y=speed)),
    "turning": lambda speed: moving(angular=m.Vector3(z=speed)),
    "forward": forward,
    "spinning": lambda speed: m.Twist(angular=m.Vector3(z=speed)),
    "seen_at": lambda x: m.Observation(poses=(m.PoseWithCovariance(), at(x).pose)),
    "seen_with": lambda variance: m.Observation(
        poses=(m.PoseWithCovariance(covariance=(*35 * (0.0,), variance)),)
    ),
    "estimated_at": lambda x: m.FollowerState(estimate=(at(x),)),
    "bound_for": lambda x: m.FollowerState(goal=(m.Pose(position=m.Point(y=x)),)),
    "joints": lambda speed: m.JointState(velocity=(*60 * (0.0,), speed)),
}
LIMITS = [
    (keys.ODOM, "at", "position", 1e6, " m"),
    (keys.ODOM, "moving", "linear velocity", 1e6, " m/s"),
    (keys.ODOM, "turning", "angular velocity", 1e6, " rad/s"),
    (keys.CMD_VEL, "forward", "linear velocity", 1e6, " m/s"),
    (keys.CMD_VEL, "spinning", "angular velocity", 1e6, " rad/s"),
    (keys.TARGET_CMD_VEL, "forward", "linear velocity", 20.0, " m/s"),
    (keys.TARGET_CMD_VEL, "spinning", "angular velocity", 20.0, " rad/s"),
    (keys.JOINT_COMMAND, "joints", "joint velocity", 1e6, " rad/s"),
    (keys.OBSERVATION, "seen_at", "position", 1e6, " m"),
    (keys.OBSERVATION, "seen_with", "covariance", 1e12, ""),
    (keys.FOLLOWER_STATE, "estimated_at", "position", 1e6, " m"),
    (keys.FOLLOWER_STATE, "bound_for", "position", 1e6, " m"),
]


@pytest.mark.parametrize(
    ("topic", "message", "what", "most", "unit"),
    LIMITS,
    ids=[f"{topic.key} {message}" for topic, message, *_ in LIMITS],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_number_at_its_limit_is_taken_and_the_next_larger_refused(
    topic, message, what, most, unit, sign
):
    make = MESSAGES[message]
    good = make(sign * most)
    assert decode_sample(topic, encode(good), "", None) == (good, None)
    number = math.nextafter(most, math.inf) * sign
    payload = encode(make(number))
    text = error_of(RefusedError, lambda: decode_sample(topic, payload, "", None))
    assert text == f"{what} {number} is out of range, at most {most:g}{unit}"


@pytest.mark.parametrize(
    "harmless",
    [
        m.JointState(position=(1e300,), effort=(1e300,)),
        m.Odometry(pose=m.PoseWithCovariance(pose=m.Pose(orientation=m.Quaternion(w=1e300)))),
        # not planar, and so of no use to anybody
        m.Observation(poses=(m.PoseWithCovariance(covariance=(*14 * (0.0,), 1e99, *21 * (0.0,))),)),
    ],
)
def test_other_numbers_may_be_of_any_size(harmless):
    topic = next(topic for topic in keys.TOPICS if topic.type is type(harmless))
    assert decode_sample(topic, encode(harmless), "", None) == (harmless, None)


def test_a_request_beyond_its_limit_is_refused_and_counted():
    bus, asked = LocalBus(), []
    bus.serve(
        keys.SET_ODOMETRY,
        lambda request, reply: (asked.append(request), reply.answer(m.Odometry())),
    )
    near, far = (m.OdometryRequest(pose=m.Pose(position=m.Point(x=x))) for x in (1e5, 100000.1))
    ask_bytes(bus, keys.SET_ODOMETRY, encode(near))
    with pytest.raises(BusError, match=r"^set_odometry: position 100000\.1 is out of range, "):
        ask_bytes(bus, keys.SET_ODOMETRY, encode(far))
    assert asked == [near]
    assert bus.refused == {"set_odometry": 1}


@pytest.mark.parametrize(
    ("skeleton", "message"),
    [
        (Skeleton(joints=(Point(), Point(y=-2e6))), "joint position -2000000.0 is out of range"),
        (Skeleton(std=(0.01, 1e200)), r"deviation of a joint 1e\+200 is out of range"),
    ],
)
def test_a_joint_beyond_the_world_is_refused(skeleton, message):
    for said in (skeleton, Skeletons(skeletons=(Skeleton(), skeleton))):
        with pytest.raises(RefusedError, match=message):
            refuse_implausible("body", said)
    refuse_implausible("body", Skeletons(skeletons=(Skeleton(joints=(Point(x=3.0),)),)))
