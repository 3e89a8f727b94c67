"""People in a scan: clusters, the legs of one person, and tracks."""

import math

import numpy as np
import pytest
from mecazen.messages import LaserScan
from mecazen.scan import STRIDE_M, by_person, clusters
from mecazen.walkers import FORGET_S, GATE_M, LOOKED_S, Walkers

BEAMS = 360


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
    ranges = np.full(BEAMS, 13.0)  # nothing
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


def test_the_nearest_legs_are_one_persons():
    places = [(0.0, 0.0), (0.3, 0.0), (0.5, 0.0), (3.0, 0.0), (3.0, 1.1 * STRIDE_M)]
    legs = np.array([True, True, True, False, True])
    persons = by_person(places, legs, ~legs)
    assert [members for members, _ in persons] == [[3], [2, 1], [0], [4]]
    assert persons[1][1] == pytest.approx((0.4, 0.0))


def walk(walkers, scans, *, speed=0.8, is_leg=True, begin=0):
    """Show a person who walks along x, 10 times a second; return their last track."""
    for k in range(begin, begin + scans):
        (track,) = walkers.update(0.1 * k, [(speed * 0.1 * k, 2.0)], [is_leg])
    return track


def test_gains_are_those_of_a_constant_velocity_filter():
    # α-β filter of the tracking index λ² = q T³/r of continuous white noise: the steady state
    # satisfies β²/(1-α) = λ² and β = 3(2-α) - sqrt(3(α² - 12α + 12)) (Bar-Shalom, section 6.5.3)
    track = walk(Walkers(), 40)
    assert (track.vx, track.vy, track.speed) == pytest.approx((0.8, 0.0, 0.8), abs=0.002)
    assert track.at(4.0) == pytest.approx((0.8 * 4.0, 2.0), abs=0.003)
    pp, pv, _ = track.variances
    alpha, beta = pp / 0.07**2, 0.1 * pv / 0.07**2
    assert beta**2 / (1.0 - alpha) == pytest.approx(0.5 * 0.1**3 / 0.07**2, rel=1e-6)
    assert beta == pytest.approx(
        3.0 * (2.0 - alpha) - (3.0 * (alpha**2 - 12.0 * alpha + 12.0)) ** 0.5, rel=1e-6
    )


def test_a_person_remains_one_for_a_while_without_looking_like_a_leg():
    walkers = Walkers()
    walk(walkers, 5)
    assert walk(walkers, 10, is_leg=False, begin=5).is_person
    assert not walk(walkers, round(LOOKED_S / 0.1), is_leg=False, begin=15).is_person


def test_two_people_keep_their_tracks():
    walkers = Walkers()
    for k in range(20):  # they pass each other 0.4 m apart, within the gate
        right, left = walkers.update(0.1 * k, [(0.1 * k - 1.0, 0.2), (1.0 - 0.1 * k, -0.2)])
    assert (right.vx, left.vx) == pytest.approx((1.0, -1.0), abs=0.01)
    assert len(walkers.tracks) == 2


def test_a_detection_beyond_the_gate_begins_a_track():
    walkers = Walkers()
    walk(walkers, 6)
    (track,) = walkers.update(0.6, [(0.48 + 1.1 * GATE_M, 2.0)])
    assert (track.detections, track.speed, track.is_person) == (1, 0.0, False)
    assert len(walkers.tracks) == 2


def test_an_unseen_track_continues_and_ends():
    walkers = Walkers()
    walk(walkers, 6)
    assert walkers.update(0.5 + FORGET_S, []) == []
    (track,) = walkers.tracks
    assert track.at(1.0) == pytest.approx((0.8, 2.0), abs=0.02)
    walkers.update(0.6 + FORGET_S, [])
    assert walkers.tracks == []
