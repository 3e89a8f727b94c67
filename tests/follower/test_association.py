"""Whom the follower takes for the person: outliers, flips, strangers and names."""

import math

import numpy as np
import pytest
from mecazen.config import FollowerConfig, SensorConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.association import DOUBT_S, NO_HEADING, Measurement, check, is_flipped
from mecazen_follower.tracker import Frame, PersonTracker

FRAME_S = 0.04
STD = 0.05, 0.05, math.radians(5.0)
NOISE = tuple(map(tuple, np.diag(np.square(STD)).tolist()))
SPEED = 0.5
SETTLED = 50
"""Frames after which the track is settled."""


def person_at(frame):
    """A person who walks along x."""
    return Pose2D(SPEED * frame * FRAME_S, 0.0, 0.0)


def stranger_at(frame, aside=1.0):
    """Somebody who walks abreast."""
    return Pose2D(SPEED * frame * FRAME_S, aside, 0.0)


class Seen:
    """A tracker and the noise of what it sees."""

    def __init__(self, seed=1, **settings):
        self.tracker = PersonTracker(FollowerConfig(**settings), SensorConfig())
        self.rng = np.random.default_rng(seed)

    def frame(self, number, *poses, ids=()):
        """Return the estimate after a frame with these true poses."""
        time = number * FRAME_S
        noise = self.rng.normal(size=(len(poses), 3)) * STD
        seen = [
            Measurement(Pose2D(p.x + x, p.y + y, wrap(p.yaw + w)), NOISE, name)
            for p, (x, y, w), name in zip(
                poses, noise.tolist(), ids or [""] * len(poses), strict=True
            )
        ]
        return self.tracker.step(time, Frame(time, seen) if seen else None, Pose2D())


def error(estimate, number):
    return estimate.pose.distance(person_at(number))


def test_one_outlier_of_2_m_in_fifty_frames_moves_nothing():
    seen, worst = Seen(), 0.0
    for number in range(500):
        pose = person_at(number)
        shown = pose._replace(y=2.0) if number % 50 == 25 else pose
        estimate = seen.frame(number, shown)
        if number > SETTLED:
            worst = max(worst, error(estimate, number))
    assert worst < 0.1  # two deviations of a single observation


def test_an_outlier_in_the_first_frame_is_found_out_in_the_next():
    seen = Seen()
    seen.frame(0, Pose2D(0.0, 2.0, 0.0))
    for number in range(1, 10):
        estimate = seen.frame(number, person_at(number))
    assert error(estimate, 9) < 0.2
    assert seen.tracker.state == "following"


@pytest.mark.parametrize("ids", [(), ("1", "2")], ids=["unnamed", "named"])
def test_of_two_who_walk_abreast_the_person_is_never_swapped(ids):
    seen = Seen()
    for number in range(500):
        order = (0, 1) if number % 3 else (1, 0)
        poses = person_at(number), stranger_at(number, aside=0.8)
        names = [ids[i] for i in order] if ids else ()
        estimate = seen.frame(number, *(poses[i] for i in order), ids=names)
        assert error(estimate, number) < 0.3


@pytest.mark.parametrize("ids", [(), ("1",)], ids=["unnamed", "the same name"])
@pytest.mark.parametrize("aside", [0.7, 1.0, 2.0])
def test_who_stands_in_for_2_s_is_not_followed(ids, aside):
    seen, begin, end = Seen(), 100, 150
    for number in range(300):
        stands_in = begin <= number < end
        pose = stranger_at(number, aside) if stands_in else person_at(number)
        estimate = seen.frame(number, pose, ids=ids)
        # a straight walk is predicted for 2 s by its speed, which is known to a few cm/s
        assert error(estimate, number) < 0.3
    assert seen.tracker.state == "following"


def test_a_person_who_was_really_somewhere_else_is_found_in_the_end():
    seen = Seen()
    for number in range(400):
        pose = person_at(number) if number < 100 else stranger_at(number, 1.5)
        estimate = seen.frame(number, pose)
    # twice the time after which the person is lost: 4 s of the 12
    assert estimate.pose.distance(stranger_at(399, 1.5)) < 0.1


