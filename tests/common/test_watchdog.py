"""The wheels' watchdog: how long it obeys a command, and how it brakes then."""

import pytest
from harness import load_robot
from mecazen.config import ControllerConfig, PhysicsConfig, Scenario, SensorConfig
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.watchdog import Watchdog, WheelCommand

STILL = (0.0,) * 4
# the wheels of nexus, 0.05 m, move it at 0.5 m/s forward and 0.25 m/s to the left
DIAGONAL = WheelCommand((5.0, 15.0, 15.0, 5.0))


def watchdog(**changes):
    return Watchdog(Scenario(robot=load_robot(), **changes))


def test_a_command_is_obeyed_until_it_is_too_old():
    dog = watchdog(physics=PhysicsConfig(watchdog_s=0.1))
    assert dog.command(DIAGONAL, 0.0, STILL) is DIAGONAL
    assert dog.command(None, 0.1, STILL) is DIAGONAL
    assert dog.command(None, 0.11, STILL) != DIAGONAL


def test_behind_a_guard_it_is_obeyed_for_no_longer_than_the_guard_counts_on():
    dog = watchdog(sensor=SensorConfig(also=("lidar",)))
    assert dog.command(DIAGONAL, 0.05, STILL) is DIAGONAL
    assert dog.command(None, 0.06, STILL) != DIAGONAL


def test_each_axis_of_the_robot_brakes_as_the_controller_brakes_it():
    limits = AxisLimits(LinearLimits(2.0, 2.5), LinearLimits(2.0, 5.0), AngularLimits())
    dog = watchdog(controller=ControllerConfig(limits=limits))
    dog.command(DIAGONAL, 0.0, STILL)
    for n in range(1, 21):
        command = dog.command(None, 1.0 + 0.01 * n, STILL)
        forward, left = max(0.5 - 0.025 * n, 0.0), max(0.25 - 0.05 * n, 0.0)
        expected = [(forward - left) / 0.05, (forward + left) / 0.05]
        assert command.values[:2] == pytest.approx(expected, abs=1e-9)


def test_after_an_effort_it_brakes_from_the_measured_speeds():
    dog = watchdog()
    dog.command(WheelCommand((0.3,) * 4, is_effort=True), 0.0, STILL)
    braking = dog.command(None, 1.0, (8.0,) * 4)
    # 2.5 m/s² are 0.5 rad/s in a tick
    assert (braking.values, braking.is_effort) == (pytest.approx([7.5] * 4), False)


def test_a_new_command_ends_the_braking():
    dog = watchdog()
    dog.command(DIAGONAL, 0.0, STILL)
    dog.command(None, 1.0, STILL)
    assert dog.command(DIAGONAL, 0.0, STILL) is DIAGONAL
    assert dog.command(None, 0.4, STILL) is DIAGONAL


def test_before_the_first_command_the_wheels_stand():
    assert watchdog().command(None, float("inf"), STILL).values == STILL
