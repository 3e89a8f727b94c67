"""The proportional law."""

from __future__ import annotations

import pytest
from experiments.followbench.planners.views import drive, view
from mecazen_experiments.followbench.planners.proportional import Proportional
from mecazen_experiments.followbench.view import Seen

BLIND, BRAKING = Proportional(brakes=False), Proportional(brakes=True)


@pytest.mark.parametrize("planner", [BLIND, BRAKING], ids=["blind", "braking"])
@pytest.mark.parametrize("place", ["back", "left_side"])
def test_it_takes_its_place_by_a_walker(planner: Proportional, place: str) -> None:
    walker = Seen(53.0, 50.0, 1.0, 0.0)
    states = drive(planner, view(target=walker, place=place), 150)
    pose = states[-1].pose
    beside = 1.5 if place == "left_side" else 0.0
    off = abs(68.0 - pose.x) - (0.0 if beside else 1.5), abs(pose.y - 50.0) - beside
    # a unicycle beside its place weaves a little
    assert off == pytest.approx((0.0, 0.0), abs=0.35)


def test_only_the_braking_law_stops_for_a_person() -> None:
    person = Seen(50.95, 50.0, 0.0, 0.0)
    ahead = view(target=Seen(54.0, 50.0, 1.0, 0.0), people=[person], v=1.0)
    assert BLIND.command(ahead)[0] == 2.0
    assert BRAKING.command(ahead)[0] == 0.0


def test_the_target_two_steps_ahead_slows_the_robot_down() -> None:
    # it is 0.6 m ahead of the front, less the 0.2 m to keep, to be reached in half a second
    near = view(target=Seen(51.5, 50.0, 2.0, 0.0), v=1.0)
    # a beam passes the person's middle by up to 0.9°, so it ends up to 2 mm later
    assert BRAKING.command(near)[0] == pytest.approx(0.8, abs=0.004)
