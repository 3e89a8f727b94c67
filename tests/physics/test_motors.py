"""Wheels under torque: what they accelerate and hold, their limits, and real motors."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from harness import load_robot
from mecazen.geometry import Pose2D, Twist2D
from mecazen.links import robot_links
from mecazen.robot import RealMotors, Robot
from mecazen.rollers import Roller, lateral_gain
from mecazen.wheels import MecanumKinematics, WheelCommand, WheelSpeeds
from mecazen_physics.motors import MotorModel
from mecazen_physics.world import GRAVITY
from physics_rig import Rig, masses, wheel_speeds

FORWARD, LEFT = Twist2D(x=0.3), Twist2D(y=0.3)


def test_a_coasting_robot_only_loses_energy_and_little(nexus):
    rig = Rig(nexus)
    rig.drive(wheel_speeds(nexus, FORWARD), 1.0)
    energies = []
    for _ in range(100):
        rig.advance_effort([0.0] * 4)
        energies.append(rig.body.skeleton.computeKineticEnergy())
    # Ripple of 0.02 mm stores m·g·20 µm = 3 mJ of some 0.7 J for a while.
    assert (np.diff(energies) < 0.005 * energies[0]).all()
    # Chords and hand-overs take 0.3 N from a robot of 130 N, less than rubber on a floor.
    assert 0.8 * energies[0] < energies[-1] < energies[0]


@pytest.mark.parametrize(("name", "drive"), [("nexus", "velocity"), ("artbul", "effort")])
def test_wheels_hold_the_robot_on_a_slope(name, drive):
    robot = load_robot(name)
    rig = Rig(robot, slope_deg=10.0, drive=drive)
    state = rig.drive([0.0] * 4, 2.0)[-1]
    weight = masses(robot)[0] * GRAVITY * math.sin(math.radians(10.0))
    # 3 %: the PID's integral part is still settling, and the robot creeps as it does.
    assert sum(state.joint_effort[:4]) == pytest.approx(weight * robot.wheels.radius_m, rel=0.03)
    assert abs(state.position[0]) < 0.01


def test_bearing_friction_costs_the_predicted_power(nexus):
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
    spin = LEFT.y * lateral_gain(roller.count) / math.sin(roller.angle) / radius
    handovers = roller.count * wheel_speeds(nexus, LEFT)[1] / (2.0 * math.pi)
    # A roller stops before it meets the ground again: half of what spins it up goes into skid.
    spin_up = roller.inertia[1] * np.mean(spin**2) * handovers
    expected = 4 * (friction * np.mean(spin**2) + spin_up)
    # 10 %: of it 7 % by the step's length; and the mean gain stands for all angles.
    assert power(friction) - power(0.0) == pytest.approx(expected, rel=0.1)


def test_commands_are_limited_to_torque_and_speed(nexus):
    rig = Rig(nexus, ground_friction=0.0)
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 1)
    limit, fastest = nexus.wheels.max_torque_nm, nexus.wheels.max_speed_rad_s
    assert rig.state().joint_effort[:4] == [limit, -limit, 0.0, 0.0]
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 200)
    speeds = rig.state().joint_velocity
    step = limit / robot_links(nexus)[0].moments[1] * 1e-3  # at most one step's gain beyond
    assert fastest <= speeds[0] <= fastest + step
    assert -fastest - step <= speeds[1] <= -fastest
    speeds = rig.advance([1e3, -1e3, 1e3, -1e3], 300).joint_velocity[:4]
    assert speeds == pytest.approx([fastest, -fastest, fastest, -fastest], rel=1e-6)


def test_dead_band_gain_and_supply_scale_the_command():
    model = MotorModel(RealMotors(dead_band_rad_s=0.5, gains=(1.1, 1.0, 1.0, 1.0)), 0.005)
    for command, supplied, output in ((0.4, 1.0, 0.0), (2.5, 1.0, 2.2), (-2.5, 0.9, -1.98)):
        model.give((command,) * 4)
        assert model.step(supplied)[0] == pytest.approx(output)


# ---- in the simulation


def with_motors(robot: Robot, **motors: float) -> Robot:
    return msgspec.structs.replace(robot, motors=RealMotors(**motors))


def speed_ups(robot: Robot, seconds: float, **physics: Any) -> list[float]:
    """Return the speeds of a wheel after each 10 ms of a command of 10 rad/s."""
    rig = Rig(robot, **physics)
    return [rig.advance([10.0] * 4).joint_velocity[0] for _ in range(round(seconds / 0.01))]


def test_wrong_mounting_turns_x_into_o(nexus):
    """The odometry reports what was commanded: only the true motion shows the fault."""
    x_as_o = msgspec.structs.replace(nexus.wheels, mounting=(2, 1, 4, 3))
    robot, kinematics = (
        msgspec.structs.replace(nexus, wheels=x_as_o),
        MecanumKinematics.from_robot(nexus),
    )
    rig = Rig(robot)
    states = rig.drive(kinematics.inverse(Twist2D(0.0, 0.3)), 2.0)
    assert kinematics.forward(WheelSpeeds(*states[-1].joint_velocity[:4])).y > 0.29
    assert states[-1].position[1] < -0.4
    turn = Rig(robot).drive(kinematics.inverse(Twist2D(0.0, 0.0, 1.0)), 2.0)
    # its lever is 0 but for the rollers' contacts beside the wheels' middles: it slips
    assert turn[-1].yaw < 0.5
    # with the two front wheels swapped, two wheels work against the others in each direction
    front = msgspec.structs.replace(nexus.wheels, mounting=(2, 1, 3, 4))
    rig = Rig(msgspec.structs.replace(nexus, wheels=front))
    assert rig.drive(kinematics.inverse(Twist2D(0.0, 0.3)), 2.0)[-1].position[1] < 0.2


def test_the_wheels_move_alike_wherever_base_link_is(nexus):
    x, y = 0.12, -0.04

    def moved(place):
        return (place[0] + x, place[1] + y, place[2])

    parts = {name: getattr(nexus, name) for name in ("camera", "lidar")}
    parts = {
        n: msgspec.structs.replace(p, position_m=moved(p.position_m)) for n, p in parts.items()
    }
    wheels = msgspec.structs.replace(nexus.wheels, centre_m=(x, y))
    robot = msgspec.structs.replace(nexus, wheels=wheels, **parts)
    start = Pose2D(0.3, -0.1, 0.5)
    rigs = Rig(nexus, start.compose(Pose2D(x, y))), Rig(robot, start)
    twist = Twist2D(0.3, 0.2, 0.8)
    speeds = MecanumKinematics.from_robot(robot).inverse(twist)
    (*_, at_centre), (*_, beside) = (rig.drive(speeds, 2.0) for rig in rigs)
    pose = Pose2D(*beside.position[:2], beside.yaw).compose(Pose2D(x, y))
    # two trees of joints: floating point differs, and rollers meet the ground a step apart
    assert pose == pytest.approx(Pose2D(*at_centre.position[:2], at_centre.yaw), abs=1e-4)
    assert MecanumKinematics.from_robot(robot).forward(
        WheelSpeeds(*beside.joint_velocity[:4])
    ) == pytest.approx(twist, abs=1e-3)


def test_delay_within_a_step_shifts_the_exponential(nexus):
    delay_s = 0.0304  # steps take 1 ms
    speeds = speed_ups(with_motors(nexus, delay_s=delay_s, time_constant_s=0.1), 0.3)
    after = [max(0.01 * (tick + 1) - delay_s, 0.0) for tick in range(30)]
    expected = [10.0 * (1.0 - math.exp(-time_s / 0.1)) for time_s in after]
    assert speeds == pytest.approx(expected, abs=1e-6)  # DART's servo holds them


def test_pid_follows_the_lag_and_supply_sags(nexus):
    lag = {"time_constant_s": 0.2}
    firm = speed_ups(with_motors(nexus, **lag), 0.2)
    assert speed_ups(with_motors(nexus, **lag), 0.2, drive="effort")[-1] == pytest.approx(
        firm[-1], rel=0.05
    )  # behind by what the integral part has not made up yet
    assert speed_ups(with_motors(nexus, sag_per_nm=0.1, **lag), 0.2)[15] < firm[15]


@pytest.mark.parametrize(("is_effort", "value"), [(False, 20.0), (True, 100.0)])
def test_torque_minus_friction_turns_the_wheel(nexus, is_effort, value):
    rig = Rig(with_motors(nexus, coulomb_nm=0.05, viscous_nms=0.01), ground_friction=0.0)
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
