"""A robot that is driven at random touches nothing with a guard, and much without."""

import pytest
from harness import ROBOTS
from mecazen_experiments import fuzz


@pytest.mark.parametrize("physics", [False, True], ids=["plane", "rollers"])
def test_a_guarded_robot_touches_nothing(monkeypatch, physics):
    monkeypatch.setattr(fuzz, "EPISODE_S", 4.0)
    ridden = fuzz.episode(3, physics=physics, robot=ROBOTS / "nexus.toml")
    assert ridden.contacts == 0
    assert ridden.driven_m > 1.0


def test_a_robot_without_a_guard_does(monkeypatch):
    monkeypatch.setattr(fuzz, "EPISODE_S", 20.0)
    ridden = fuzz.episode(1, physics=False, robot=ROBOTS / "nexus.toml", guarded=False)
    assert ridden.contacts > 0
    assert ridden.least_gap_m < 0.0
