"""Services that freeze at random moments within a simulated run."""

import pytest
from harness import ROBOTS
from mecazen import keys
from mecazen.config import Scenario
from mecazen.loading import load_scenario
from mecazen_experiments import freezes, fuzz
from mecazen_tools.observe import collect
from mecazen_tools.simulation import Simulation


@pytest.fixture
def frozen(monkeypatch):
    """Keep a list of what freezes, and in which ticks."""
    found = []
    freeze = freezes._freeze

    def note(service, window):
        found.append((service.name, window))
        freeze(service, window)

    monkeypatch.setattr(freezes, "_freeze", note)
    return found


ALONE = "target.path.x_m=30.0", "target.path.y_m=30.0"
"""The guard does not prevent contacts with a person who walks at the robot: docs/safety.md."""


@pytest.mark.parametrize("followed", [ALONE, fuzz.FOLLOWED], ids=["by chance", "by a follower"])
def test_a_guarded_robot_touches_nothing_whichever_service_freezes(frozen, followed):
    settings = ("sim.duration_s=40.0", *followed)
    (job,) = fuzz.jobs([4], ROBOTS / "nexus.toml", settings)
    minute, sha256 = fuzz.FREEZES.measure(job)
    assert {name for name, _ in frozen} >= {"guard", "controller"}
    assert minute.contacts == 0
    assert minute.driven_m > 5.0
    assert fuzz.FREEZES.measure(job) == (minute, sha256)  # chance is drawn from the seed alone


def test_a_robot_that_obeys_silent_services_for_longer_than_predicted_touches_something(
    monkeypatch,
):
    for timeout in ("command_timeout_s", "wheel_timeout_s"):
        monkeypatch.setattr(Scenario, timeout, 0.5)
    (job,) = fuzz.jobs([1], ROBOTS / "nexus.toml", ("sim.duration_s=40.0",))
    assert fuzz.FREEZES.measure(job)[0].contacts > 0


def test_a_frozen_service_gives_nothing_and_then_goes_on(frozen):
    scenario = load_scenario(ROBOTS.parent / "scenarios" / "back.toml", {"sim.duration_s": 20.0})
    with Simulation(scenario) as sim:
        freezes.freeze(sim, 1)
        (commands,) = collect(sim, keys.JOINT_COMMAND).values()
    given = {round(command.header.stamp.ns / 1e7) for command in commands}
    missing = set(range(scenario.sim.ticks)) - given
    windows = [window for name, window in frozen if name == "controller"]
    assert missing == {tick for window in windows for tick in window if tick < scenario.sim.ticks}
