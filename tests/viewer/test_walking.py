"""A body that walks where only its pose is known."""

import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D
from mecazen.skeleton import INDEX
from mecazen_viewer.walking import WalkingBody

HEIGHT_M, SPEED_M_S = 1.75, 0.8
FRAME_NS = 40_000_000


def walked(period_ns: int, duration_s: float = 4.0) -> np.ndarray:
    """The joints (N, 20, 3) of a person who walks along x, in pictures of a period."""
    body = WalkingBody(HEIGHT_M)
    times = range(0, round(duration_s * 1e9) + 1, period_ns)
    return np.array(
        [body.walk(Pose2D(SPEED_M_S * ns / 1e9), Twist2D(SPEED_M_S), ns) for ns in times]
    )


def test_each_foot_stands_for_a_while_and_then_takes_a_step():
    joints = walked(FRAME_NS)[50:]  # 2 s, in which the walk has become steady
    for side in ("left", "right"):
        moved_m = np.diff(joints[:, INDEX[f"{side}_ankle"], 0])
        # the ankle of a flat foot stands still; in swing it overtakes a body that moves by 3.2 cm
        assert moved_m.min() < 1e-3
        assert moved_m.max() > 2 * SPEED_M_S * FRAME_NS / 1e9


def test_a_slow_picture_shows_the_same_steps():
    slow, smooth = walked(8 * FRAME_NS), walked(FRAME_NS)[::8]
    assert slow == pytest.approx(smooth, abs=1e-9)  # rounding alone


def test_after_a_gap_the_body_stands_at_the_new_pose():
    body = WalkingBody(HEIGHT_M)
    body.walk(Pose2D(), Twist2D(SPEED_M_S), 0)
    joints = body.walk(Pose2D(50.0), Twist2D(SPEED_M_S), 60 * 10**9)
    feet = [joints[INDEX[f"{side}_ankle"], 0] for side in ("left", "right")]
    assert feet == pytest.approx([50.0, 50.0], abs=0.1)  # of the length of a foot
    assert joints[INDEX["head"], 2] == pytest.approx(HEIGHT_M, abs=0.15)  # the middle of the head
