"""A person who walks from the first tick: what catching up costs, beside the least it can."""

import pytest
from harness import SCENARIOS
from mecazen.config.services import AxisLimits
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.simulate import simulate

DURATION_S = 10.0
REACTION_S = 0.06
"""A frame of 40 ms, in which the person has moved for the first time, and a tick each for the
command and for the wheels."""


def least_error(speed: float, reaction_s: float, dt: float = 1e-4) -> float:
    """Return the least mean distance error [m] behind a person who walks off at `speed` [m/s].

    The robot stands until it has seen the person walk, speeds up at its limit, drives at most
    at the rims' speed, and brakes at its limit so that it has the person's speed at its place:
    nothing within the limits is faster.
    """
    limits = AxisLimits().x
    acceleration, fastest = limits.max_acceleration_m_s2, limits.max_velocity_m_s
    own = behind = total = 0.0
    braking = False
    for step in range(round(DURATION_S / dt)):
        closing = own - speed
        braking = braking or (closing > 0.0 and behind <= closing**2 / (2.0 * acceleration))
        if braking:
            own = max(speed, own - acceleration * dt)
        elif step * dt >= reaction_s:
            own = min(fastest, own + acceleration * dt)
        behind += (speed - own) * dt
        total += abs(behind) * dt
    return total / DURATION_S


@pytest.mark.parametrize("speed", [1.0, 1.3, 1.6])
def test_catching_up_costs_a_tenth_more_than_the_fastest_robot_within_the_limits(speed):
    settings = (
        f"sim.duration_s={DURATION_S}",
        f"target.path={{ kind='straight', speed_m_s={speed}, length_m=30.0 }}",
        "target.gait={ sway_m = 0.0, speed_ripple = 0.0 }",
        # the test judges the plan, not the effect of noise
        "sensor.position_std_m=0.001",
        "sensor.yaw_std_deg=0.1",
    )
    scores = simulate(load_scenario(SCENARIOS / "back.toml", parse_settings(settings)), "back")[0]
    least = least_error(speed, REACTION_S)
    assert least_error(speed, 0.0) < scores.d_err_m < 1.1 * least
