"""Walks whose values are known: events, parameters, rhythm, and the estimator on known noise."""

import numpy as np
import pytest
from experiments.made_up import RATE_HZ, person, reported
from mecazen.config.people import Body, Limp
from mecazen.skeleton import INDEX, JOINTS, SIDES
from mecazen_experiments.gait.motion import about_path, angles
from mecazen_experiments.gait.refine import LOWER, UPPER, unswapped
from mecazen_experiments.gait.stages import seen_stages
from mecazen_experiments.gait.strides import (
    Events,
    Spread,
    cycles,
    planted,
    strides,
    summary,
    zeni,
)


def measured(t, joints):
    """The gait by Zeni's events."""
    rate_hz = (len(t) - 1) / (t[-1] - t[0])
    return summary(strides(t, joints, zeni(t, about_path(joints, rate_hz))))


def true_gait(t, joints):
    return summary(strides(t, joints, planted(t, joints)))


def by_hand():
    """A walk along x whose feet jump: left strikes at 0, 1, 2 s, right ones at 0.4 and 1.4 s."""
    t = np.arange(250) / 100.0
    joints = np.zeros((len(t), len(JOINTS), 3))
    joints[:, INDEX["pelvis"], 0] = 1.2 * t
    for side, begins, width in (("left", 0.0, 0.05), ("right", 0.4, -0.07)):
        # each foot is where it stands from its strike to the next: 1.2 m farther each time
        standing = 1.2 * np.floor(t - begins + 1e-9) + 1.2 * begins
        for name in ("ankle", "heel", "foot"):
            joints[:, INDEX[f"{side}_{name}"], 0] = standing + (0.1 if side == "left" else 0.0)
            joints[:, INDEX[f"{side}_{name}"], 1] = width
        swings = (t - begins) % 1.0 > 0.65
        joints[swings, INDEX[f"{side}_foot"], 2] = 0.03
    events = Events(
        (np.array([0.0, 1.0, 2.0]), np.array([0.4, 1.4])),
        (np.array([0.6, 1.6]), np.array([0.1, 1.1, 2.1])),
    )
    return t, joints, events


def test_each_parameter_follows_its_definition():
    t, joints, events = by_hand()
    seen = np.ones((len(t), 2))
    seen[:25, 0] = 0.0
    left, _, right = strides(t, joints, events, seen).itertuples()
    assert (left.side, left.start_s, left.end_s) == ("left", 0.0, 1.0)
    assert (left.opposite_off_s, left.opposite_strike_s, left.off_s) == (0.1, 0.4, 0.6)
    assert left.stride_length_m == pytest.approx(1.2)
    assert left.speed_m_s == pytest.approx(1.2)
    assert left.cadence_per_min == pytest.approx(120.0)
    # the left step ends with the left strike at 1 s; the right heel struck at 0.4 s
    assert left.step_time_s == pytest.approx(0.6)
    assert left.step_length_m == pytest.approx(1.3 - 0.48)
    assert right.step_time_s == pytest.approx(0.4)
    assert right.step_length_m == pytest.approx(1.68 - 1.3)
    assert left.step_width_m == right.step_width_m == pytest.approx(0.12)
    assert left.stance_percent == pytest.approx(60.0)
    assert left.swing_percent == pytest.approx(40.0)
    # 0 to 0.1 s and 0.4 to 0.6 s; the right foot swings from 0.1 to 0.4 s
    assert left.double_support_percent == pytest.approx(30.0)
    assert left.single_support_percent == pytest.approx(30.0)
    assert left.clearance_m == pytest.approx(0.03)
    assert (left.seen_percent, right.seen_percent) == (75.0, 100.0)


def test_a_stride_with_a_missing_event_is_left_out():
    _, _, events = by_hand()
    assert len(cycles(events)) == 3
    without = events._replace(offs=(np.array([1.6]), events.offs[1]))
    assert cycles(without)[0] == (0, 1.0, 1.1, 1.4, 1.6, 2.0)
    # two strides taken for one have two strikes of the other foot
    missed = events._replace(strikes=(np.array([0.0, 2.0]), events.strikes[1]))
    assert cycles(missed) == []


def test_a_summary_has_means_deviations_and_asymmetries_of_the_strides():
    t, joints, events = by_hand()
    rows = strides(t, joints, events)
    gait = summary(rows)
    assert gait.left["step_time_s"] == Spread(pytest.approx(0.6), pytest.approx(0.0, abs=1e-9), 2)
    assert gait.right["step_time_s"] == Spread(pytest.approx(0.4), None, 1)
    assert gait.difference("step_time_s") == pytest.approx(0.2)
    assert gait.asymmetry_percent("step_time_s") == pytest.approx(40.0)
    assert gait.sd("step_time_s") is None
    assert summary(rows[:2]) is None


