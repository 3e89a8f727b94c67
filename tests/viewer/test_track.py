"""Poses in between, and trails."""

import pytest
from mecazen.geometry import Pose2D
from mecazen_viewer.track import PoseSeries

S = 10**9


def test_outside_of_what_is_known_it_is_at_the_nearest_pose_and_between_interpolated():
    track = PoseSeries()
    assert track.at(0) is None
    track.add(5 * S, Pose2D(1.0))
    track.add(6 * S, Pose2D(2.0))
    assert track.at(0) == Pose2D(1.0)
    assert track.at(11 * S // 2) == Pose2D(1.5)
    assert track.at(9 * S) == track.newest == Pose2D(2.0)


def test_a_trail_is_as_long_as_a_minute_and_has_five_points_a_second():
    track = PoseSeries()
    longer = [track.add(tick * S // 100, Pose2D(tick / 1000)) for tick in range(10_001)]
    assert sum(longer) == 501
    assert len(track.trail) == 301
    assert track.trail[0] == pytest.approx((4.0, 0.0))


def test_what_is_put_elsewhere_leaves_no_trail_between():
    track = PoseSeries()
    track.add(0, Pose2D(0.0))
    track.add(S, Pose2D(0.5))
    track.add(2 * S, Pose2D(7.0))
    assert track.trail.tolist() == [[7.0, 0.0]]
