"""A person whom the robot sees for itself: lost behind a wall, and found again."""

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.observe import observe

WALL = "{ kind = 'box', size_m = [1.8, 0.1, 2.0], position_m = [3.4, 0.5] }"
"""Between the robot's way and the person's, who walks past it in 3 s."""


@pytest.mark.parametrize("seed", [1, 2])
def test_a_person_behind_a_wall_for_three_seconds_is_followed_on_when_they_come_out(seed):
    settings = (
        f"seed={seed}",
        "sim.duration_s=11.0",
        "start={ y_m = 1.2, yaw_deg = -90.0 }",
        f"world.obstacles=[{WALL}]",
        "target.path={ kind = 'straight', speed_m_s = 0.6, length_m = 20.0 }",
        "follower.view='side_left'",
    )
    scenario = load_scenario(SCENARIOS / "senses.toml", parse_settings(settings))
    states, legs = observe(scenario, keys.FOLLOWER_STATE, keys.LEGS).samples.values()
    hidden_s = sum(not seen.poses for seen in legs) / scenario.sensors.lidar.rate_hz
    assert hidden_s == pytest.approx(3.0, abs=0.6)
    # never unseen for longer than hidden, but for half a second
    assert 2.0 < max(state.last_seen_s for state in states) < hidden_s + 0.5
    assert states[-1].tracking == "following"
    # meanwhile the robot stays beside the predicted person
    assert abs(states[-1].distance_error) < 0.1
