"""The tracked person: which detection is followed, how late it is and how certain."""

import math

import numpy as np
import pytest
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.association import DOUBT_S, NO_HEADING, Measurement, check, is_flipped
from mecazen_follower.tracker import MAX_RATIO, Frame, PersonTracker, ReportedNoise

FRAME_S = 0.04
STD = np.array([0.05, 0.05, math.radians(5.0)])
NOISE = tuple(map(tuple, np.diag(STD**2).tolist()))
SPEED = 0.5
SETTLED = 50
"""Frames after which the track is settled."""


def tracker_of(hold=0.0, **settings):
    return PersonTracker(FollowerConfig(**settings), SensorConfig(latency_s=hold), hold)


def person_at(number, aside=0.0):
    """A person who walks along x, or another who walks abreast."""
    return Pose2D(SPEED * number * FRAME_S, aside)


class Frames:
    """A tracker that sees noisy poses, frame by frame."""

    def __init__(self, seed=1, **settings):
        self.tracker = tracker_of(**settings)
        self.rng = np.random.default_rng(seed)

    def see(self, number, *poses, ids=()):
        """Return the estimate after a frame with these true poses."""
        time = number * FRAME_S
        noise = self.rng.normal(size=(len(poses), 3)) * STD
        measurements = [
            Measurement(Pose2D(pose.x + x, pose.y + y, wrap(pose.yaw + yaw)), NOISE, identity)
            for pose, (x, y, yaw), identity in zip(
                poses, noise.tolist(), ids or [""] * len(poses), strict=True
            )
        ]
        frame = Frame(time, measurements) if measurements else None
        return self.tracker.step(time, frame, Pose2D())


def error(estimate, number):
    return estimate.pose.distance(person_at(number))


def test_single_outliers_of_2_m_move_nothing():
    frames, worst = Frames(), 0.0
    for number in range(500):
        pose = person_at(number)
        estimate = frames.see(number, pose._replace(y=2.0) if number % 50 == 25 else pose)
        if number > SETTLED:
            worst = max(worst, error(estimate, number))
    assert worst < 0.1  # two deviations of a single observation


def test_after_an_outlier_in_the_first_frame_all_is_as_new():
    # a filter whose covariance depends on the noise alone shows whether the outlier counts as noise
    corrected, clean = Frames(estimator="kf_cv"), Frames(estimator="kf_cv")
    corrected.see(0, Pose2D(0.0, 2.0))
    clean.see(0)
    clean.rng = np.random.default_rng(1)
    clean.rng.normal(size=3)
    for number in range(1, 10):
        estimates = [frames.see(number, person_at(number)) for frames in (corrected, clean)]
    assert estimates[0] == estimates[1]
    assert corrected.tracker.state == "following"


@pytest.mark.parametrize("ids", [("", ""), ("1", "2")], ids=["unnamed", "named"])
def test_two_who_walk_abreast_are_never_swapped(ids):
    frames = Frames()
    for number in range(500):
        order = (0, 1) if number % 3 else (1, 0)
        poses = person_at(number), person_at(number, aside=0.8)
        estimate = frames.see(
            number, *(poses[i] for i in order), ids=[ids[i] for i in order] if ids[0] else ()
        )
        assert error(estimate, number) < 0.3


@pytest.mark.parametrize(("aside", "ids"), [(0.7, ()), (2.0, ("1",))], ids=["near", "same id"])
def test_a_stranger_in_place_of_the_person_is_not_followed(aside, ids):
    frames, begin, end = Frames(), 100, 150
    for number in range(300):
        is_hidden = begin <= number < end
        estimate = frames.see(number, person_at(number, aside if is_hidden else 0.0), ids=ids)
        # a straight walk is predicted for 2 s by its speed, which is known to a few cm/s
        assert error(estimate, number) < 0.3
    assert frames.tracker.state == "following"


def test_a_person_who_is_elsewhere_is_followed_in_the_end():
    frames = Frames()
    for number in range(400):
        estimate = frames.see(number, person_at(number, 0.0 if number < 100 else 1.5))
    # twice the time after which the person is lost: 4 s of the 12
    assert estimate.pose.distance(person_at(399, 1.5)) < 0.1


def test_a_detection_too_near_for_another_is_the_person():
    frames = Frames()
    for number in range(150):
        estimate = frames.see(number, person_at(number, 0.0 if number <= 124 else 0.4))
    # within a second, half of which frames that fall into the gate by chance may take
    assert estimate.pose.distance(person_at(149, 0.4)) < 0.15


def test_a_person_who_stopped_out_of_sight_is_followed():
    frames, begin, end = Frames(), 100, 150
    for number in range(end + round(0.5 / FRAME_S)):  # 0.3 s of doubt, and 0.2 s to spare
        shown = [] if begin <= number < end else [person_at(min(number, begin + 5))]
        estimate = frames.see(number, *shown)
    assert frames.tracker.state == "following"
    assert error(estimate, begin + 5) < 0.2


