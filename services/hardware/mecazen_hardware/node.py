"""The nodes of a real robot: they publish the board's state and send wheel commands to it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, ClassVar

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
from mecazen.wheels import Watchdog, WheelCommand, WheelSpeeds, wheel_command

from mecazen_hardware.driver import Driver

UNKNOWN = (-1.0, *(0.0,) * 8)
"""ROS's covariance of a quantity that is not measured."""


class _Shared:
    """The driver that the open nodes of a process share."""

    driver: ClassVar[Driver | None] = None

    @classmethod
    def open(cls, scenario: Scenario) -> Driver:
        if cls.driver is None:
            cls.driver = Driver(scenario)
        return cls.driver

    @classmethod
    def close(cls) -> None:
        if cls.driver is not None:
            cls.driver.close()
        cls.driver = None


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
        """Begin a run at rest: open the port, or use the open port."""
        del seed
        self.driver = _Shared.open(self.scenario)
        self.driver.begin()

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the state of the robot at a tick."""
        del inputs
        angles, speeds = self.driver.measure(tick.period_s if tick.number else 0.0)
        header = Header(stamp=tick.time, frame_id="base_link")
        joints = JointState(
            header, self.scenario.robot.wheels.joints, position=angles, velocity=tuple(speeds)
        )
        outputs: dict[Topic[Any], Message] = {JOINT_STATES: joints}
        if (inertial := self.driver.inertial()) is not None:
            outputs[IMU] = Imu(
                header=header,
                orientation_covariance=UNKNOWN,
                angular_velocity=Vector3(*inertial.angular),
                linear_acceleration=Vector3(*inertial.force),
            )
        if (voltage := self.driver.voltage()) is not None:
            outputs[BATTERY_STATE] = BatteryState(
                header=header, voltage=_float32(voltage.volts), present=True
            )
        return outputs

    def answer(self, call: Call[Any, Any], request: Message) -> String:
        """Return the robot's URDF."""
        return String(data=self._urdf)

    def files(self) -> Mapping[str, Mapping[str, bytes]]:
        """Return the meshes that the URDF names."""
        return {ROBOT_DESCRIPTION.key: build_meshes(self.scenario.robot)}

    def diagnostics(self) -> Mapping[str, object]:
        """Return the state of the link and of the board."""
        return self.driver.diagnostics()

    def close(self) -> None:
        """Stop the motors, and close the port."""
        _Shared.close()


class Motors(Node):
    """Sends the newest wheel command to the board, in each tick and when a new command comes."""

    def reset(self, seed: int) -> None:
        """Start with a new watchdog, without a command."""
        del seed
        self.driver = _Shared.open(self.scenario)
        self.watchdog = Watchdog(self.scenario)

    def configure(self, scenario: Scenario) -> None:
        """Brake within the changed limits from now on."""
        super().configure(scenario)
        self.watchdog.configure(scenario)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Send the wheel speeds of a tick, or stop."""
        if inputs.get(EMERGENCY_STOP) is not None:
            self.driver.engage(is_engaged=True)
        joints, command = inputs.get(JOINT_COMMAND), None
        if joints is not None:
            try:
                command = _speeds(joints, self.scenario.robot.wheels.joints)
            except RefusedError as refusal:
                inputs.refuse(JOINT_COMMAND, str(refusal))
        age_s = inputs.age_s(JOINT_COMMAND)
        wanted = self._obeyed(command, age_s)
        self.driver.drive(WheelSpeeds(*wanted.values), age_s)
        return {}

    def _obeyed(self, command: WheelCommand | None, age_s: float) -> WheelCommand:
        """Return the command for the motors: the newest, or a braking command if it is too old."""
        return self.watchdog.command(command, age_s, (0.0,) * 4)

    def answer(self, call: Call[Any, Any], request: Message) -> String:
        """Engage or release the emergency stop."""
        del request
        self.driver.engage(is_engaged=call is STOP_MOTORS)
        return String(data="stopped" if call is STOP_MOTORS else "released")

    def close(self) -> None:
        """Stop the motors, and close the port."""
        _Shared.close()


def _speeds(joints: JointState, names: tuple[str, ...]) -> WheelCommand:
    """Return the wheel speeds of a joint command.

    Raises:
        RefusedError: The command has torques, which the boards do not accept, or lacks a wheel.
    """
    command = wheel_command(joints, names)
    if command.is_effort:
        raise RefusedError("needs a velocity of each wheel: the board takes no torques")
    return command


def _float32(value: float) -> float:
    """Return the nearest number that ROS can store in 32 bits."""
    (rounded,) = struct.unpack("f", struct.pack("f", value))
    return float(rounded)