def test_whoever_is_too_near_for_somebody_else_is_the_person():
    seen = Seen()
    for number in range(150):
        aside = 0.0 if number <= 124 else 0.4
        estimate = seen.frame(number, stranger_at(number, aside))
    # within a second, half of which frames that fall into the gate by chance may take
    assert estimate.pose.distance(stranger_at(149, 0.4)) < 0.15


def test_a_person_who_stopped_while_out_of_sight_is_followed_again_within_half_a_second():
    seen, begin, end = Seen(), 100, 150
    for number in range(end + round(0.5 / FRAME_S)):  # 0.3 s of doubt, and as much again to spare
        shown = [person_at(min(number, begin + 5))] if not begin <= number < end else []
        estimate = seen.frame(number, *shown)
    assert seen.tracker.state == "following"
    assert error(estimate, begin + 5) < 0.2


def test_a_thing_that_hides_the_person_is_not_taken_for_them():
    seen, thing = Seen(), Pose2D(2.0, 0.0)
    for number in range(200):
        # hidden for 1.4 s, less than the 2 s after which the person would be lost
        shown = not 1.9 < person_at(number).x < 2.6
        estimate = seen.frame(number, thing, *([person_at(number)] if shown else []))
        if number > SETTLED:
            # coasting for 1.4 s at a speed that is known to 0.1 m/s
            assert error(estimate, number) < 0.2
        if not shown and person_at(number).x > 2.0:
            assert seen.tracker.state == "coasting"
    assert seen.tracker.state == "following"


def test_a_flipped_heading_in_3_percent_of_the_frames_costs_nothing():
    rng, seen, clean = np.random.default_rng(3), Seen(), Seen()
    for number in range(1000):
        pose = person_at(number)
        flipped = pose._replace(yaw=math.pi) if rng.random() < 0.03 and number else pose
        estimate, reference = seen.frame(number, flipped), clean.frame(number, pose)
    assert estimate.pose == pytest.approx(reference.pose, abs=1e-6)


@pytest.mark.parametrize("first", [0.0, math.pi], ids=["turned about", "seen backwards at first"])
def test_a_heading_that_stays_reversed_is_believed(first):
    seen = Seen()
    change = 1 if first else SETTLED
    for number in range(change + 2 * round(DOUBT_S / FRAME_S)):
        yaw = first if number < change else wrap(first + math.pi)
        estimate = seen.frame(number, Pose2D(0.0, 0.0, yaw))
    assert abs(wrap(estimate.pose.yaw - yaw)) < math.radians(6.0)


def test_a_person_who_walks_forwards_is_not_turned_about_by_a_sensor_that_shows_them_backwards():
    seen = Seen()
    for number in range(SETTLED + round(2.0 / FRAME_S)):
        pose = person_at(number)
        yaw = 0.0 if number < SETTLED else math.pi
        estimate = seen.frame(number, pose._replace(yaw=yaw))
    assert abs(estimate.pose.yaw) < math.radians(6.0)


def test_frames_without_a_heading_do_not_keep_a_reversed_heading_alive():
    seen, blind = Seen(), tuple(map(tuple, np.diag([0.01, 0.01, NO_HEADING]).tolist()))
    for number in range(SETTLED + 2 * round(DOUBT_S / FRAME_S)):
        yaw = 0.0 if number < SETTLED else math.pi
        seen.frame(number, Pose2D(0.0, 0.0, yaw))
        time = (number + 0.5) * FRAME_S
        frame = Frame(time, [Measurement(Pose2D(), blind)], begins=False)
        estimate = seen.tracker.step(time, frame, Pose2D())
    assert abs(wrap(estimate.pose.yaw - math.pi)) < math.radians(6.0)


def test_a_heading_is_taken_for_a_flip_only_if_that_is_likelier():
    sharp, blunt = math.radians(7.0) ** 2, math.radians(65.0) ** 2
    assert is_flipped(math.radians(170.0), sharp)
    assert not is_flipped(math.radians(80.0), sharp)
    # at 65° an innovation of 150° is quite as likely as a flip that is off by 30°
    assert not is_flipped(math.radians(150.0), blunt)


