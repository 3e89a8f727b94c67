"""Messages of rcl_interfaces: the parameters of a ROS node.

Requests and responses with the same fields are one struct: services are told apart by their keys.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec

from mecazen.messages import Count, Message, UInt8


class ParameterValue(Message):
    """A value of one of nine types."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/ParameterValue"
    type: UInt8 = 0
    """Which of the following fields has it, counted from 1; 0: it is not set."""
    bool_value: bool = False
    integer_value: int = 0
    double_value: float = 0.0
    string_value: str = ""
    byte_array_value: Annotated[bytes, msgspec.Meta(extra={"ros": "byte"})] = b""
    bool_array_value: tuple[bool, ...] = ()
    integer_array_value: tuple[int, ...] = ()
    double_array_value: tuple[float, ...] = ()
    string_array_value: tuple[str, ...] = ()


class Parameter(Message):
    """A parameter by its name in the node."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/Parameter"
    name: str = ""
    value: ParameterValue = ParameterValue()


class FloatingPointRange(Message):
    """What a number may be; in steps, unless `step` is 0."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/FloatingPointRange"
    from_value: float = 0.0
    to_value: float = 0.0
    step: float = 0.0


class IntegerRange(Message):
    """What a whole number may be; in steps, unless `step` is 0."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/IntegerRange"
    from_value: int = 0
    to_value: int = 0
    step: Count = 0


class ParameterDescriptor(Message):
    """What a parameter is, and what it may be."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/ParameterDescriptor"
    name: str = ""
    type: UInt8 = 0
    description: str = ""
    additional_constraints: str = ""
    read_only: bool = False
    dynamic_typing: bool = False
    floating_point_range: Annotated[tuple[FloatingPointRange, ...], msgspec.Meta(max_length=1)] = ()
    integer_range: Annotated[tuple[IntegerRange, ...], msgspec.Meta(max_length=1)] = ()


class SetParametersResult(Message):
    """Whether parameters were set, and if not why."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/SetParametersResult"
    successful: bool = False
    reason: str = ""


class ListParametersResult(Message):
    """Names of parameters, and what those with a dot have before their last one."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/msg/ListParametersResult"
    names: tuple[str, ...] = ()
    prefixes: tuple[str, ...] = ()


class ListParametersRequest(Message):
    """Which parameters: below which prefixes, and how deep; 0 is all."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/ListParameters_Request"
    prefixes: tuple[str, ...] = ()
    depth: Count = 0


class ListParametersResponse(Message):
    """Their names."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/ListParameters_Response"
    result: ListParametersResult = ListParametersResult()


class NamesRequest(Message):
    """Of which parameters the values, types or descriptors are asked."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/GetParameters_Request"
    names: tuple[str, ...] = ()


class GetParametersResponse(Message):
    """Their values, in the same order."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/GetParameters_Response"
    values: tuple[ParameterValue, ...] = ()


class GetParameterTypesResponse(Message):
    """Their types, as in `ParameterValue`."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/GetParameterTypes_Response"
    types: bytes = b""


class DescribeParametersResponse(Message):
    """Their descriptors."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/DescribeParameters_Response"
    descriptors: tuple[ParameterDescriptor, ...] = ()


class SetParametersRequest(Message):
    """New values: each by itself, or all or none."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/SetParameters_Request"
    parameters: tuple[Parameter, ...] = ()


class SetParametersResponse(Message):
    """How each went."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/SetParameters_Response"
    results: tuple[SetParametersResult, ...] = ()


class SetParametersAtomicallyResponse(Message):
    """How all went."""

    ROS_TYPE: ClassVar[str] = "rcl_interfaces/srv/SetParametersAtomically_Response"
    result: SetParametersResult = SetParametersResult()
