"""Poses by time: known ones to the bit, others between their neighbours."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.poses import PoseHistory

MS = 1_000_000


def history(*poses: Pose2D, step_ms: int = 10, kept_ms: int = 1000) -> PoseHistory:
    made = PoseHistory(kept_ms * MS)
    for number, pose in enumerate(poses):
        made.add(number * step_ms * MS, pose)
    return made


def test_a_known_pose_is_returned_as_it_is():
    poses = [Pose2D(0.1 * n, -0.3 * n, 0.7 * n) for n in range(4)]
    made = history(*poses)
    assert [made.at(n * 10 * MS) for n in range(4)] == poses


def test_the_yaw_turns_the_shorter_way():
    pose = history(Pose2D(yaw=math.pi - 0.1), Pose2D(yaw=-math.pi + 0.3)).at(5 * MS)
    assert pose.yaw == pytest.approx(-math.pi + 0.1)


@given(share=st.floats(0.0, 1.0), speed=st.floats(-2.0, 2.0))
def test_steady_motion_is_placed_where_it_was(share, speed):
    poses = [Pose2D(speed * 0.01 * n, 0.0, 0.0) for n in range(20)]
    time_ns = round(share * 190 * MS)
    # to the rounding of the time to nanoseconds
    assert history(*poses).at(time_ns).x == pytest.approx(speed * time_ns / 1e9, abs=1e-12)


@pytest.mark.parametrize("time_ns", [-1, 31 * MS])
def test_a_time_outside_of_the_history_is_refused_with_what_is_known(time_ns):
    with pytest.raises(RefusedError, match=r"no pose is known of .* s, only of 0 to 0.03 s"):
        history(*[Pose2D()] * 4).at(time_ns)


def test_a_time_before_what_is_kept_is_refused():
    with pytest.raises(RefusedError, match=r"only of 0\.02 to 0\.03 s"):
        history(*[Pose2D()] * 4, kept_ms=10).at(10 * MS)


def test_no_time_is_the_newest():
    assert history(*[Pose2D(x=float(n)) for n in range(4)], kept_ms=10).at(0) == Pose2D(x=3.0)


def test_an_empty_history_knows_nothing():
    with pytest.raises(RefusedError, match="only of no time"):
        PoseHistory(MS).at(5)
