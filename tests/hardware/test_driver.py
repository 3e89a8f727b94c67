"""The driver that the nodes of a robot share."""

import time

import pytest
from hardware.stand import ROBOT, config, emulated, until
from mecazen.config import Scenario
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.driver import Driver


@pytest.fixture
def driven():
    """An emulated board and its driver."""
    with emulated() as emulator:
        whole = Scenario(robot=ROBOT, services=("hardware",), hardware=config(emulator))
        driver = Driver(whole)
        yield emulator, driver
        driver.close()


def turn(driver, duration_s, speed):
    for _ in range(round(duration_s / 0.01)):
        driver.measure(0.01)
        driver.drive(WheelSpeeds(*[speed] * 4), 0.0)
        time.sleep(0.01)


def test_speeds_are_sent_and_angles_come_back(driven):
    emulator, driver = driven
    turn(driver, 1.0, 10.0)
    assert emulator.firmware.goal == pytest.approx([325.0] * 4, abs=1.0)
    angles, _ = driver.measure(0.01)
    assert min(angles) > 2.0
    assert driver.diagnostics()["frames_unsent"] == 0
    assert driver.voltage().volts == pytest.approx(12.0)
    assert driver.voltage() is None  # each report is given once


def test_a_command_that_is_not_finite_stops_the_motors_and_is_counted(driven):
    emulator, driver = driven
    turn(driver, 0.3, 10.0)
    driver.drive(WheelSpeeds(float("nan"), 0.0, 0.0, 0.0), 0.0)
    until(lambda: not any(emulator.firmware.goal))
    assert driver.refused_commands == 1


def test_a_new_run_begins_at_rest_with_angles_from_0(driven):
    emulator, driver = driven
    turn(driver, 0.5, 10.0)
    driver.begin()
    until(lambda: not any(emulator.firmware.goal))
    assert driver.wheels.angles == (0.0,) * 4
