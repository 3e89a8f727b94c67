"""Real motors follow commands late, slowly, not at all below a dead band, and each by its gain."""

import math

import msgspec
import pytest
from harness import load_robot
from mecazen.config import PhysicsConfig
from mecazen.geometry import Pose2D
from mecazen.robot import RealMotors
from mecazen.wheels import WheelCommand
from mecazen_physics.motors import MotorModel, friction
from mecazen_physics.simulation import Simulation

DT = 0.005
FAST = (10.0,) * 4


def outputs(motors, steps, command=FAST, supplied=1.0):
    """Return the first wheel's output after each step of a command that begins at time 0."""
    model = MotorModel(motors, DT)
    model.give(command)
    return [model.step(supplied)[0] for _ in range(steps)]


def test_motors_without_parameters_follow_at_once():
    assert outputs(RealMotors(), 3) == [10.0] * 3


def test_a_lag_follows_the_exponential_exactly():
    found = outputs(RealMotors(time_constant_s=0.05), 20)
    expected = [10.0 * (1.0 - math.exp(-DT * (k + 1) / 0.05)) for k in range(20)]
    assert found == pytest.approx(expected, rel=1e-12)


def test_a_delay_within_a_step_shifts_the_response_exactly():
    found = outputs(RealMotors(delay_s=0.0123, time_constant_s=0.05), 20)
    expected = [10.0 * (1.0 - math.exp(-max(DT * (k + 1) - 0.0123, 0.0) / 0.05)) for k in range(20)]
    assert found == pytest.approx(expected, rel=1e-12)


def test_a_delayed_command_does_not_overtake_the_one_before():
    model = MotorModel(RealMotors(delay_s=0.01), DT)
    found = []
    for speed in (1.0, 2.0, 3.0, 4.0, 4.0, 4.0):
        model.give((speed,) * 4)
        found.append(model.step(1.0)[0])
    assert found == [0.0, 0.0, 1.0, 2.0, 3.0, 4.0]


def test_the_dead_band_gain_and_supply_scale_what_is_left():
    motors = RealMotors(dead_band_rad_s=0.5, gains=(1.1, 1.0, 1.0, 1.0))
    assert outputs(motors, 1, (0.4,) * 4) == [0.0]
    assert outputs(motors, 1, (2.5,) * 4) == pytest.approx([2.2])
    assert outputs(motors, 1, (-2.5,) * 4, supplied=0.9) == pytest.approx([-1.98])


def test_friction_opposes_motion_and_vanishes_at_rest():
    motors = RealMotors(coulomb_nm=0.1, viscous_nms=0.01)
    assert friction(motors, 0.0) == 0.0
    assert friction(motors, 5.0) == pytest.approx(0.15)
    assert friction(motors, -5.0) == pytest.approx(-0.15)


# ---- in the simulation


def drive(real, command, seconds=1.0, **physics):
    robot = msgspec.structs.replace(load_robot("nexus"), motors=real)
    simulation = Simulation([(robot, Pose2D())], PhysicsConfig(**physics))
    states = []
    for _ in range(round(seconds / 0.01)):
        simulation.advance([command], 2)
        states.append(simulation.robots[0].state)
    return states


def test_ideal_motors_by_configuration_are_those_of_a_robot_without_any():
    real = RealMotors(delay_s=0.05, time_constant_s=0.1)
    command = WheelCommand(FAST)
    without, ideal = drive(None, command), drive(real, command, motors="ideal")
    assert [s.position for s in without] == [s.position for s in ideal]
    assert without[20].position != drive(real, command)[20].position


def test_wheels_of_a_simulated_robot_follow_late_and_slowly():
    states = drive(RealMotors(delay_s=0.03, time_constant_s=0.1), WheelCommand(FAST), 0.5)
    speeds = [state.joint_velocity[0] for state in states]
    expected = [10.0 * (1.0 - math.exp(-max(0.01 * (k + 1) - 0.03, 0.0) / 0.1)) for k in range(50)]
    assert speeds == pytest.approx(expected, abs=1e-6)  # DART's servo holds them


def test_the_motors_effort_includes_friction():
    plain, rough = (
        drive(motors, WheelCommand(FAST))[-1].joint_effort
        for motors in (RealMotors(), RealMotors(coulomb_nm=0.05, viscous_nms=0.002))
    )
    more = [r - p for r, p in zip(rough[:4], plain[:4], strict=True)]
    # 0.05 + 10·0.002; the load of the rollers is the same to 1 mN·m
    assert more == pytest.approx([0.07] * 4, abs=1e-3)


def test_friction_brakes_wheels_that_a_torque_drives():
    free, braked = (
        drive(motors, WheelCommand((0.1,) * 4, is_effort=True), 0.3)[-1].joint_velocity[0]
        for motors in (RealMotors(), RealMotors(coulomb_nm=0.05))
    )
    assert braked == pytest.approx(
        free / 2.0, rel=0.05
    )  # half the torque is left, and rollers lose less


def test_a_pid_follows_the_motors_lag():
    states = drive(
        RealMotors(time_constant_s=0.2), WheelCommand(FAST), 0.4, drive="effort", dt_s=0.001
    )
    assert states[19].joint_velocity[0] < 8.0


def test_the_supply_sags_while_the_robot_accelerates():
    slow = drive(RealMotors(time_constant_s=0.2, sag_per_nm=0.1), WheelCommand(FAST), 0.3)
    firm = drive(RealMotors(time_constant_s=0.2), WheelCommand(FAST), 0.3)
    assert slow[15].joint_velocity[0] < firm[15].joint_velocity[0]
