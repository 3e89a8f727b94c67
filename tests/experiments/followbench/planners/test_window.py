"""The dynamic window."""

from __future__ import annotations

import math

import pytest
from experiments.followbench.planners.views import drive, view
from mecazen_experiments.followbench.planners.window import Window
from mecazen_experiments.followbench.view import Seen


def test_a_free_robot_speeds_up_towards_its_place() -> None:
    v, w = Window().command(view(target=Seen(54.0, 50.0, 0.0, 0.0), v=1.0))
    assert v == pytest.approx(1.2)
    assert w == pytest.approx(0.0, abs=0.04)  # one sample of the yaw rate


def test_it_turns_towards_its_place() -> None:
    _, w = Window().command(view(target=Seen(50.0, 54.0, 0.0, 0.0), v=1.0))
    assert w == pytest.approx(0.1 * math.pi)


def test_no_command_leads_nearer_to_an_obstacle_than_the_clearance() -> None:
    person = Seen(51.1, 50.0, 0.0, 0.0)
    v, _ = Window().command(view(target=Seen(54.0, 52.0, 0.0, 0.0), people=[person], v=0.0))
    assert 50.0 + 0.1 * v + 0.445 + 0.6 < 51.1


def test_a_blocked_robot_turns_to_a_side_that_the_seed_decides() -> None:
    blocked = view(people=[Seen(50.6, 50.0, 0.0, 0.0)], v=0.0)
    turns = {}
    for seed in range(8):
        planner = Window()
        planner.reset(seed)
        v, turns[seed] = planner.command(blocked)
        assert v == 0.1
        planner.reset(seed)
        assert planner.command(blocked) == (v, turns[seed])
    assert set(turns.values()) == {math.pi, -math.pi}


def test_it_follows_a_walker() -> None:
    states = drive(Window(), view(target=Seen(53.0, 50.0, 1.0, 0.0)), 80)
    # speed counts more than the place: it drives up to it at full speed, and turns there
    assert abs(53.0 + 8.0 - states[-1].pose.x) < 3.0
