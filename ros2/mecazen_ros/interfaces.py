"""Messages and services that only ROS sees: mecazen's own keys carry none of them."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, NamedTuple

import msgspec
from mecazen import messages
from mecazen.messages import Message

_TEXT = """
geometry_msgs/msg/TwistStamped: Header header, Twist twist
geometry_msgs/msg/Transform: Vector3 translation, Quaternion rotation
geometry_msgs/msg/TransformStamped: Header header, string child_frame_id, Transform transform
tf2_msgs/msg/TFMessage: TransformStamped[] transforms
simulation_interfaces/msg/Result: uint8 result, string error_message
simulation_interfaces/msg/SimulationState: uint8 state
rcl_interfaces/msg/ParameterValue: uint8 type, bool bool_value, int64 integer_value, \
float64 double_value, string string_value, byte[] byte_array_value, bool[] bool_array_value, \
int64[] integer_array_value, float64[] double_array_value, string[] string_array_value
rcl_interfaces/msg/Parameter: string name, ParameterValue value
rcl_interfaces/msg/FloatingPointRange: float64 from_value, float64 to_value, float64 step
rcl_interfaces/msg/IntegerRange: int64 from_value, int64 to_value, uint64 step
rcl_interfaces/msg/ParameterDescriptor: string name, uint8 type, string description, \
string additional_constraints, bool read_only, bool dynamic_typing, \
FloatingPointRange[<=1] floating_point_range, IntegerRange[<=1] integer_range
rcl_interfaces/msg/SetParametersResult: bool successful, string reason
rcl_interfaces/msg/ListParametersResult: string[] names, string[] prefixes
std_srvs/srv/Trigger: -> bool success, string message
simulation_interfaces/srv/ResetSimulation: uint8 scope -> Result result
simulation_interfaces/srv/StepSimulation: uint64 steps -> Result result
simulation_interfaces/srv/SetSimulationState: SimulationState state -> Result result
simulation_interfaces/srv/GetSimulationState: -> SimulationState state, Result result
rcl_interfaces/srv/ListParameters: string[] prefixes, uint64 depth -> ListParametersResult result
rcl_interfaces/srv/GetParameters: string[] names -> ParameterValue[] values
rcl_interfaces/srv/GetParameterTypes: string[] names -> uint8[] types
rcl_interfaces/srv/DescribeParameters: string[] names -> ParameterDescriptor[] descriptors
rcl_interfaces/srv/SetParameters: Parameter[] parameters -> SetParametersResult[] results
rcl_interfaces/srv/SetParametersAtomically: Parameter[] parameters -> SetParametersResult result
"""
"""Types and their fields; services with a request and a response."""
_DEFINED = dict(line.split(": ") for line in _TEXT.strip().split("\n"))
_FULL = {name.rpartition("/")[2]: name for name in _DEFINED}
_PLAIN: dict[str, tuple[Any, Any]] = {
    "bool": (bool, False),
    "uint8": (messages.UInt8, 0),
    "int64": (int, 0),
    "uint64": (messages.Count, 0),
    "float64": (float, 0.0),
    "string": (str, ""),
    "uint8[]": (bytes, b""),
    "byte[]": (Annotated[bytes, msgspec.Meta(extra={"ros": "byte"})], b""),
}
"""Annotation and default of ROS's types."""


class Interface(NamedTuple):
    """The messages of a service."""

    request: Any
    response: Any


@cache
def message(name: str) -> Any:
    """Return the struct of a message by its name without package, such as `TFMessage`."""
    return _struct(_FULL[name], _DEFINED[_FULL[name]])


@cache
def service(kind: str) -> Interface:
    """Return the structs of a service, such as `std_srvs/srv/Trigger`."""
    request, _, response = _DEFINED[kind].partition("->")
    return Interface(_struct(f"{kind}_Request", request), _struct(f"{kind}_Response", response))


def _struct(ros_type: str, text: str) -> Any:
    members = [part.split() for part in text.split(",") if part.strip()]
    return msgspec.defstruct(
        ros_type.rpartition("/")[2],
        [(name, *_field(base)) for base, name in members],
        bases=(Message,),
        namespace={"ROS_TYPE": ros_type, "__doc__": f"{ros_type}, as ROS defines it."},
        frozen=True,
    )


def _field(base: str) -> tuple[Any, Any]:
    """Return the annotation and the default of a type."""
    if base in _PLAIN:
        return _PLAIN[base]
    item, is_list, rest = base.partition("[")
    if is_list:
        kind: Any = tuple[_field(item)[0], ...]  # type: ignore[misc]  # a type that is made here
        most = int(rest[2:-1]) if rest.startswith("<=") else None
        return Annotated[kind, msgspec.Meta(max_length=most)], ()
    kind = message(item) if item in _FULL else getattr(messages, item)
    return kind, kind()
