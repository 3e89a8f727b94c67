"""Wheels under torque: what they accelerate and hold, their limits, and real motors."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from harness import load_robot
from mecazen.config import PhysicsConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.links import robot_links
from mecazen.robot import RealMotors
from mecazen.rollers import Roller
from mecazen.wheels import WheelCommand
from mecazen_bench.engine import lateral_gain
from mecazen_physics.motors import MotorModel
from mecazen_physics.simulation import Simulation
from mecazen_physics.world import GRAVITY
from physics_rig import Rig, masses, wheel_speeds

FORWARD, LEFT = Twist2D(x=0.3), Twist2D(y=0.3)


def test_wheel_torque_accelerates_the_mass_and_the_turning_wheels(robot):
    rig = Rig(robot)
    torque = 0.05
    rig.advance_effort([torque] * 4, 1000)
    mass, turning = masses(robot)
    expected = 4 * torque / robot.wheels.radius_m / (mass + turning)
    # 2 %: each hand-over sets a roller turning, and chords of the barrel cost a little.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)
    assert rig.state().joint_effort[:4] == [torque] * 4


def test_a_coasting_robot_only_loses_energy_and_little(robot):
    rig = Rig(robot)
    rig.drive(wheel_speeds(robot, FORWARD), 1.0)
    energies = []
    for _ in range(100):
        rig.advance_effort([0.0] * 4)
        energies.append(rig.body.skeleton.computeKineticEnergy())
    # Ripple of 0.02 mm stores m·g·20 µm = 3 mJ of some 0.7 J for a while.
    assert (np.diff(energies) < 0.005 * energies[0]).all()
    # Chords and hand-overs take 0.3 N from a robot of 130 N, less than rubber on a floor.
    assert 0.8 * energies[0] < energies[-1] < energies[0]


@pytest.mark.parametrize("drive_by", ["velocity", "effort"])
def test_standing_wheels_hold_the_robot_on_a_slope_with_the_torque_of_its_weight(robot, drive_by):
    rig = Rig(robot, slope_deg=10.0, drive=drive_by)
    state = rig.drive([0.0] * 4, 3.0)[-1]
    weight = masses(robot)[0] * GRAVITY * math.sin(math.radians(10.0))
    # 3 %: the PID's integral part is still settling, and the robot creeps as it does.
    assert sum(state.joint_effort[:4]) == pytest.approx(weight * robot.wheels.radius_m, rel=0.03)
    assert abs(state.position[0]) < 0.01


def test_free_wheels_let_the_robot_roll_down_the_slope(robot):
    heading = math.radians(90.0)
    rig = Rig(robot, Pose2D(yaw=heading), slope_deg=5.0, slope_heading_deg=90.0)
    rig.advance_effort([0.0] * 4, 500)
    mass, turning = masses(robot)
    expected = -0.5 * GRAVITY * math.sin(math.radians(5.0)) * mass / (mass + turning)
    # 2 %: as for the acceleration by torque.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)
    assert rig.state().position[1] < 0.0


def test_bearing_friction_costs_the_power_that_the_rollers_speeds_predict(nexus):
    def power(friction: float) -> float:
        rollers = msgspec.structs.replace(nexus.rollers, bearing_friction_nms=friction)
        robot = msgspec.structs.replace(nexus, rollers=rollers)
        rig, speeds = Rig(robot), wheel_speeds(robot, LEFT)
        rig.drive(speeds, 1.0)
        # torque of every step: hand-overs make that of a tick's last one no mean
        states = [rig.advance(speeds, 1) for _ in range(2000)]
        return float(np.mean([np.dot(s.joint_effort[:4], s.joint_velocity[:4]) for s in states]))

    friction = 5e-5
    roller = Roller.from_robot(nexus)
    arc = np.linspace(-roller.half_arc, roller.half_arc, 101)
    radius = roller.wheel_radius - roller.axis_distance / np.cos(arc)
    spin = LEFT.y * lateral_gain(nexus) / math.sin(roller.angle) / radius
    handovers = roller.count * wheel_speeds(nexus, LEFT)[1] / (2.0 * math.pi)
    # A roller stops before it meets the ground again: half of what spins it up goes into skid.
    spin_up = roller.inertia[1] * np.mean(spin**2) * handovers
    expected = 4 * (friction * np.mean(spin**2) + spin_up)
    # 10 %: of it 7 % by the step's length; and the mean gain stands for all angles.
    assert power(friction) - power(0.0) == pytest.approx(expected, rel=0.1)


def test_the_motors_limits_hold(robot):
    rig = Rig(robot, ground_friction=0.0)
    limit = robot.wheels.max_torque_nm
    for _ in range(50):
        rig.advance([1e3, -1e3, 1e3, -1e3])
        state = rig.state()
        assert max(map(abs, state.joint_effort[:4])) <= limit * (1 + 1e-9)  # solver's rounding
        assert max(map(abs, state.joint_velocity[:4])) <= robot.wheels.max_speed_rad_s * (1 + 1e-6)


def test_motors_too_weak_for_a_slope_let_the_robot_roll_down_with_all_their_torque(robot):
    weight = masses(robot)[0] * GRAVITY * math.sin(math.radians(10.0))
    limit = 0.15 * weight * robot.wheels.radius_m  # 0.25 would hold it
    wheels = msgspec.structs.replace(robot.wheels, max_torque_nm=limit)
    weak = msgspec.structs.replace(robot, wheels=wheels)
    rig = Rig(weak, slope_deg=10.0)
    torques = []
    for _ in range(50):
        rig.advance([0.0] * 4)
        torques.append(rig.state().joint_effort[:4])
    # at once, and to the solver's rounding
    assert np.array(torques) == pytest.approx(limit, rel=1e-9)
    expected = -0.5 * 0.4 * weight / sum(masses(robot))
    # 2 %: as for the acceleration by torque.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)


def test_commanded_torque_is_limited_and_stops_at_the_motors_speed(robot):
    rig = Rig(robot, ground_friction=0.0)
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 1)
    limit, fastest = robot.wheels.max_torque_nm, robot.wheels.max_speed_rad_s
    assert rig.state().joint_effort[:4] == [limit, -limit, 0.0, 0.0]
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 200)
    speeds = rig.state().joint_velocity
    step = limit / robot_links(robot)[0].moments[1] * 1e-3  # at most one step's gain beyond
    assert fastest <= speeds[0] <= fastest + step
    assert -fastest - step <= speeds[1] <= -fastest


def test_the_pid_drive_reaches_the_commanded_speed(robot):
    rig = Rig(robot, drive="effort")
    states = rig.drive(wheel_speeds(robot, FORWARD), 2.0)[150:]
    # 0.5 %: the hand-over between rollers disturbs the wheels by some 0.2 %.
    assert np.mean([s.joint_velocity[:4] for s in states]) * robot.wheels.radius_m == pytest.approx(
        FORWARD.x, rel=0.005
    )
    assert max(abs(e) for s in states for e in s.joint_effort[:4]) <= robot.wheels.max_torque_nm


DT = 0.005
FAST = (10.0,) * 4


def outputs(motors, steps, command=FAST, supplied=1.0):
    """Return the first wheel's output after each step of a command that begins at time 0."""
    model = MotorModel(motors, DT)
    model.give(command)
    return [model.step(supplied)[0] for _ in range(steps)]


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


