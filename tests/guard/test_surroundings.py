"""What a guard makes of scans: points, margins, velocities, and which scans it refuses."""

import math

import numpy as np
import pytest
from mecazen import messages as m
from mecazen.config import GuardConfig
from mecazen.config.sensors import LidarConfig
from mecazen.geometry import Pose2D
from mecazen_guard.surroundings import SPACING_M, Surroundings

LIDAR, CONFIG = LidarConfig(), GuardConfig()
STEP = math.tau / LIDAR.beams
NO_RETURN = LIDAR.max_range_m + 1.0


def scan(ranges, seconds=0.0, **changes):
    return m.LaserScan(
        header=m.Header(stamp=m.Time.from_ns(round(seconds * 1e9))),
        angle_min=-math.pi,
        angle_increment=STEP,
        range_min=LIDAR.min_range_m,
        range_max=LIDAR.max_range_m,
        ranges=tuple(ranges),
        **changes,
    )


def discs(*places, radius=0.05):
    """Return the ranges of upright cylinders, seen from the origin."""
    angles = -math.pi + STEP * np.arange(LIDAR.beams)
    ranges = np.full(LIDAR.beams, NO_RETURN)
    for x, y in places:
        along = x * np.cos(angles) + y * np.sin(angles)
        across = x * np.sin(angles) - y * np.cos(angles)
        hit = (np.abs(across) < radius) & (along > 0.0)
        ranges[hit] = np.minimum(ranges, along - np.sqrt(np.maximum(radius**2 - across**2, 0.0)))[
            hit
        ]
    return ranges.tolist()


@pytest.fixture
def around():
    return Surroundings(CONFIG, LIDAR, Pose2D(-0.1, 0.0))


def test_points_are_in_base_link_wherever_the_robot_has_gone_since(around):
    around.update(scan(discs((1.0, 0.0))), Pose2D(2.0, 1.0, math.pi / 2))
    # the lidar is 0.1 m behind: the disc's front is 0.85 m ahead of base_link
    (x, y), *_ = around.seen_from(Pose2D(2.0, 1.0, math.pi / 2)).xy[
        np.argsort(np.hypot(*around.seen_from(Pose2D(2.0, 1.0, math.pi / 2)).xy.T))
    ]
    assert (x, y) == pytest.approx((0.85, 0.0), abs=SPACING_M)
    nearest = around.seen_from(Pose2D(2.0, 1.5, math.pi / 2)).xy
    assert np.min(np.hypot(*nearest.T)) == pytest.approx(0.35, abs=0.005)


def test_legs_keep_the_margin_of_persons_and_walls_that_of_things(around):
    angles = -math.pi + STEP * np.arange(LIDAR.beams)
    wall = np.where(np.cos(angles) < -0.7, 2.0 / np.maximum(-np.cos(angles), 0.7), NO_RETURN)
    around.update(scan(np.minimum(wall, discs((1.0, 0.1), (1.0, -0.1)))), Pose2D())
    seen = around.seen_from(Pose2D())
    assert set(seen.margin[seen.xy[:, 0] > 0.0]) == {CONFIG.person_margin_m}
    assert set(seen.margin[seen.xy[:, 0] < 0.0]) == {CONFIG.margin_m}


@pytest.mark.parametrize("speed", [1.2, -1.2])
def test_somebody_who_walks_has_their_speed_and_may_stop(around, speed):
    for k in range(8):
        x = 2.5 + speed * 0.1 * k
        swing = 0.1 * math.sin(k)  # one leg ahead of the other
        around.update(scan(discs((x + swing, 0.1), (x - swing, -0.1)), 0.1 * k), Pose2D())
    seen = around.seen_from(Pose2D())
    goes_on = seen.velocity[~seen.stops]
    # the legs hide parts of each other
    assert np.mean(goes_on[:, 0]) == pytest.approx(speed, abs=0.15)
    assert np.all(np.abs(seen.velocity[seen.stops][:, 0]) < abs(speed) + 0.1)


def test_what_stands_has_no_velocity_while_the_robot_moves(around):
    for k in range(8):
        away = 0.1 * k
        around.update(scan(discs((2.0 - away, 0.3)), 0.1 * k), Pose2D(away))
    assert not around.seen_from(Pose2D(0.7)).velocity.any()


def test_many_beams_without_a_measurement_in_a_row_are_something_near(around):
    ranges = np.full(LIDAR.beams, NO_RETURN)
    ranges[100] = ranges[300] = 0.0  # dropouts
    around.update(scan(ranges), Pose2D())
    assert not len(around.seen_from(Pose2D()).xy)
    ranges[355:365] = 0.0
    around.update(scan(ranges, 0.1), Pose2D())
    x, y = around.seen_from(Pose2D()).xy.mean(axis=0)
    assert (x, y) == pytest.approx((-0.1 + LIDAR.min_range_m, 0.0), abs=0.01)


def test_in_a_closed_room_lost_beams_of_the_simulated_lidar_are_invalid(around):
    ranges = [2.0 if beam % 5 == 0 else 0.0 for beam in range(LIDAR.beams)]
    assert around.implausible(scan(ranges), 0.0) == "80% of the beams are invalid"


def test_a_real_lidar_that_sends_0_for_no_return_is_not_blind():
    around = Surroundings(CONFIG, LIDAR, Pose2D(-0.1, 0.0), is_real=True)
    ranges = [r if r < NO_RETURN else 0.0 for r in discs((1.0, 0.0))]  # nearly all, as outdoors
    seen = scan(ranges)
    assert around.implausible(seen, 0.0) == ""
    around.update(seen, Pose2D())
    assert around.seen_from(Pose2D()).xy[:, 0].min() > 0.5  # the disc alone, and no ghosts


@pytest.mark.parametrize(
    ("given", "now", "said"),
    [
        (scan([2.0] * LIDAR.beams, 1.0), 0.9, "ahead"),
        (scan([2.0] * 100, 1.0), 1.0, "100 beams instead of 720"),
        (scan([0.0] * LIDAR.beams, 1.0), 1.0, "100% of the beams are invalid"),
        (scan([math.nan] * LIDAR.beams, 1.0), 1.0, "100% of the beams are invalid"),
        (scan([2.0] * LIDAR.beams, 0.5), 1.0, "not newer"),
        (scan([2.0] * 10_000, 1.0), 1.0, "not spread"),
    ],
)
def test_an_implausible_scan_is_told(around, given, now, said):
    around.update(scan([2.0] * LIDAR.beams, 0.5), Pose2D())
    assert said in around.implausible(given, now)
    assert around.implausible(scan([NO_RETURN] * LIDAR.beams, 1.0), 1.0) == ""
