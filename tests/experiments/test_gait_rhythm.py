"""How strides differ in time, found in all of their frames."""

import numpy as np
import pytest
from experiments.walks import person, reported
from mecazen.config.people import Body
from mecazen_experiments.gait.events import planted, zeni
from mecazen_experiments.gait.parameters import strides, summary
from mecazen_experiments.gait.path import about_path
from mecazen_experiments.gait.rhythm import Rhythm, rhythm
from mecazen_experiments.gait.stages import seen_stages
from mecazen_experiments.refine import smooth

RATE_HZ = 25.0


def drifting(joints, std):
    """Joints with noise that drifts within half a second, as that of body trackers."""
    fresh = np.random.default_rng(1).normal(0.0, std, joints.shape)
    keep = np.exp(-1.0 / (RATE_HZ * 0.5))
    noise = [fresh[0]]
    for one in fresh[1:]:
        noise.append(keep * noise[-1] + np.sqrt(1.0 - keep**2) * one)
    return joints + np.array(noise)


@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_stride_times_vary_as_those_of_the_truth_though_the_tracker_is_noisy(speed):
    t, joints, _ = person(speed, duration_s=20.0, body=Body(stride_cv=0.02))
    true = summary(strides(t, joints, planted(t, joints))).sd("stride_time_s")
    seen = reported(t, drifting(joints, 0.02), 0.02)
    filtered = smooth(seen)
    by_extrema = summary(strides(t, filtered, zeni(t, about_path(filtered, RATE_HZ))))
    found = seen_stages(seen)["filtered"].gait.sd("stride_time_s")
    # noise of 20 mm is 20 ms of a foot that swings at 1 m/s, and 16 signals together have 5 ms
    assert found == pytest.approx(true, abs=0.005)
    assert abs(found - true) < abs(by_extrema.sd("stride_time_s") - true)


def test_a_steady_walk_has_an_even_rhythm():
    t, joints, _ = person(1.0)
    seen = reported(t, joints)
    found = rhythm(seen, about_path(smooth(seen), RATE_HZ))
    inside = (found.even > t[0]) & (found.even < t[-1])
    assert found.own[inside] == pytest.approx(found.even[inside], abs=0.005)


def test_events_are_at_one_place_of_the_cycle_and_none_is_missing():
    # the second stride takes 1.2 s, the others 1 s
    even = np.arange(9) / 2.0
    own = even + np.array([0.0, 0.0, 0.0, 0.1, 0.2, 0.2, 0.2, 0.2, 0.2])
    found = Rhythm(even, own).regular(np.array([0.24, 1.31, 3.45]))
    assert found == pytest.approx([0.25, 1.3, 2.45, 3.45], abs=0.02)
    assert len(Rhythm(even, own).regular(np.empty(0))) == 0
