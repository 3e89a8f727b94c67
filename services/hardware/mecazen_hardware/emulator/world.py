"""The world of an emulated board: mecazen's physics, with a motor model from voltage to torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mecazen.config import Scenario
from mecazen.graph import GRAPH
from mecazen.keys import GROUND_TRUTH, IMU, JOINT_COMMAND, JOINT_STATES, Topic
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Header, Imu, JointState, Message, Odometry
from mecazen.wire import Stamp
from mecazen_tools.simulation import Simulation
from mecazen_tools.trajectory import Scores
from msgspec.structs import replace

from mecazen_hardware.emulator.firmware import Instruments

TICK_MS = 5
ROBOT = "rosmaster_x3"
ORDER = (0, 2, 1, 3)
"""The wheels of the motors m1 to m4, as indices in mecazen's order; the permutation is its own
inverse."""
SENSED = ("target", "sensors", "crowd")
"""Services of a scenario outside the robot's stack: persons, and drivers of sensors."""
HIDDEN = {JOINT_STATES, IMU}
"""Outputs that the host receives only from the board."""
ENDLESS_S = 1e6

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
    """Return torque at the wheel [N·m] and current [A] of a motor.

    Args:
        volts: Mean voltage at the motor's terminals; None if they are open.
        speed: Speed of the wheel [rad/s].
    """
    current = 0.0 if volts is None else (volts - BACK_EMF_V_S * speed) / RESISTANCE_OHM
    per_volt = TORQUE_NM_A / RESISTANCE_OHM
    torque, running = TORQUE_NM_A * current, RUNNING_V * per_volt
    if abs(speed) >= STILL_RAD_S:
        return torque - math.copysign(running, speed), current
    if abs(torque) > BREAK_AWAY_V * per_volt:
        return torque - math.copysign(running, torque), current
    return -running * speed / STILL_RAD_S, current


def load(path: Path, overrides: Sequence[str], tick_ms: int = TICK_MS) -> Scenario:
    """Return the world around the emulated board: a scenario without the services of a robot.

    Raises:
        ConfigError: One line with the file, the key and what is allowed.
    """
    scenario = load_scenario(
        path,
        {
            "robot": ROBOT,
            "sensor.frame": "base_link",
            **parse_settings(overrides),
            "sim.tick_s": tick_ms / 1000,
            "sim.duration_s": ENDLESS_S,
            "physics.dt_s": tick_ms / 1000,
            "physics.motors": "ideal",  # this module models the board's motors
        },
    )
    also = (*scenario.sensor.also, *({"imu"} - {*scenario.sensor.also}))
    return replace(
        scenario,
        services=("physics", *(name for name in scenario.services if name in SENSED)),
        sensor=replace(scenario.sensor, also=also),
    )


class EmulatedWorld:
    """Robot, persons and sensors around a board; the world rests until `begin`.

    Args:
        scenario: The return value of `load`.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.sim = Simulation(scenario)
        self.battery_v = scenario.sensors.battery.voltage_v
        """Voltage without load [V]."""
        self.has_begun = False
        self.news: dict[Topic[Any], Message] = {}
        """Newest unpublished messages of sensors and persons."""
        self._current = 0.0
        self._angles: Sequence[float] = (0.0,) * 4
        self._speeds: Sequence[float] = (0.0,) * 4
        self._imu = Imu()
        self._attitude = (0.0,) * 3
        self._command = self.sim.bus.publisher(JOINT_COMMAND)
        bus = self.sim.bus
        bus.subscribe(JOINT_STATES, self._on_joints)
        bus.subscribe(GROUND_TRUTH, self._on_truth)
        bus.subscribe(IMU, self._on_imu)
        for row in GRAPH:
            if row.part_of in ("physics", *SENSED) and not row.owns_time:
                for topic in (topic for topic in row.outputs if topic not in HIDDEN):
                    bus.subscribe(topic, self._noting(topic))
        self.time_ns = 0

    def begin(self) -> None:
        """Start the time: persons start to walk as the scenario specifies."""
        self.has_begun = True
        self.sim.reset()

    def step(self, duty: Sequence[float | None]) -> None:
        """Advance by a tick with a share of the battery's voltage at each motor, m1 to m4."""
        volts = self.volts
        efforts, current = [0.0] * 4, 0.0
        for motor, wheel in enumerate(ORDER):
            share = duty[motor]
            applied = None if share is None else share * volts
            efforts[wheel], drawn = motor_torque(applied, self._speeds[wheel])
            current += max(drawn * (share or 0.0), 0.0)
        self._current = current
        message = JointState(Header(), self.scenario.robot.wheels.joints, effort=tuple(efforts))
        self._command.put(message, None)
        self.sim.step()
        self.time_ns = self.sim.clock.stamp.time_ns

    @property
    def volts(self) -> float:
        """Voltage of the battery under load [V]."""
        return self.battery_v - SUPPLY_OHM * self._current

    def sense(self) -> Instruments:
        """Return what the board senses now."""
        a, b, c, d = (self._angles[wheel] for wheel in ORDER)
        turn, force = self._imu.angular_velocity, self._imu.linear_acceleration
        return Instruments(
            (a, b, c, d),
            self.volts,
            (turn.x, turn.y, turn.z),
            (force.x, force.y, force.z),
            self._attitude,
        )

    def scores(self) -> Scores:
        """Return the scores of following so far, from the ground truth."""
        return self.sim.scores()

    def close(self) -> None:
        """Close the services."""
        self.sim.close()

    def _noting(self, topic: Topic[Any]) -> Any:
        def note(message: Message, stamp: Stamp | None) -> None:
            del stamp
            self.news[topic] = message

        return note

    def _on_joints(self, joints: JointState, stamp: Stamp | None) -> None:
        del stamp
        self._angles, self._speeds = joints.position[:4], joints.velocity[:4]

    def _on_truth(self, odometry: Odometry, stamp: Stamp | None) -> None:
        del stamp
        q = odometry.pose.pose.orientation
        self._attitude = _roll_pitch_yaw(q.x, q.y, q.z, q.w)

    def _on_imu(self, imu: Imu, stamp: Stamp | None) -> None:
        del stamp
        self._imu = imu


def _roll_pitch_yaw(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(2 * (w * y - z * x), 1.0)))
    return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
