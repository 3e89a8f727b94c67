"""The reverse of the motors of a robot file."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.robot import RealMotors
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.compensation import compensated
from mecazen_physics.motor_model import MotorModel

MOTORS = RealMotors(dead_band_rad_s=1.5, gains=(1.1, 0.9, 1.0, 0.95))
STEP_S = 0.005


@given(st.tuples(*[st.floats(0.1, 30.0) | st.floats(-30.0, -0.1)] * 4))
def test_the_motors_of_physics_turn_as_wanted_by_a_compensated_command(wanted):
    model = MotorModel(MOTORS, STEP_S)
    model.give(compensated(WheelSpeeds(*wanted), MOTORS))
    assert list(model.step(1.0)) == pytest.approx(list(wanted))


def test_a_wheel_that_is_to_stand_is_left_alone():
    assert compensated(WheelSpeeds(0.0, 0.04, -0.04, 0.0), MOTORS) == WheelSpeeds()


def test_without_motors_in_the_robot_file_nothing_changes():
    assert compensated(WheelSpeeds(0.01, 2.0, 3.0, 4.0), None) == WheelSpeeds(0.01, 2.0, 3.0, 4.0)
