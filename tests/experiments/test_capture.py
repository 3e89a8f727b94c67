"""One walk as it is captured: what the tracker saw, placed by odometry beside the truth."""

import math

import numpy as np
import pytest
from experiments.made_up import run
from mecazen import messages as m
from mecazen.keys import SKELETONS, TARGET_SKELETON
from mecazen.skeleton import ANGLES, JOINTS
from mecazen_experiments import capture as module
from mecazen_experiments.capture import Capture, angles, capture
from mecazen_tools.observe import Observed
from people import body


def header(t_s):
    return m.Header(m.Time.from_ns(round(t_s * 1e9)))


def skeleton(x, t_s=0.0):
    """Return a body whose joints are all at one place, 1 m to the left."""
    return m.Skeleton(header(t_s), joints=(m.Point(x, 1.0, 0.5),) * len(JOINTS), phases=(0.2, 0.7))


@pytest.fixture
def found(monkeypatch) -> Capture:
    """A capture of a robot that stands at (2, 0) in odom and looks to the left."""
    truth = [skeleton(x, 0.02 * n) for n, x in enumerate((3.0, 4.0, 5.0, 6.0))]
    frames = [
        m.Skeletons(),  # of before the start
        m.Skeletons(header(0.02), (skeleton(3.0),)),
        m.Skeletons(header(0.06)),
    ]
    table = run(10, odom=(2.0, 0.0, math.pi / 2))
    samples = {TARGET_SKELETON.key: truth, SKELETONS.key: frames}
    monkeypatch.setattr(module, "observe_bodies", lambda _: Observed(table, "sha", samples))
    return capture(None)


def test_what_was_seen_is_placed_by_odometry_at_its_time(found):
    assert found.seen.t == pytest.approx([0.02, 0.06])
    assert found.seen.reported.tolist() == [True, False]
    # 3 m ahead and 1 m to the left of a robot that looks along y
    assert found.seen.joints[0] == pytest.approx(np.tile((1.0, 3.0, 0.5), (len(JOINTS), 1)))
    assert np.isnan(found.seen.phases[1]).all()
    assert found.trajectory_sha256 == "sha"


def test_the_truth_is_that_of_the_frames(found):
    assert found.truth.rate_hz == pytest.approx(50.0)
    assert found.truth_at_frames.joints[:, 0, 0].tolist() == [4.0, 6.0]
    assert found.truth.phases[0].tolist() == [0.2, 0.7]
    later = found.since(0.03)
    assert (later.truth.t.tolist(), later.seen.t.tolist()) == ([0.04, 0.06], [0.06])
    assert later.table is found.table


def test_angles_are_in_degrees():
    joints = body(hips=(math.radians(20.0), 0.0), knees=(0.0, math.radians(30.0)))
    (found,) = angles(joints[None])
    by_name = dict(zip(ANGLES, found, strict=True))
    # 10 degrees of hip flexion are the pelvis's tilt
    assert by_name["left_hip"] == pytest.approx(30.0)
    assert by_name["right_knee"] == pytest.approx(30.0)