@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_events_are_near_those_of_planted_feet(speed):
    t, joints, phases = person(speed, rate_hz=50.0)
    true, gait = true_gait(t, joints), measured(t, joints)
    turns = np.unwrap(phases[:, 0], period=1.0)
    stride_s = (t[-1] - t[0]) / (turns[-1] - turns[0])
    for each in (true, gait):
        assert each.mean("stride_time_s") == pytest.approx(stride_s, abs=0.002)
        assert each.mean("stride_length_m") == pytest.approx(speed * stride_s, abs=0.005)
        assert each.mean("step_width_m") == pytest.approx(0.1, abs=0.003)
        assert each.asymmetry_percent("step_time_s") == pytest.approx(0.0, abs=2.0)
    # the constants hold for all speeds only about: see docs/mocap.md
    assert gait.mean("stance_percent") == pytest.approx(true.mean("stance_percent"), abs=2.0)
    delays = zeni(t, about_path(joints, 50.0)).less(planted(t, joints))
    assert max(map(abs, delays)) < 0.025


def test_a_limp_is_found_in_its_steps_and_stances():
    limp = Limp(side="right", stance_asymmetry=0.08, step_asymmetry=0.2)
    t, joints, _ = person(0.8, rate_hz=50.0, body=Body(limp=limp))
    true, gait = true_gait(t, joints), measured(t, joints)
    assert true.difference("stance_percent") == pytest.approx(8.0, abs=1.0)
    assert gait.difference("stance_percent") == pytest.approx(8.0, abs=5.0)  # by extrema
    for each in (true, gait):
        assert each.asymmetry_percent("step_length_m") == pytest.approx(-20.0, abs=3.0)


def test_a_person_who_walks_backwards_still_looks_ahead():
    _, joints, _ = person()
    walk = about_path(joints[::-1], RATE_HZ)
    # at the ends, the low-pass leaves some of the pelvis's sway
    assert walk.forward == pytest.approx(np.tile((1.0, 0.0), (len(joints), 1)), abs=0.05)
    assert walk.placed(walk.joints) == pytest.approx(joints[::-1])


# ---- the estimator


JOINT = {"hip": [0, 3], "knee": [1, 4], "ankle": [2, 5]}


def rms(joints, truth):
    errors = angles(joints) - angles(truth)
    return {name: float(np.sqrt(np.mean(errors[:, at] ** 2))) for name, at in JOINT.items()}


@pytest.fixture(scope="module")
def walk():
    t, joints, _ = person()
    return t, joints


def test_errors_become_smaller_by_more_than_a_quarter(walk):
    t, joints = walk
    random = np.random.default_rng(1)
    white = random.normal(0.0, 0.015, joints.shape)
    bias = random.normal(0.0, 0.02, joints.shape[1:])
    bias[:, 2] *= 0.5
    seen = reported(t, joints + bias + white, 0.025)
    refined = seen_stages(seen)["refined"].joints
    raw, errors = rms(seen.joints, joints), rms(refined, joints)
    for name in JOINT:
        assert errors[name] < 0.75 * raw[name], name


@pytest.mark.parametrize("names", [LOWER, UPPER, LOWER + UPPER])
def test_swaps_are_undone(walk, names):
    t, joints = walk
    noisy = joints + np.random.default_rng(2).normal(0.0, 0.01, joints.shape)
    wrong, rows = noisy.copy(), np.r_[40:52, 120:123]
    for name in names:
        left, right = (INDEX[f"{side}_{name}"] for side in SIDES)
        wrong[rows, left], wrong[rows, right] = noisy[rows, right], noisy[rows, left]
    assert unswapped(reported(t, wrong, 0.02)).joints == pytest.approx(noisy)
    assert unswapped(reported(t, noisy, 0.02)).joints == pytest.approx(noisy)


def test_frames_without_a_body_are_bridged(walk):
    t, joints = walk
    gappy = joints.copy()
    gappy[60:75] = np.nan
    stages = seen_stages(reported(t, gappy))
    assert not np.isnan(stages["filtered"].joints).any()
    assert max(rms(stages["refined"].joints, joints).values()) < 0.5


def test_a_person_who_stands_or_is_not_seen_is_not_refined(walk):
    t, joints = walk
    standing = np.tile(joints[:1], (len(t), 1, 1))
    assert [*seen_stages(reported(t, standing))] == ["raw", "filtered"]
    assert [*seen_stages(reported(t, np.full_like(joints, np.nan)))] == ["raw"]
