"""The nodes of a real robot: they publish the board's state and send wheel commands to it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError, RefusedError
from mecazen.keys import (
    BATTERY_STATE,
    EMERGENCY_STOP,
    IMU,
    JOINT_COMMAND,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    STOP_MOTORS,
    Call,
    Topic,
)
from mecazen.messages import BatteryState, Header, Imu, JointState, Message, String, Vector3
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.urdf import build_meshes, build_urdf
from mecazen.wheels import Watchdog, WheelSpeeds, wheel_command

from mecazen_hardware.board import Inertial, Voltage
from mecazen_hardware.driver import Driver

UNKNOWN = (-1.0, *(0.0,) * 8)
"""ROS's covariance of a quantity that is not measured."""
_drivers: list[Driver] = []
"""The driver that the nodes of this process share, once it is open."""


def _open(scenario: Scenario) -> Driver:
    if not _drivers:
        _drivers.append(Driver(scenario))
    return _drivers[0]


def _close() -> None:
    while _drivers:
        _drivers.pop().close()


class HardwareNode(Node):
    """A real robot instead of physics; its time is the wall clock.

    Raises:
        ConfigError: The scenario does not run in real time.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if scenario.sim.mode == "lockstep":
            raise ConfigError("hardware: a real robot runs in real time: `mecazen up`")
        if scenario.sim.speed != 1.0:
            raise ConfigError(f"sim.speed = {scenario.sim.speed:g}: with hardware it must be 1")
        self._urdf = build_urdf(scenario.robot, scenario.controller.base_frame_id)

    def reset(self, seed: int) -> None:
        self.driver = _open(self.scenario)
        self.driver.begin()

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        angles, speeds = self.driver.measure(tick.period_s if tick.number else 0.0)
        header = Header(stamp=tick.time, frame_id="base_link")
        joints = JointState(
            header, self.scenario.robot.wheels.joints, position=angles, velocity=tuple(speeds)
        )
        outputs: dict[Topic[Any], Message] = {JOINT_STATES: joints}
        if (inertial := self.driver.take(Inertial)) is not None:
            outputs[IMU] = Imu(
                header=header,
                orientation_covariance=UNKNOWN,
                angular_velocity=Vector3(*inertial.angular),
                linear_acceleration=Vector3(*inertial.force),
            )
        if (voltage := self.driver.take(Voltage)) is not None:
            (volts,) = struct.unpack("f", struct.pack("f", voltage.volts))  # as ROS stores it
            outputs[BATTERY_STATE] = BatteryState(header=header, voltage=volts, present=True)
        return outputs

    def answer(self, call: Call[Any, Any], request: Message) -> String:
        return String(data=self._urdf)

    def files(self) -> Mapping[str, Mapping[str, bytes]]:
        return {ROBOT_DESCRIPTION.key: build_meshes(self.scenario.robot)}

    def diagnostics(self) -> Mapping[str, object]:
        return self.driver.diagnostics()

    def close(self) -> None:
        _close()


class MotorsNode(Node):
    """Sends the newest wheel command to the board, in each tick and when a new command comes."""

    def reset(self, seed: int) -> None:
        self.driver = _open(self.scenario)
        self.watchdog = Watchdog(self.scenario)

    def configure(self, scenario: Scenario) -> None:
        super().configure(scenario)
        self.watchdog.configure(scenario)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        if inputs.get(EMERGENCY_STOP) is not None:
            self.driver.engage(is_engaged=True)
        joints, command = inputs.get(JOINT_COMMAND), None
        if joints is not None:
            try:
                command = wheel_command(joints, self.scenario.robot.wheels.joints)
            except RefusedError as refusal:
                inputs.refuse(JOINT_COMMAND, str(refusal))
        if command is not None and command.is_effort:
            inputs.refuse(JOINT_COMMAND, "needs a velocity of each wheel: boards take no torques")
            command = None
        age_s = inputs.age_s(JOINT_COMMAND)
        obeyed = self.watchdog.command(command, age_s, (0.0,) * 4)
        self.driver.drive(WheelSpeeds(*obeyed.values), age_s)
        return {}

    def answer(self, call: Call[Any, Any], request: Message) -> String:
        self.driver.engage(is_engaged=call is STOP_MOTORS)
        return String(data="stopped" if call is STOP_MOTORS else "released")

    def close(self) -> None:
        _close()