def test_a_thing_that_hides_the_person_is_not_followed():
    frames, thing = Frames(), Pose2D(2.0, 0.0)
    for number in range(200):
        # hidden for 1.4 s, less than the 2 s after which the person would be lost
        is_shown = not 1.9 < person_at(number).x < 2.6
        estimate = frames.see(number, thing, *([person_at(number)] if is_shown else []))
        if number > SETTLED:
            assert error(estimate, number) < 0.2  # 1.4 s at a speed that is known to 0.1 m/s
        if not is_shown and person_at(number).x > 2.0:
            assert frames.tracker.state == "coasting"
    assert frames.tracker.state == "following"


def test_a_runner_known_before_does_not_replace_the_returned_person():
    def runner_at(number):
        return Pose2D(3.0, -12.0 + 3.5 * number * FRAME_S)

    frames, last = Frames(), 140
    for number in range(last):
        frames.see(number, Pose2D() if number < SETTLED else runner_at(number))
    for number in range(last, last + 12):  # from 4 s on any detection may be the person
        frames.see(number)
    returned = runner_at(last)
    frames.see(last + 12, returned)
    frames.see(last + 13, runner_at(last + 13))
    estimate = frames.see(last + 14, returned, runner_at(last + 14))
    assert estimate.pose.distance(returned) < 0.15


def test_rare_flips_of_the_heading_cost_nothing():
    rng, frames, clean = np.random.default_rng(3), Frames(), Frames()
    for number in range(1000):
        pose = person_at(number)
        flipped = pose._replace(yaw=math.pi) if rng.random() < 0.03 and number else pose
        estimate, reference = frames.see(number, flipped), clean.see(number, pose)
    assert estimate.pose == pytest.approx(reference.pose, abs=1e-6)


@pytest.mark.parametrize(("first", "change"), [(0.0, SETTLED), (math.pi, 1)])
def test_a_heading_that_stays_reversed_is_believed(first, change):
    frames = Frames()
    for number in range(change + 2 * round(DOUBT_S / FRAME_S)):
        yaw = first if number < change else wrap(first + math.pi)
        frames.see(number, Pose2D(yaw=yaw))
        # a frame without a heading does not keep the reversed heading alive
        time = (number + 0.5) * FRAME_S
        frame = Frame(time, [Measurement(Pose2D(), BLIND)], begins=False)
        estimate = frames.tracker.step(time, frame, Pose2D())
    assert abs(wrap(estimate.pose.yaw - yaw)) < math.radians(6.0)


def test_a_person_who_walks_forwards_is_not_reversed():
    frames = Frames()
    for number in range(SETTLED + round(2.0 / FRAME_S)):
        yaw = 0.0 if number < SETTLED else math.pi
        estimate = frames.see(number, person_at(number)._replace(yaw=yaw))
    assert abs(estimate.pose.yaw) < math.radians(6.0)


def test_a_heading_is_flipped_only_if_that_is_likelier():
    sharp, blunt = math.radians(7.0) ** 2, math.radians(65.0) ** 2
    assert is_flipped(math.radians(170.0), sharp)
    assert not is_flipped(math.radians(80.0), sharp)
    # at 65° an innovation of 150° is quite as likely as a flip that is off by 30°
    assert not is_flipped(math.radians(150.0), blunt)


def test_an_id_helps_only_in_the_gate():
    frames = Frames()
    for number in range(120):
        if number < 100:
            estimate = frames.see(number, person_at(number), ids=("1",))
        else:
            poses = person_at(number, 1.0), person_at(number)
            estimate = frames.see(number, *poses, ids=("1", "2"))
            assert error(estimate, number) < 0.2


def test_in_a_crowd_the_person_at_the_goal_is_kept():
    frames = Frames()
    ring = [Pose2D(3.0 * math.cos(a), 3.0 * math.sin(a)) for a in np.linspace(0.1, 6.2, 150)]
    for number in range(2 * SETTLED):
        crowd = [pose._replace(x=pose.x + SPEED * number * FRAME_S) for pose in ring]
        estimate = frames.see(number, *crowd, person_at(number))
        assert error(estimate, number) < 0.2


def test_a_latency_is_compensated_by_the_stamps():
    tracker, late_s = tracker_of(), 0.12
    for tick in range(1000):
        time = tick * 0.01
        captured, frame = time - late_s, None
        if tick % 4 == 0 and captured >= 0.0:
            frame = Frame(captured, [Measurement(Pose2D(SPEED * captured), NOISE)])
        estimate = tracker.step(time, frame, Pose2D())
    assert estimate.pose == pytest.approx((SPEED * time, 0.0, 0.0), abs=2e-3)
    late = Frame(captured - 0.05, [Measurement(Pose2D(9.0), NOISE)])  # older than the last frame
    assert tracker.step(time, late, Pose2D()).pose == estimate.pose


