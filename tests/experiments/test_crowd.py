"""In a crowd the robot follows its person, and takes no walker for them."""

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.observe import observe

PERSON = "target.path={ kind = 'straight', speed_m_s = 0.6, length_m = 20.0 }"
BESIDE_A_WALL = (
    "start={ y_m = 1.2, yaw_deg = -90.0 }",
    "world.obstacles=[{ kind = 'box', size_m = [1.8, 0.1, 2.0], position_m = [3.4, 0.5] }]",
    "follower.view='side_left'",
)
CASES = {
    # through the gap of 1.6 m, after 4 s
    "crossing": (
        9.0,
        ("world.obstacles=[]", "follower.standoff_m=1.6", "start={ x_m = -1.6 }"),
        "x_m = 1.6, y_m = 4.4, yaw_deg = -90.0, speed_m_s = 1.1, length_m = 9.0",
    ),
    "side by side": (
        9.0,
        (
            "world.obstacles=[]",
            "start={ x_m = -1.2 }",
        ),
        "y_m = 0.6, speed_m_s = 0.6, length_m = 20.0",
    ),
    # towards the person on the robot's side of the wall, while it hides the person
    "behind a wall with somebody before it": (
        11.0,
        BESIDE_A_WALL,
        "x_m = 8.5, y_m = -0.7, yaw_deg = 180.0, speed_m_s = 0.8, length_m = 20.0",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_nobody_else_is_taken_for_the_person(case):
    duration_s, settings, walker = CASES[case]
    settings = (
        *settings,
        f"sim.duration_s={duration_s}",
        PERSON,
        f"crowd.walkers=[{{ path = {{ kind = 'straight', {walker} }} }}]",
    )
    walled = settings[:3] == BESIDE_A_WALL
    scenario = load_scenario(SCENARIOS / "senses.toml", parse_settings(settings))
    topics = keys.FOLLOWER_STATE, keys.GROUND_TRUTH, keys.ODOM, keys.TARGET_ODOM
    states, *poses = observe(scenario, *topics).samples.values()
    errors, hidden = [], 0
    for state, *placed in zip(states, *poses, strict=True):
        if not state.estimate:
            continue
        truth, odom, person = (of.pose.pose.to_planar() for of in placed)
        estimate = truth.compose(odom.between(state.estimate[0].pose.pose.to_planar()))
        errors.append(estimate.distance(person))
        if walled:  # the wall is along y = 0.5
            part = (0.5 - person.y) / (truth.y - person.y)
            hidden += abs(person.x + part * (truth.x - person.x) - 3.4) < 0.9
    assert bool(hidden) == walled
    hidden_s = hidden * scenario.sim.tick_s
    # never lost for longer than hidden, but for half a second
    assert max(state.last_seen_s for state in states) < hidden_s + 0.5
    assert {state.tracking for state in states} <= {"waiting", "following", "coasting"}
    # who walks side by side is 0.6 m away: nearer to the person than to them
    assert max(errors) < 0.3 or walled
    assert errors[-1] < 0.1
