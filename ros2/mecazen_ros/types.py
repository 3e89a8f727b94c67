"""Messages as types of ROS 2: definitions and hashes.

ROS's own types are in rosbags' store for Jazzy. The types of other messages follow from their
annotations: an integer takes the fewest of 8, 16, 32 or 64 bits that hold its bounds, `bytes` are
`uint8[]`, and a tuple whose least and greatest lengths are equal is an array.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import msgspec.inspect as mi
import numpy as np
from mecazen import messages
from mecazen.errors import MecazenError
from mecazen.keys import TOPICS
from mecazen.messages import Message
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PACKAGE = "mecazen_msgs"
ZEROS = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
"""Defaults of types; 0 for others."""
FLOAT32_MAX = 3.4028234663852886e38
NO_FIELD = "structure_needs_at_least_one_member"
"""The field that ROS gives a type without fields."""
INTERFACES = """
service_msgs/msg/ServiceEventInfo: uint8 event_type, builtin_interfaces/Time stamp, \
uint8[16] client_gid, int64 sequence_number
std_srvs/srv/Trigger: -> bool success, string message
simulation_interfaces/msg/Result: uint8 result, string error_message
simulation_interfaces/msg/SimulationState: uint8 state
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
"""Types that rosbags lacks, and one with `char`, whose hash it gets wrong. Services have a request
and a response."""

Shape = tuple[int, Any]
"""A type in rosbags' form: its `Nodetype` and details."""
ITEMS = (Nodetype.ARRAY, Nodetype.SEQUENCE)
BYTE: Shape = (Nodetype.BASE, ("uint8", 0))


class RosTypeError(MecazenError):
    """A message with a field that ROS has no type for, or with another's name."""


def _maker(fields: Iterable[tuple[str, Shape]]) -> Callable[..., dict[str, Any]]:
    """Return the function that rosbags calls with the fields of a message: as in JSON, by name."""
    convert: dict[str, Any] = {
        name: np.ndarray.tobytes if _is_bytes(shape) else np.ndarray.tolist
        for name, shape in fields
    }
    return lambda *values: {
        name: convert[name](value) if isinstance(value, np.ndarray) else value
        for name, value in zip(convert, values, strict=True)
        if name != NO_FIELD
    }


def _is_bytes(shape: Shape) -> bool:
    return shape[0] in ITEMS and shape[1][0][1][0] in ("uint8", "byte")


def _register(name: str, fields: Iterable[tuple[str, Shape]]) -> None:
    members = list(fields) or [(NO_FIELD, BYTE)]
    STORE.fielddefs[name] = [], members
    STORE.types[name] = _maker(members)


def _register_interface(line: str) -> None:
    """Register a line of `INTERFACES`: a message, or the request and the response of a service."""
    name, text = line.split(": ", 1)
    parts = text.split("->")
    for part, end in zip(parts, ("_Request", "_Response") if parts[1:] else ("",), strict=True):
        text = part.strip().replace(", ", "\n")
        # parsed as a message, beside which rosbags looks for the types of the fields
        ((_, fields),) = get_types_from_msg(text, name.replace("/srv/", "/msg/")).values()
        _register(name + end, fields)


STORE: Any = get_typestore(Stores.ROS2_JAZZY)
"""rosbags' store of types: those of Jazzy, and those that were asked for so far."""
STORE.types = {name: _maker(fields) for name, (_, fields) in STORE.fielddefs.items()}
for interface in INTERFACES.strip().split("\n"):
    _register_interface(interface)


@cache
def message(name: str) -> Any:
    """Return the struct of a message by its type: one of mecazen, or one that only ROS sees."""
    short = name.rpartition("/")[2]
    known = getattr(messages, short, None)
    if known is not None and name == known.ROS_TYPE:
        return known
    shapes = dict(STORE.fielddefs[name][1])
    fields = [(field, *_annotation(shapes[field])) for field in shapes if field != NO_FIELD]
    namespace = {"ROS_TYPE": name, "__doc__": f"{name}, as ROS defines it."}
    return msgspec.defstruct(short, fields, bases=(Message,), namespace=namespace, frozen=True)


def _annotation(shape: Shape) -> tuple[Any, Any]:
    node, detail = shape
    if node == Nodetype.NAME:
        return message(detail), message(detail)()
    if node == Nodetype.BASE:
        zero = ZEROS.get(detail[0], 0)
        return type(zero), zero
    if _is_bytes(shape):
        return bytes, b""
    return tuple[_annotation(detail[0])[0], ...], ()  # type: ignore[misc]  # a type made here