def test_one_late_frame_delays_the_estimate_for_a_while():
    def coasted(late_s):
        """Return the variance of x 1 s after the last frame of a person who walks at 1 m/s."""
        tracker = tracker_of(estimator="kf_cv")
        for tick in range(500):
            time, frame = tick / 100, None
            captured = time - (late_s if tick == 150 else 0.0)
            if tick == 150 or (tick % 4 == 0 and tick < 400 and not 100 <= tick < 150):
                frame = Frame(captured, [Measurement(Pose2D(captured), NOISE)])
            person = tracker.step(time, frame, Pose2D())
        return person.covariance[0][0]

    # the filter has forgotten the gap after 2.5 s; a clock that is 0.4 s late would give less than
    # half, as the variance grows with the third power of the time without a frame
    assert coasted(0.4) == pytest.approx(coasted(0.0), rel=1e-3)


def test_the_covariance_includes_the_bias_of_a_camera():
    def covariance(kind):
        tracker = PersonTracker(FollowerConfig(), SensorConfig(kind=kind))
        return tracker.step(0.0, Frame(0.0, [Measurement(PLACE, NOISE)]), PLACE).covariance

    bias = np.diag([0.018**2, 0.018**2, math.radians(5.4) ** 2])
    added = np.subtract(covariance("fused"), covariance("pose"))
    assert added == pytest.approx(bias, abs=1e-12)  # rounding


PLACE = Pose2D(1.0, 0.0, 0.2)
SURE = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
BLIND = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, NO_HEADING))


def test_legs_beside_a_camera_do_not_start_a_track():
    tracker = tracker_of(0.1)
    tracker.add(Frame(0.0, [Measurement(PLACE, BLIND)], begins=False))
    assert tracker.step(0.1, None, PLACE) is None
    assert tracker.step(0.2, Frame(0.1, [Measurement(PLACE, SURE)]), PLACE) is not None


def test_legs_wait_for_camera_frames_and_do_not_change_the_heading():
    tracker = tracker_of(0.1)
    tracker.step(0.1, Frame(0.0, [Measurement(PLACE, SURE)]), PLACE)
    moved = Pose2D(1.2, 0.0, -2.0)
    tracker.add(Frame(0.1, [Measurement(moved, BLIND)], begins=False))
    before, after = (tracker.step(time, None, PLACE).pose for time in (0.15, 0.2))
    assert before.x == pytest.approx(1.0, abs=1e-6)
    assert after.x > before.x + 0.05
    assert after.yaw == pytest.approx(0.2, abs=1e-3)


def test_a_heading_that_is_never_seen_is_guessed_from_the_goal():
    person = tracker_of().step(0.0, Frame(0.0, [Measurement(PLACE, BLIND)]), Pose2D(1.0, 0.0, 1.0))
    assert person.pose.yaw == pytest.approx(1.0)
    assert math.degrees(math.sqrt(person.covariance[2][2])) == pytest.approx(45.0)


def ratios(position, yaw, frames=500, period=FRAME_S, acceleration=0.0):
    """Return the ratios of variances learnt from noise of these multiples of the reported."""
    rng, noise = np.random.default_rng(1), ReportedNoise()
    std = STD * (position, position, yaw)
    for number in range(frames):
        x, y, turn = (rng.normal(size=3) * std).tolist()
        time = number * period
        pose = Pose2D(x + acceleration * time**2 / 2.0, y, wrap(3.0 + turn))
        noise.learn(time, pose, noise.corrected(NOISE))
    corrected = noise.corrected(NOISE)
    return corrected[0][0] / NOISE[0][0], corrected[2][2] / NOISE[2][2]


def test_the_noise_of_a_sensor_is_learnt_if_it_is_above_the_reported():
    # a memory of 5 s holds 250 frames, whose second differences are worth 130: two deviations
    # of the variance are a quarter of it
    assert ratios(2.0, 1.0) == pytest.approx((4.0, 1.0), rel=0.3)
    assert ratios(1.0, 2.0) == pytest.approx((1.0, 4.0), rel=0.3)
    assert ratios(10.0, 1.0)[0] == MAX_RATIO
    assert ratios(1.0, 0.5) == (1.0, 1.0)
    assert ratios(1.0, 1.0, frames=100, acceleration=3.0) == (1.0, 1.0)
    assert ratios(2.0, 2.0, period=0.2) == (1.0, 1.0)  # frames too far apart


ALIKE = ((1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def diagonal(x, y, yaw):
    return (x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, yaw)


@pytest.mark.parametrize("covariance", [diagonal(0.0, 0.0, 0.0), ALIKE, diagonal(1e12, 1e-9, 0.0)])
def test_semidefinite_covariances_are_accepted(covariance):
    measurement = Measurement(PLACE, covariance, "7")
    assert check(measurement) == measurement


@pytest.mark.parametrize(
    ("pose", "covariance", "reason"),
    [
        *((Pose2D(bad), ALIKE, "out of range") for bad in (math.nan, math.inf, 1e300)),
        (PLACE, diagonal(math.inf, 1.0, 1.0), "finite"),
        (PLACE, diagonal(-1.0, -1.0, -1.0), "positive"),
        (PLACE, ((1.0, 2.0, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "positive"),
        (PLACE, ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "symmetric"),
    ],
)
def test_an_invalid_measurement_is_refused(pose, covariance, reason):
    with pytest.raises(RefusedError, match=reason):
        check(Measurement(pose, covariance))