def test_a_name_helps_only_in_the_gate():
    seen = Seen()
    for number in range(100):
        estimate = seen.frame(number, person_at(number), ids=("1",))
    for number in range(100, 120):
        far = stranger_at(number, 1.0)
        estimate = seen.frame(number, far, person_at(number), ids=("1", "2"))
        assert error(estimate, number) < 0.2


def test_in_a_crowd_the_nearest_are_told_apart_and_the_person_is_kept():
    seen = Seen()
    ring = [Pose2D(3.0 * math.cos(a), 3.0 * math.sin(a)) for a in np.linspace(0.1, 6.2, 150)]
    for number in range(3 * SETTLED):
        crowd = [pose._replace(x=pose.x + SPEED * number * FRAME_S) for pose in ring]
        shown = [*crowd, person_at(number)] if number else [person_at(0)]
        estimate = seen.frame(number, *shown)
    assert error(estimate, number) < 0.1


def test_of_several_in_the_first_frame_it_is_the_one_at_the_robots_place():
    seen = Seen()
    estimate = seen.frame(0, Pose2D(3.0, 1.0, 0.0), Pose2D(0.1, 0.0, 0.0), Pose2D(-1.0, 0.0, 0.0))
    assert estimate.pose.distance(Pose2D()) < 0.3


@pytest.mark.parametrize("late_s", [0.0, 0.12, 0.3])
def test_the_stamps_tell_the_latency(late_s):
    tracker = PersonTracker(FollowerConfig(), SensorConfig())
    for tick in range(1000):
        time = tick * 0.01
        frame = None
        captured = time - late_s
        if tick % 4 == 0 and captured >= 0.0:
            frame = Frame(captured, [Measurement(Pose2D(SPEED * captured), NOISE)])
        estimate = tracker.step(time, frame, Pose2D())
    assert estimate.pose == pytest.approx((SPEED * time, 0.0, 0.0), abs=2e-3)


def test_a_frame_that_is_older_than_the_last_is_left_out():
    tracker = PersonTracker(FollowerConfig(), SensorConfig())
    for number in range(100):
        time = number * FRAME_S
        frame = Frame(time, [Measurement(person_at(number), NOISE)])
        estimate = tracker.step(time, frame, Pose2D())
    late = Frame(98 * FRAME_S, [Measurement(person_at(98), NOISE)])
    assert tracker.step(time, late, Pose2D()).pose == estimate.pose


def test_at_5_hz_nothing_is_missed_between_two_frames():
    tracker, states = PersonTracker(FollowerConfig(), SensorConfig(rate_hz=5.0)), set()
    for tick in range(200):
        time = tick * 0.01
        frame = Frame(time, [Measurement(Pose2D(), NOISE)]) if tick % 20 == 0 else None
        tracker.step(time, frame, Pose2D())
        states.add(str(tracker.state))
    assert states == {"following"}


HERE = Pose2D(1.0, 2.0, 0.5)
CERTAIN = ((0.0, 0.0, 0.0),) * 3
ALIKE = ((1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def diagonal(x, y, yaw):
    return (x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, yaw)


@pytest.mark.parametrize("covariance", [CERTAIN, ALIKE, diagonal(1e12, 1e-9, 0.0)])
def test_semidefinite_covariances_are_accepted(covariance):
    measurement = Measurement(HERE, covariance, "7")
    assert check(measurement) == measurement


@pytest.mark.parametrize(
    ("pose", "covariance", "reason"),
    [
        *((Pose2D(bad), ALIKE, "out of range") for bad in (math.nan, math.inf, 1e300)),
        (HERE, diagonal(math.nan, 1.0, 1.0), "finite"),
        (HERE, diagonal(math.inf, 1.0, 1.0), "finite"),
        (HERE, diagonal(-1.0, -1.0, -1.0), "positive"),
        (HERE, ((1.0, 2.0, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "positive"),
        (HERE, ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "symmetric"),
    ],
)
def test_an_invalid_pose_or_covariance_is_refused(pose, covariance, reason):
    with pytest.raises(RefusedError, match=reason):
        check(Measurement(pose, covariance))