# ---- in the simulation


def drive(real, command, seconds=1.0, **physics):
    robot = msgspec.structs.replace(load_robot("nexus"), motors=real)
    simulation = Simulation([(robot, Pose2D())], PhysicsConfig(**physics))
    states = []
    for _ in range(round(seconds / 0.01)):
        simulation.advance([command], 2)
        states.append(simulation.robots[0].state)
    return states


def test_wheels_of_a_simulated_robot_follow_late_and_slowly():
    states = drive(RealMotors(delay_s=0.03, time_constant_s=0.1), WheelCommand(FAST), 0.5)
    speeds = [state.joint_velocity[0] for state in states]
    expected = [10.0 * (1.0 - math.exp(-max(0.01 * (k + 1) - 0.03, 0.0) / 0.1)) for k in range(50)]
    assert speeds == pytest.approx(expected, abs=1e-6)  # DART's servo holds them


@pytest.mark.parametrize(("is_effort", "value"), [(False, 20.0), (True, 100.0)])
def test_a_motors_torque_within_its_limit_less_friction_turns_the_wheel(nexus, is_effort, value):
    motors = RealMotors(coulomb_nm=0.05, viscous_nms=0.01)
    rig = Rig(msgspec.structs.replace(nexus, motors=motors), ground_friction=0.0)
    inertia = masses(nexus)[1] * nexus.wheels.radius_m**2 / 4
    speed, limit = 0.0, nexus.wheels.max_torque_nm
    for sign in (1, 1, 1, -1, -1, -1, -1, -1):
        rig.world.advance([WheelCommand([sign * value] * 4, is_effort)], 1)
        state = rig.state()
        effort, before, speed = state.joint_effort[0], speed, state.joint_velocity[0]
        friction = math.copysign(0.05, before) + 0.01 * before if before else 0.0
        assert abs(effort) <= limit * (1 + 1e-9)  # solver's rounding
        # 0.01 N·m: rollers that the wheel pushes off the ground
        assert effort - friction == pytest.approx(inertia * (speed - before) / 1e-3, abs=0.01)


def test_the_pid_restarts_after_commands_of_torque(nexus):
    rig = Rig(nexus, slope_deg=10.0, drive="effort")
    hold = rig.drive([0.0] * 4, 1.0)[-1].joint_effort[:4]
    assert min(hold) > 0.2
    rig.advance_effort(hold, 100)
    # the torque of the integral part that holds the robot is forgotten
    assert max(map(abs, rig.advance([0.0] * 4, 1).joint_effort[:4])) < 0.1


def test_real_motors_begin_at_the_wheels_speed_after_commands_of_torque(nexus):
    rig = Rig(msgspec.structs.replace(nexus, motors=RealMotors(time_constant_s=0.2)))
    for _ in range(50):
        rig.advance([10.0] * 4)
    braked = rig.advance_effort([-0.3] * 4, 300).joint_velocity[0]
    assert braked < 6.0
    after = rig.advance([0.0] * 4, 10).joint_velocity[0]
    assert after == pytest.approx(braked * math.exp(-0.01 / 0.2), abs=0.05)


def test_a_pid_follows_the_motors_lag():
    states = drive(
        RealMotors(time_constant_s=0.2), WheelCommand(FAST), 0.4, drive="effort", dt_s=0.001
    )
    assert states[19].joint_velocity[0] < 8.0


def test_the_supply_sags_while_the_robot_accelerates():
    slow = drive(RealMotors(time_constant_s=0.2, sag_per_nm=0.1), WheelCommand(FAST), 0.3)
    firm = drive(RealMotors(time_constant_s=0.2), WheelCommand(FAST), 0.3)
    assert slow[15].joint_velocity[0] < firm[15].joint_velocity[0]
