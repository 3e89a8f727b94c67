"""The tracking states; tests/follower/test_node.py tells a whole story of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.geometry import Pose2D
from mecazen_follower.measurement import NO_HEADING, Measurement
from mecazen_follower.tracking import Frame, PersonTracker, Tracker, TrackingState

NOISE = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-3))


def states(tracker, frames):
    return [str(tracker.update(time, seen)) for time, seen in frames]


def test_nobody_seen_yet_is_waiting_however_long():
    assert states(Tracker(0.1, 2.0), [(0.0, False), (100.0, False)]) == ["waiting", "waiting"]


def test_the_limits_themselves_are_still_within():
    tracker = Tracker(0.25, 2.0)
    assert states(tracker, [(0.0, True), (0.25, False), (2.0, False)]) == [
        "following",
        "following",
        "coasting",
    ]


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.booleans()), max_size=50))
def test_seen_is_always_following_and_waiting_never_comes_back(steps):
    tracker, time, before = Tracker(0.1, 2.0), 0.0, TrackingState.WAITING
    for dt, seen in steps:
        time += dt
        state = tracker.update(time, seen)
        assert not seen or state is TrackingState.FOLLOWING
        assert state is not TrackingState.WAITING or before is TrackingState.WAITING
        # Only a measurement ends a loss.
        assert before is not TrackingState.LOST or seen or state is TrackingState.LOST
        before = state


def test_the_covariance_considers_the_bias_that_frames_of_a_camera_share():
    def covariance(kind):
        people = PersonTracker(FollowerConfig(), SensorConfig(kind=kind))
        frame = Frame(0.0, (Measurement(Pose2D(1.0), NOISE),))
        return people.step(0.0, frame, Pose2D(1.0)).covariance

    added = np.subtract(covariance("fused"), covariance("pose"))
    expected = np.diag([0.018**2, 0.018**2, math.radians(5.4) ** 2])
    assert added == pytest.approx(expected, abs=1e-12)  # rounding


def tracker_of(hold: float) -> PersonTracker:
    return PersonTracker(FollowerConfig(), SensorConfig(latency_s=hold), hold)


HERE = Pose2D(1.0, 0.0, 0.2)
SURE = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
BLIND = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, NO_HEADING))


def test_legs_alone_find_nobody_where_a_camera_does():
    people = tracker_of(0.1)
    people.add(Frame(0.0, [Measurement(HERE, BLIND)], begins=False))
    assert people.step(0.1, None, HERE) is None
    assert people.step(0.2, Frame(0.1, [Measurement(HERE, SURE)]), HERE) is not None


def test_legs_wait_for_the_cameras_frame_of_their_time():
    people = tracker_of(0.1)
    people.step(0.1, Frame(0.0, [Measurement(HERE, SURE)]), HERE)
    moved = HERE._replace(x=1.2)
    people.add(Frame(0.1, [Measurement(moved, BLIND)], begins=False))
    before = people.step(0.15, None, HERE).pose.x
    after = people.step(0.2, None, HERE).pose.x
    assert before == pytest.approx(1.0, abs=1e-6)
    assert after > before + 0.05


def test_legs_tell_nothing_of_the_heading():
    people = tracker_of(0.0)
    people.step(0.0, Frame(0.0, [Measurement(HERE, SURE)]), HERE)
    known = people.step(0.04, Frame(0.04, [Measurement(HERE, SURE)]), HERE)
    people.add(Frame(0.08, [Measurement(HERE._replace(yaw=-2.0), BLIND)], begins=False))
    assert people.step(0.08, None, HERE).pose.yaw == pytest.approx(known.pose.yaw, abs=1e-3)


def test_before_the_person_is_known_they_are_taken_to_head_as_the_robots_place_asks():
    people = tracker_of(0.0)
    person = people.step(0.0, Frame(0.0, [Measurement(HERE, BLIND)]), Pose2D(1.0, 0.0, 1.0))
    assert person.pose.yaw == pytest.approx(1.0)
    assert math.degrees(math.sqrt(person.covariance[2][2])) == pytest.approx(45.0)
