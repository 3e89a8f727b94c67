"""The tracking states; tests/follower/test_node.py tells a whole story of them."""

import math

import numpy as np
import pytest
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.association import NO_HEADING, Measurement
from mecazen_follower.tracker import MAX_RATIO, Frame, PersonTracker, ReportedNoise

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


FRAME_S = 0.04
STD = np.array([0.05, 0.05, math.radians(5.0)])
REPORTED = tuple(map(tuple, np.diag(STD**2).tolist()))


def learnt(position, yaw, frames=500, period=FRAME_S, acceleration=0.0):
    """Return the ratios of variances applied after frames of such a noise [standard deviations]."""
    rng, noise = np.random.default_rng(1), ReportedNoise()
    std = STD * (position, position, yaw)
    for number in range(frames):
        x, y, turn = (rng.normal(size=3) * std).tolist()
        time = number * period
        pose = Pose2D(x + acceleration * time**2 / 2.0, y, wrap(3.0 + turn))
        noise.learn(time, pose, noise.corrected(REPORTED))
    corrected = noise.corrected(REPORTED)
    return corrected[0][0] / REPORTED[0][0], corrected[2][2] / REPORTED[2][2]


@pytest.mark.parametrize("ratios", [(2.0, 1.0), (1.0, 2.0), (2.0, 2.0)])
def test_a_sensor_twice_as_noisy_as_it_says_is_found_out(ratios):
    found = learnt(*ratios)
    # a memory of 5 s holds 250 frames, whose second differences are worth 130: two deviations
    # of the variance are a quarter of it
    for ratio, variance in zip(ratios, found, strict=True):
        assert variance == pytest.approx(ratio**2, rel=0.3 if ratio > 1.0 else 1e-12)


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_a_sensor_that_is_as_good_as_it_says_or_better_is_believed(ratio):
    assert learnt(ratio, ratio) == (1.0, 1.0)


def test_an_acceleration_is_not_taken_for_noise():
    assert learnt(1.0, 1.0, frames=100, acceleration=3.0) == (1.0, 1.0)


def test_nothing_is_learnt_from_frames_far_apart_and_the_ratio_is_bounded():
    assert learnt(2.0, 2.0, period=0.2) == (1.0, 1.0)
    assert learnt(10.0, 1.0)[0] == MAX_RATIO
