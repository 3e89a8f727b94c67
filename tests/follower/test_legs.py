"""Persons from legs: against places that are known, and what must not be found."""

import math

import pytest
from follower.rooms import scan
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan
from mecazen_follower.measurement import NO_HEADING
from mecazen_follower.perception.legs import PAIR_STD_M, SINGLE_STD_M, clusters_of, persons
from msgspec.structs import replace


def scan_of(circles, walls=(), std=0.0):
    return scan(Pose2D(), circles, walls, beams=720, std=std)


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 180.0, -120.0])
def test_two_legs_are_one_person_between_them_also_across_the_end_of_a_scan(bearing_deg):
    place = Pose2D(yaw=math.radians(bearing_deg)).compose(Pose2D(1.5, 0.0))
    legs = [(place.x + 0.15, place.y + 0.1, 0.05), (place.x - 0.15, place.y - 0.1, 0.05)]
    ((pose, covariance),) = persons(clusters_of(scan_of(legs, std=0.01)))
    # noise of 10 mm on some ten beams, and what a leg's depth is taken for
    assert pose.distance(place) < 0.02
    assert covariance[0][0] == PAIR_STD_M**2
    assert covariance[2][2] == NO_HEADING


def test_one_leg_behind_the_other_is_a_person_with_more_doubt():
    ((pose, covariance),) = persons(clusters_of(scan_of([(1.5, 0.0, 0.05), (1.9, 0.0, 0.05)])))
    assert pose.distance(Pose2D(1.5, 0.0)) < 0.03
    assert covariance[0][0] == SINGLE_STD_M**2


@pytest.mark.parametrize(
    "scan",
    [
        scan_of([], walls=[2.0]),
        scan_of([(3.0, 0.0, 0.5)]),
        replace(scan_of([]), ranges=(2.0,) * 720),
        scan_of([]),
        LaserScan(ranges=(), range_max=12.0),
    ],
    ids=["a wall", "a column of 1 m", "a round room", "nothing", "no beams"],
)
def test_what_is_no_leg_is_nobody(scan):
    assert persons(clusters_of(scan)) == []
