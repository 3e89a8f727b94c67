"""Messages, requests and responses that only ROS sees: none is on a key of mecazen's own."""

from __future__ import annotations

from typing import ClassVar

from mecazen.messages import Count, Header, Message, Quaternion, Twist, UInt8, Vector3


class TwistStamped(Message):
    """A velocity, when it was meant, and in which frame."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/TwistStamped"
    header: Header = Header()
    twist: Twist = Twist()


class Transform(Message):
    """A pose as translation [m] and rotation."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/Transform"
    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


class TransformStamped(Message):
    """Where child_frame_id is in header.frame_id."""

    ROS_TYPE: ClassVar[str] = "geometry_msgs/msg/TransformStamped"
    header: Header = Header()
    child_frame_id: str = ""
    transform: Transform = Transform()


class TFMessage(Message):
    """Some edges of the tree of frames."""

    ROS_TYPE: ClassVar[str] = "tf2_msgs/msg/TFMessage"
    transforms: tuple[TransformStamped, ...] = ()


class TriggerRequest(Message):
    """Asks for the one thing that a service does."""

    ROS_TYPE: ClassVar[str] = "std_srvs/srv/Trigger_Request"


class TriggerResponse(Message):
    """Whether it was done, and if not why."""

    ROS_TYPE: ClassVar[str] = "std_srvs/srv/Trigger_Response"
    success: bool = False
    message: str = ""


class Result(Message):
    """How a call of simulation_interfaces went."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/msg/Result"
    result: UInt8 = 0
    """0 is not supported, 1 ok, 2 not found, 3 in a wrong state, 4 failed."""
    error_message: str = ""


class SimulationState(Message):
    """What a simulation does: 0 stopped, 1 playing, 2 paused, 3 quitting."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/msg/SimulationState"
    state: UInt8 = 0


class ResetSimulationRequest(Message):
    """What to reset: 0 or 255 everything; 1 time, 2 state, 4 spawned entities alone."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/ResetSimulation_Request"
    scope: UInt8 = 0


class ResultResponse(Message):
    """How it went; the response of several services, which are told apart by their keys."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/ResetSimulation_Response"
    result: Result = Result()


class StepSimulationRequest(Message):
    """How many ticks to simulate while paused."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/StepSimulation_Request"
    steps: Count = 1


class SetSimulationStateRequest(Message):
    """What the simulation is to do."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/SetSimulationState_Request"
    state: SimulationState = SimulationState()


class GetSimulationStateRequest(Message):
    """Asks what the simulation does."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/GetSimulationState_Request"


class GetSimulationStateResponse(Message):
    """What it does."""

    ROS_TYPE: ClassVar[str] = "simulation_interfaces/srv/GetSimulationState_Response"
    state: SimulationState = SimulationState()
    result: Result = Result()