@cache
def registered(kind: type[Message]) -> str:
    """Return the name of a message's type, after registering it unless it is ROS's own."""
    name = kind.ROS_TYPE
    if name not in STORE.fielddefs:
        info = mi.type_info(kind)
        assert isinstance(info, mi.StructType)
        fields = []
        for field in info.fields:
            try:
                fields.append((field.name, _shape(field.type)))
            except KeyError as error:
                reason = f"ROS has no type for {error.args[0]}"
                raise RosTypeError(f"{name}: {field.name}: {reason}") from None
        _register(name, fields)
    names = [field for field, _ in STORE.fielddefs[name][1] if field != NO_FIELD]
    if names != [*kind.__struct_fields__]:
        raise RosTypeError(f"{name}: another message of this name has other fields")
    return name


def _shape(node: mi.Type) -> Shape:
    """Return the type of an annotation; a KeyError names a type that ROS lacks."""
    node = node.type if isinstance(node, mi.Metadata) else node
    if isinstance(node, mi.StructType) and issubclass(node.cls, Message):
        return Nodetype.NAME, registered(node.cls)
    if not isinstance(node, mi.VarTupleType | mi.BytesType):
        limit = (node.max_length or 0) if isinstance(node, mi.StrType) else 0
        return Nodetype.BASE, (_base(node), limit)
    item = BYTE
    if isinstance(node, mi.VarTupleType):
        item = _shape(node.item_type)
        if item[0] in ITEMS:
            raise KeyError("a sequence of sequences")
        if item == BYTE:
            raise KeyError("a tuple of 8 bits without sign; bytes are allowed")
    is_array = node.max_length is not None and node.min_length == node.max_length
    return Nodetype.ARRAY if is_array else Nodetype.SEQUENCE, (item, node.max_length or 0)


def _base(node: mi.Type) -> str:
    if isinstance(node, mi.IntType):
        low = node.ge if node.ge is not None else -np.inf if node.gt is None else node.gt + 1
        high = node.le if node.le is not None else np.inf if node.lt is None else node.lt - 1
        for bits in (8, 16, 32, 64):
            for sign, least in (("u", 0), ("", -(2 ** (bits - 1)))):
                if low >= least and high < least + 2**bits:
                    return f"{sign}int{bits}"
        return "uint64" if low >= 0 else "int64"
    if isinstance(node, mi.FloatType):
        return "float32" if node.le == FLOAT32_MAX else "float64"
    if isinstance(node, mi.BoolType | mi.StrType):
        return "bool" if isinstance(node, mi.BoolType) else "string"
    raise KeyError(type(node).__name__.removesuffix("Type").lower())


def definition(kind: type[Message]) -> str:
    """Return a message's definition with those it depends on, as MCAP's `ros2msg`."""
    return str(STORE.generate_msgdef(registered(kind), ros_version=2)[0])


@cache
def type_hash(name: str) -> str:
    """Return the hash of a type, as from ROS 2 Iron on: `RIHS01_…` (REP-2016).

    That of a service is that of a message with its request, its response and the event for
    introspection.
    """
    if "/srv/" in name:
        request, response, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
        parts = (Nodetype.NAME, request), (Nodetype.NAME, response)
        info = Nodetype.NAME, "service_msgs/msg/ServiceEventInfo"
        most_one = [(Nodetype.SEQUENCE, (part, 1)) for part in parts]
        _register(event, zip(("info", "request", "response"), (info, *most_one), strict=True))
        names = ("request_message", "response_message", "event_message")
        _register(name, zip(names, (*parts, (Nodetype.NAME, event)), strict=True))
    return str(STORE.hash_rihs01(name))


def package_files(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file of definitions of the ROS package `mecazen_msgs`, and its content."""
    for topic in TOPICS:
        package, _, name = topic.type.ROS_TYPE.partition("/msg/")
        names = re.findall(rf"MSG: {PACKAGE}/(.+)", definition(topic.type))
        for short in (*names, name) if package == PACKAGE else names:
            kind = message(f"{PACKAGE}/msg/{short}")
            lines = inspect.cleandoc(kind.__doc__).splitlines()
            comment = "".join(f"# {line}".rstrip() + "\n" for line in lines)
            fields = definition(kind).partition("=" * 80)[0]
            yield folder / "msg" / f"{short}.msg", f"{comment}\n{fields}"
