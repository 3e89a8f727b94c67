"""The planner in the whole system: physics, a lidar and a camera."""

import math
from contextlib import closing

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.loading import load_scenario
from mecazen_tools.simulate import InProcess, simulate

SIDE = (
    "physics.dt_s=0.002",
    "start={ y_m = 1.2, yaw_deg = -90.0 }",
    "target.path={ kind = 'straight', speed_m_s = 0.6, length_m = 20.0 }",
    "follower.view='side_left'",
)
WALLS = (
    "{ kind = 'box', size_m = [2.5, 0.1, 1.0], position_m = [3.75, 0.9] }",
    "{ kind = 'box', size_m = [2.5, 0.1, 1.0], position_m = [3.75, -0.9] }",
)


def test_in_open_space_the_trajectory_is_the_followers_to_the_bit():
    def run(*settings):
        lidar = ("sim.duration_s=3.0", 'sensor.also=["lidar"]', "physics.dt_s=0.002")
        scenario = load_scenario(SCENARIOS / "back.toml", (*lidar, *settings))
        return simulate(scenario, "back")[0].trajectory_sha256

    assert run("follower.planner={}") == run()


def test_in_a_corridor_the_robot_goes_behind_and_then_back_to_the_side():
    settings = (
        *SIDE,
        "sim.duration_s=12.5",
        f"world.obstacles=[{', '.join(WALLS)}]",
        "follower.planner={ samples = 300 }",
    )
    robots, states = [], []
    scenario = load_scenario(SCENARIOS / "senses.toml", settings)
    with closing(InProcess(scenario)) as loop:
        loop.bus.subscribe(keys.GROUND_TRUTH, lambda m, _: robots.append(m.pose.pose.to_planar()))
        loop.bus.subscribe(keys.FOLLOWER_STATE, lambda state, _: states.append(state))
        for _ in loop.ticks():
            pass
    length, width = scenario.robot.footprint
    inside = [robot for robot in robots if 2.5 < robot.x < 5.0]
    assert inside
    for robot in inside:  # the walls' faces are at ±0.85 m
        reach = length * abs(math.sin(robot.yaw)) + width * abs(math.cos(robot.yaw))
        assert abs(robot.y) + reach < 0.85
    plans = {state.plan for state in states}
    assert {"open", "avoiding", "gave_up_bearing"} <= plans
    assert any(state.plan_reason.startswith("an obstacle is in the way") for state in states)
    assert states[-1].plan == "open"
    assert max(state.last_seen_s for state in states) < 0.5
    assert math.degrees(states[-1].bearing_error) == pytest.approx(0.0, abs=10.0)
