"""Things in a scan: where each begins, and which are the legs of one person."""

import math

import numpy as np
import pytest
from mecazen.messages import LaserScan
from mecazen.scan import STRIDE_M, by_person, clusters, ranges_of

BEAMS = 360
NOTHING = 13.0


def clusters_of(ranges, gap_m=0.1):
    scan = LaserScan(
        angle_min=-math.pi,
        angle_increment=math.tau / BEAMS,
        range_min=0.05,
        range_max=12.0,
        ranges=tuple(ranges),
    )
    return clusters(scan, np.array(scan.ranges), gap_m, farthest_m=5.0)


def test_a_thing_across_the_first_beam_is_one():
    ranges = np.full(BEAMS, NOTHING)
    ranges[:3] = ranges[-3:] = 1.0  # behind
    ranges[180:184] = 2.0  # ahead
    groups = clusters_of(ranges)
    assert sorted(groups.counts.tolist()) == [4, 6]
    behind = int(np.argmin(groups.middle[:, 0]))
    assert groups.middle[behind] == pytest.approx((-1.0, 0.0), abs=0.01)
    # six beams of a degree at 1 m: five steps, from end to end
    assert groups.width[behind] == pytest.approx(5 * math.tau / BEAMS, abs=0.005)
    # with a gap that holds all of it, it begins after its widest gap
    assert clusters_of(ranges, gap_m=3.5).counts.tolist() == [10]


@pytest.mark.parametrize("value", [NOTHING, 6.0, math.nan])
def test_no_hits_are_no_groups(value):
    groups = clusters_of([value] * BEAMS)
    assert (len(groups.xy), len(groups.middle), len(groups.width)) == (0, 0, 0)


def test_the_nearest_legs_are_one_persons():
    places = [(0.0, 0.0), (0.3, 0.0), (0.5, 0.0), (3.0, 0.0), (3.0, 1.1 * STRIDE_M)]
    legs = np.array([True, True, True, False, True])
    persons = by_person(places, legs, ~legs)
    assert [members for members, _ in persons] == [[3], [2, 1], [0], [4]]
    assert persons[1][1] == pytest.approx((0.4, 0.0))


# No return: rplidar sends inf, which becomes range_max + 1; ydlidar 0; null and NaN become 0.
@pytest.mark.parametrize(
    ("ranges", "expected"),
    [
        ([0.0, 0.0, 0.5, 0.02], [math.inf, math.inf, 0.5, 0.02]),  # 0 is no return
        ([0.0, 13.0, 0.5, 40.0], [math.nan, math.inf, 0.5, math.inf]),  # range_max + 1 is
        ([0.0, math.nan], [math.nan, math.nan]),  # covered: nothing is known
    ],
)
def test_a_real_scan_shows_what_no_return_looks_like(ranges, expected):
    scan = LaserScan(range_min=0.05, range_max=12.0, ranges=tuple(ranges))
    assert ranges_of(scan, is_real=True).tolist() == pytest.approx(expected, nan_ok=True)
    assert math.isnan(ranges_of(scan)[0])  # a lost beam of the simulated lidar
