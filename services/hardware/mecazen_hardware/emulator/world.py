"""The world of an emulated board: mecazen's physics, with a motor model from voltage to torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from mecazen.config import Scenario
from mecazen.keys import GROUND_TRUTH, IMU, JOINT_COMMAND, JOINT_STATES
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Header, Imu, JointState, Odometry
from mecazen.node import Inputs, Node, Tick
from mecazen.programs import find

from mecazen_hardware.emulator.firmware import Instruments

TICK_MS = 5
ORDER = (0, 2, 1, 3)
"""The wheels of the motors m1 to m4, as indices in mecazen's order."""

RESISTANCE_OHM = 4.5
BACK_EMF_V_S = 0.34
TORQUE_NM_A = 0.157
"""Constants of the motor MD520Z30 at the output shaft of its gear."""
RUNNING_V = 3.3
"""Voltage that friction takes while a wheel turns [V]: an assumption. Below about 4 V the wheels of
a real robot stand still, even off the ground."""
BREAK_AWAY_V = 5.5
"""Voltage at which a wheel on the floor starts to turn [V]: from runs that did and did not
start."""
STILL_RAD_S = 1.0
"""Speed below which a wheel counts as still for friction."""
SUPPLY_OHM = 0.15
"""Resistance of battery and cables [Ω]: an assumption."""


def motor_torque(volts: float | None, speed: float) -> tuple[float, float]:
    """Return torque at the wheel [N·m] and current [A] of a motor, at a speed of the wheel [rad/s].

    `volts` is the mean voltage at the motor's terminals; None if they are open.
    """
    current = 0.0 if volts is None else (volts - BACK_EMF_V_S * speed) / RESISTANCE_OHM
    per_volt = TORQUE_NM_A / RESISTANCE_OHM
    torque, running = TORQUE_NM_A * current, RUNNING_V * per_volt
    if abs(speed) >= STILL_RAD_S:
        return torque - math.copysign(running, speed), current
    if abs(torque) > BREAK_AWAY_V * per_volt:
        return torque - math.copysign(running, torque), current
    return -running * speed / STILL_RAD_S, current


def load(path: Path, overrides: Sequence[str]) -> Scenario:
    """Load a scenario with the robot of the board."""
    settings = {
        "robot": "rosmaster_x3",
        **parse_settings(overrides),
        "sim.tick_s": TICK_MS / 1000,
        "physics.dt_s": TICK_MS / 1000,
        "physics.motors": "ideal",  # this module models the board's motors
        "sensor.also": ["imu"],
    }
    return load_scenario(path, settings)


class EmulatedWorld:
    """The robot of a scenario of `load` around a board, on level ground."""

    def __init__(self, scenario: Scenario) -> None:
        self._joints = scenario.robot.wheels.joints
        wiring = enumerate(scenario.robot.wheels.wiring)
        self._driven = {abs(n) - 1: (wheel, math.copysign(1.0, n)) for wheel, n in wiring}
        """The wheel that each output drives, and -1 if its poles are swapped."""
        self._battery_v = scenario.sensors.battery.voltage_v
        self._imu = Imu()
        self._ticks = 0
        physics = find("physics", {})
        assert issubclass(physics, Node)
        self._physics = physics(scenario)
        self._physics.reset(scenario.seed)
        self._advance((0.0,) * 4, 0.0)

    def step(self, duty: Sequence[float | None]) -> None:
        """Advance by a tick with a share of the battery's voltage at each motor, m1 to m4."""
        efforts, drawn = [0.0] * 4, 0.0
        for share, wheel in zip(duty, ORDER, strict=True):
            volts = None if share is None else share * self.measured.volts
            driven, sign = self._driven[wheel]
            efforts[wheel], current = motor_torque(volts, sign * self._speeds[driven])
            drawn += max(current * (share or 0.0), 0.0)
        self._advance(efforts, drawn)

    def _advance(self, efforts: Sequence[float], drawn: float) -> None:
        """Advance by a tick with torques at the wheels [N·m] and a current of the battery [A]."""
        tick = Tick(self._ticks, self._ticks * TICK_MS * 1_000_000, TICK_MS / 1000)
        self._ticks += 1
        command = JointState(Header(), self._joints, effort=tuple(efforts))
        outputs = self._physics.step(tick, Inputs({JOINT_COMMAND: command}))
        joints, truth = outputs[JOINT_STATES], outputs[GROUND_TRUTH]
        assert isinstance(joints, JointState)
        assert isinstance(truth, Odometry)
        if isinstance(imu := outputs.get(IMU), Imu):
            self._imu = imu
        self._speeds = joints.velocity[:4]
        a, b, c, d = (joints.position[wheel] for wheel in ORDER)
        turn, force = self._imu.angular_velocity, self._imu.linear_acceleration
        self.measured = Instruments(
            angles=(a, b, c, d),
            volts=self._battery_v - SUPPLY_OHM * drawn,
            gyro=(turn.x, turn.y, turn.z),
            accel=(force.x, force.y, force.z),
            attitude=(0.0, 0.0, truth.pose.pose.to_planar().yaw),
        )
