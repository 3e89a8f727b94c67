"""A guarded follower at a door and at a pillar, in a plane without slip."""

import numpy as np
import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.gaps import gap_to_obstacle
from mecazen_experiments.safety_scores import safety
from mecazen_tools.observe import observe, watch
from mecazen_tools.table import Poses

BESIDE = ("follower.view=side_left", "start={ y_m = 1.2, yaw_deg = -90.0 }")
DOOR_M = 2.5
"""Along x."""
DOOR = [
    f"{{ kind = 'box', size_m = [0.1, 4.0, 1.0], position_m = [{DOOR_M}, {y}] }}"
    for y in (2.45, -2.45)
]
"""It is 0.9 m wide."""
PILLAR = "{ kind = 'cylinder', size_m = [0.2, 2.0], position_m = [2.0, 0.6] }"
"""Robot and person, side by side, pass it one on each side."""


def scenario_of(seconds, obstacles, *settings):
    return load_scenario(
        SCENARIOS / "safety.toml",
        parse_settings(
            (
                "programs.physics='mecazen_experiments.fuzz:Plane'",
                f"sim.duration_s={seconds}",
                "target.path={ kind = 'straight', speed_m_s = 0.6, length_m = 20.0 }",
                f"world.obstacles=[{', '.join(obstacles)}]",
                *settings,
            )
        ),
    )


def run_of(scenario):
    """Return the robot's way, its least gap to what stands around [m], and what the guard says."""
    samples = observe(scenario, keys.GROUND_TRUTH, keys.GUARD_STATE).samples
    odometry, states = samples[keys.GROUND_TRUTH.key], samples[keys.GUARD_STATE.key]
    way = Poses(*map(np.array, zip(*(o.pose.pose.to_planar() for o in odometry), strict=True)))
    things = scenario.world.obstacles
    return way, min(gap_to_obstacle(scenario.robot, way, one).min() for one in things), states


def test_the_guard_alone_lets_the_robot_through_a_door_behind_the_person():
    way, gap, _ = run_of(scenario_of(8.0, DOOR))
    assert way.x[-1] > DOOR_M + 0.3  # all of it
    assert gap > 0.0


def test_the_guard_alone_holds_a_robot_whose_place_leads_it_into_the_jamb_and_says_so():
    way, gap, states = run_of(scenario_of(5.0, DOOR, *BESIDE))
    assert way.x[-1] < DOOR_M
    assert gap > 0.0
    assert states[-1].state == "stop"
    assert "m to the left" in states[-1].reason  # it faces the person, and walks to its left


@pytest.mark.parametrize("planner", [(), ("follower.planner={}",)], ids=["law", "planner"])
def test_a_person_behind_a_pillar_is_seen_again_within_two_seconds(planner):
    scenario = scenario_of(6.5, [PILLAR], *BESIDE, *planner)
    found = safety(watch(scenario), scenario)
    assert 0.2 < found.regain_s < 2.0  # they have been hidden
    assert found.contacts_world == found.contacts_person == 0
    assert found.gap_person_m > 0.0
