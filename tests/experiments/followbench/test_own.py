"""The gait that our robot sees in an episode: in the longest walk without a stop."""

import math

import msgspec
import numpy as np
import pytest
from mecazen.skeleton import JOINTS
from mecazen_experiments.capture import Motion
from mecazen_experiments.followbench.episodes import Density
from mecazen_experiments.followbench.generate import generate
from mecazen_experiments.followbench.own import longest_walk, own_run
from mecazen_experiments.followbench.scenario import scenario_of
from mecazen_tools.observe import watch

STEP_S = 0.02


def who_walks(*parts):
    """Return the motion of a person who walks at speeds [m/s], each for a time [s]."""
    speeds = np.concatenate([np.full(round(time / STEP_S), speed) for speed, time in parts])
    joints = np.zeros((len(speeds), len(JOINTS), 3))
    joints[:, :, 0] = (np.cumsum(speeds) * STEP_S)[:, None]
    return Motion(STEP_S * np.arange(len(speeds)), joints, *[np.zeros(len(speeds))] * 3)


def test_the_longest_walk_ends_where_the_person_stops():
    begin, end = longest_walk(who_walks((1.5, 4.0), (0.0, 6.0), (1.5, 12.0), (0.0, 6.0)))
    # the path is low-passed at 0.3 Hz, so its stops begin and end up to a second later or earlier
    assert begin == pytest.approx(10.0, abs=1.0)
    assert end == pytest.approx(22.0, abs=1.0)


def test_who_never_stops_walks_all_the_time():
    assert longest_walk(who_walks((1.5, 8.0))) == pytest.approx((0.0, 8.0 - STEP_S))


def test_who_stands_does_not_walk():
    begin, end = longest_walk(who_walks((0.0, 8.0)))
    assert end - begin < 2.0 * STEP_S


def test_the_robot_sees_the_strides_of_the_target_without_contact():
    episode = generate("Parallel", "left_side", Density(5), 7)
    scenario = scenario_of(episode, 7)
    short = msgspec.structs.replace(
        scenario, sim=msgspec.structs.replace(scenario.sim, duration_s=9.0)
    )
    run = own_run(watch(short), short)
    assert (run.contacts_person_all, run.contacts_others_all) == (0, 0)
    # a tenth of a stride of about 1 s and 1.5 m would already be another gait
    assert run.stride_time_err_ms < 100.0
    assert run.stride_length_err_mm < 150.0
    assert math.isfinite(run.d_err_m)
