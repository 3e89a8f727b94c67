"""The interacting multiple models: their modes, and the noise that they learn."""

import math

import numpy as np
import pytest
from follower.walks import FRAME_S, NOISE, make
from mecazen.config.follower import ImmParams
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators.imm import AT_BLUNT, BLUNT_DEG, SHARP_DEG, at_noise, modes_of
from mecazen_follower.estimators.turn_rate import SEEN, move

PARAMS = ImmParams(manoeuvre_s=1.0)


def test_a_sharp_sensor_has_the_modes_of_the_parameters_and_a_blunt_one_those_found_for_it():
    given = {name: getattr(PARAMS, name) for name in ImmParams.__struct_fields__}
    assert at_noise(PARAMS, SHARP_DEG) == at_noise(PARAMS, 1.0) == pytest.approx(given)
    blunt = at_noise(ImmParams(), BLUNT_DEG)
    assert {name: blunt[name] for name in AT_BLUNT} == pytest.approx(AT_BLUNT)
    assert blunt == pytest.approx(at_noise(ImmParams(), 180.0))


def test_between_sharp_and_blunt_a_parameter_changes_by_a_power_of_the_noise():
    middle = at_noise(PARAMS, math.sqrt(SHARP_DEG * BLUNT_DEG))
    factor = math.sqrt(AT_BLUNT["manoeuvre_s"] / ImmParams().manoeuvre_s)
    assert middle["manoeuvre_s"] == pytest.approx(1.0 * factor)
    assert middle["sway_m_sqrt_m"] == PARAMS.sway_m_sqrt_m  # the same at any noise


def test_of_the_five_modes_one_stands_and_two_do_not_turn():
    modes = modes_of(PARAMS)
    assert [mode.moves for mode in modes] == [False, True, True, True, True]
    assert [mode.turns for mode in modes] == [False, False, True, True, True]
    assert modes[-1].mean_sojourn == 1.0


IMM = {
    "sway_m_sqrt_m": 0.03,
    "standing_yaw_std_rad": 0.2,
    "standing_s": 2.0,
    "straight_acceleration_std_m_s2": 0.02,
    "straight_yaw_std_rad": 0.01,
    "straight_s": 10.0,
    "turning_acceleration_std_m_s2": 0.02,
    "turning_yaw_acceleration_std_rad_s2": 0.02,
    "turning_s": 10.0,
    "manoeuvre_step_m_sqrt_s": 0.05,
    "manoeuvre_acceleration_std_m_s2": 2.0,
    "manoeuvre_yaw_acceleration_std_rad_s2": 3.0,
    "manoeuvre_s": 0.5,
}


def error_and_nees(memory):
    """Return mean position error [m] and NEES with a sensor 3 times worse than reported."""
    rng = np.random.default_rng(5)
    estimator = make("imm", **IMM, noise_memory_s=memory)
    state = np.array([0.0, 0.0, 0.0, 0.8, 0.0])
    errors, nees = [], []
    for frame in range(1500):  # a minute, in turns of 10 s straight and 10 s of a circle
        state[4] = 0.5 if frame % 500 < 250 else 0.0
        state = move(state, FRAME_S)
        x, y, yaw = (state[:SEEN] + 3.0 * rng.normal(size=3) * np.sqrt(np.diag(NOISE))).tolist()
        estimator.predict(FRAME_S)
        estimator.update(Pose2D(x, y, wrap(yaw)), NOISE)
        if frame < 250:
            continue
        pose, _, covariance = estimator.estimate
        error = state[:SEEN] - np.array(pose)
        error[2] = wrap(error[2])
        errors.append(math.hypot(*error[:2]))
        nees.append(error @ np.linalg.solve(np.array(covariance), error))
    return np.mean(errors), np.mean(nees)


def test_a_filter_that_learns_its_noise_is_better_and_knows_how_good_it_is():
    error, nees = error_and_nees(10.0)
    untaught_error, untaught_nees = error_and_nees(0.0)
    assert error < 0.7 * untaught_error
    # 3 degrees of freedom; the walk is not of the filter's own model, so half as much again
    # is granted either way, where 9 times the variance gives far more.
    assert 2.0 < nees < 4.5
    assert untaught_nees > 9.0
