"""Sampled ways, against the robot of the benchmark."""

from __future__ import annotations

import math

import numpy as np
import pytest
from experiments.followbench.planners.views import CENTER, SIZE
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.planners.ways import LIBRARY, SUDDEN, TIMES, roll, sample
from mecazen_experiments.followbench.unicycle import Unicycle

FINE = int(np.sum(TIMES < 0.5))
"""Number of poses that are one step of the robot apart."""


def random() -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(1))


@pytest.mark.parametrize("now", [(0.0, 0.0), (1.3, -0.4), (-0.8, 2.0), (2.0, 0.0)])
def test_the_robot_drives_every_way_exactly(now: tuple[float, float]) -> None:
    plan = np.linspace(0.5, 1.5, len(TIMES)), np.linspace(-0.5, 0.5, len(TIMES))
    v, w, gentle = sample(plan, random())
    start = Pose2D(50.0, 50.0, 0.7)
    ways = roll(start, now, (v, w), gentle)
    for n in range(len(v)):
        states = [Unicycle(start, *now)]
        for k in range(FINE):
            states.append(states[-1].step(float(ways.v[n, k]), float(ways.w[n, k]), 0.1, SIZE))
        driven = [
            (*s.pose[:2], math.cos(s.pose.yaw), math.sin(s.pose.yaw), s.v, s.w) for s in states
        ]
        planned = np.array([ways.x, ways.y, ways.c, ways.s, ways.v, ways.w])[:, n, :FINE].T
        assert np.allclose(driven[1:], planned, rtol=0.0, atol=1e-12)  # sums in another order


def test_a_coarse_step_leads_where_the_robots_steps_do() -> None:
    constant = np.full((1, len(TIMES)), 1.0), np.full((1, len(TIMES)), 0.8)
    ways = roll(CENTER, (1.0, 0.8), constant, 0)
    state = Unicycle(CENTER, 1.0, 0.8)
    for _ in range(round(TIMES[-1] / 0.1)):
        state = state.step(1.0, 0.8, 0.1, SIZE)
    # the chord of an arc of at most 0.24 rad, against its steps
    assert state.pose[:2] == pytest.approx((ways.x[0, -1], ways.y[0, -1]), abs=0.01)


def test_gentle_ways_slow_down_as_they_speed_up() -> None:
    stop = np.zeros((2, len(TIMES)))
    ways = roll(CENTER, (1.0, 0.0), (stop, stop), 1)
    assert ways.v[0, :4] == pytest.approx((0.8, 0.6, 0.4, 0.2))
    assert ways.v[1, 0] == 0.0


def test_a_resting_robot_may_leave_at_full_speed() -> None:
    ways = roll(CENTER, (0.0, 0.0), SUDDEN, 0)
    assert set(ways.v[:, 0].tolist()) == {-2.0, -1.0, 0.0, 1.0, 2.0}


def test_the_last_plan_is_tried_again_one_step_on() -> None:
    plan = np.array(TIMES), -np.array(TIMES)
    v, w, _ = sample(plan, random())
    n = len(LIBRARY[0]) + len(SUDDEN[0])
    assert v[n, :-1] == pytest.approx(TIMES[:-1] + 0.1)
    assert w[n, :-1] == pytest.approx(-TIMES[:-1] - 0.1)


def test_the_same_seed_gives_the_same_samples() -> None:
    plan = np.zeros(len(TIMES)), np.zeros(len(TIMES))
    one, other = sample(plan, random()), sample(plan, random())
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
