"""How well a walk was captured, where errors are known."""

import math

import numpy as np
import pytest
from experiments.made_up import BACK, run
from experiments.walks import person, reported
from mecazen.errors import ConfigError
from mecazen.skeleton import ANGLES, JOINTS
from mecazen_experiments.capture import Capture
from mecazen_experiments.quality import SETTLING_S, numbers, quality

WALKED_S = 12.0


def captured(joints, truth, t, phases, seen=2):
    """A capture of a person who walks from the first tick on."""
    true = reported(t, truth, 0.0)._replace(phases=phases)
    confidence = np.full(joints.shape[:2], seen)
    ticks = round(WALKED_S / 0.01)
    x = 1.2 * 0.01 * np.arange(ticks)
    pose = {"target": (x, 0.0, 0.0), "robot": (x - 1.0, 0.0, 0.0)}
    table = run(ticks, **pose, odom=pose["robot"])
    return Capture(true, reported(t, joints)._replace(confidence=confidence), table, "sha")


@pytest.fixture(scope="module")
def walk():
    return person(duration_s=WALKED_S)


def test_without_noise_nothing_is_wrong(walk):
    t, joints, phases = walk
    found, curves = quality(captured(joints, joints, t, phases), BACK)
    assert found.rmse_deg["raw"] == {"hip": 0.0, "knee": 0.0, "ankle": 0.0}
    assert found.seen == dict.fromkeys(JOINTS, 1.0)
    assert found.truth.mean("speed_m_s") == pytest.approx(1.2, rel=0.01)
    assert curves.angles["raw"] == pytest.approx(curves.angles["truth"])
    assert len(curves.phases) == (t >= SETTLING_S).sum()
    named = numbers(found)
    assert named["raw_hip_deg"] == 0.0
    assert named["knee_seen_percent"] == 100.0
    assert abs(named["stride_length_err_mm"]) < 20.0


def test_a_leg_that_is_reported_aside_is_an_error_and_a_constant_one_is_none_when_centred(walk):
    t, joints, phases = walk
    turned = joints.copy()
    turned[:, JOINTS.index("left_ankle"), 2] += 0.05
    found, curves = quality(captured(turned, joints, t, phases, seen=1), BACK)
    off = curves.angles["raw"] - curves.angles["truth"]
    column = off[:, ANGLES.index("left_ankle")]
    expected = math.sqrt((column**2).mean() / 2.0)  # the right leg's is right
    assert found.rmse_deg["raw"]["ankle"] == pytest.approx(expected)
    centred = math.sqrt(column.var() / 2.0)
    assert found.centred_deg["raw"]["ankle"] == pytest.approx(centred)
    assert found.seen == dict.fromkeys(JOINTS, 0.0)


def test_a_person_who_stands_has_no_gait(walk):
    t, joints, phases = walk
    still = np.broadcast_to(joints[0], joints.shape)
    with pytest.raises(ConfigError, match="nobody takes two strides"):
        quality(captured(still, still, t, phases), BACK)


def test_a_walk_that_no_frame_shows_has_no_scores_instead_of_nan(walk):
    t, joints, phases = walk
    found = numbers(quality(captured(np.full_like(joints, np.nan), joints, t, phases), BACK)[0])
    assert not {"raw_knee_deg", "refined_knee_deg", "strike_err_ms"} & found.keys()
    assert found["raw_jitter_mm"] is None
