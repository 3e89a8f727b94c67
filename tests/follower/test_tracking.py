"""The tracking states; tests/follower/test_node.py tells a whole story of them."""

import math

import numpy as np
import pytest
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.geometry import Pose2D
from mecazen_follower.association import NO_HEADING, Measurement
from mecazen_follower.tracker import Frame, PersonTracker

NOISE = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-3))


def test_the_state_follows_from_the_time_since_the_person_was_seen():
    config = FollowerConfig(coast_after_s=0.25, lost_after_s=2.0)
    people, at = PersonTracker(config, SensorConfig()), Pose2D(1.0)
    seen = {1.0: True, 1.25: False, 1.26: False, 3.0: False, 3.01: False, 9.0: False, 9.5: True}
    states = []
    for time, shown in {0.0: False, 0.9: False, **seen}.items():
        people.step(time, Frame(time, [Measurement(at, NOISE)]) if shown else None, at)
        states.append(str(people.state))
    known = ["following", "following", "coasting", "coasting", "lost", "lost", "following"]
    assert states == ["waiting", "waiting", *known]  # a limit itself is still within


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


def test_one_late_frame_does_not_delay_the_estimate_for_ever():
    def coasted(*, late_s):
        """Return the variance of x 1 s after the last frame of a person who walks at 1 m/s."""
        people = PersonTracker(FollowerConfig(estimator="kf_cv"), SensorConfig())
        for tick in range(500):
            time, captured = tick / 100, None
            if tick % 4 == 0 and tick < 400 and not 100 <= tick < 150:
                captured = time
            elif tick == 150:
                captured = time - late_s
            seen = captured is not None and [Measurement(Pose2D(captured), SURE)]
            person = people.step(time, Frame(captured, seen) if seen else None, Pose2D())
        return person.covariance[0][0]

    # the filter has forgotten the gap after 2.5 s; a clock that is 0.4 s late would give less than
    # half, as the variance grows with the third power of the time without a frame
    assert coasted(late_s=0.4) == pytest.approx(coasted(late_s=0.0), rel=1e-3)
