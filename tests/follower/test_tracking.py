"""The tracking states; tests/follower/test_node.py tells a whole story of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.geometry import Pose2D
from mecazen_follower.association import Measurement
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
