"""What others know of ROS 2's types agrees with us: rosbags, pycdr2, cyclonedds, ros2-pyterfaces.

Definitions of ROS's own types come from rosbags; those of `mecazen_msgs` from the folder that a
user builds.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import cyclonedds.idl
import cyclonedds.idl.types
import msgspec
import pycdr2
import pycdr2.types
import pytest
from drawn import KINDS, drawn, plain
from harness import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen import messages as m
from mecazen_ros import cdr
from mecazen_ros.interfaces import message as ros_message
from mecazen_ros.parameters import PARAMETER_SERVICES
from mecazen_ros.types import definition, service_hash, type_hash
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

with pytest.MonkeyPatch.context() as patch:
    patch.setenv("ROS_DISTRO", "jazzy")  # else it takes itself for Humble
    from ros2_pyterfaces import core
    from ros2_pyterfaces.core import all_srvs

REQUEST = "request_message"
FILES = sorted((ROOT / "ros2" / "mecazen_msgs" / "msg").glob("*.msg"))
STORE = get_typestore(Stores.ROS2_JAZZY)
for file in FILES:
    STORE.register(get_types_from_msg(file.read_text(), f"mecazen_msgs/msg/{file.stem}"))
OTHERS = [kind for kind in KINDS if kind.ROS_TYPE in STORE.fielddefs]
named = pytest.mark.parametrize("kind", OTHERS, ids=lambda kind: kind.__name__)


@named
def test_rosbags_has_the_same_definition_and_hash(kind):
    assert definition(kind) == STORE.generate_msgdef(kind.ROS_TYPE, ros_version=2)[0]
    assert type_hash(kind) == STORE.hash_rihs01(kind.ROS_TYPE)


@named
@given(data=st.data())
@settings(max_examples=5)
def test_rosbags_writes_what_it_read_in_both_byte_orders_alike(kind, data):
    message = data.draw(drawn(kind))
    payload = cdr.encode(message)
    read = STORE.deserialize_cdr(payload, kind.ROS_TYPE)
    assert bytes(STORE.serialize_cdr(read, kind.ROS_TYPE, little_endian=True)) == payload
    swapped = bytes(STORE.serialize_cdr(read, kind.ROS_TYPE, little_endian=False))
    assert plain(cdr.decode(swapped, kind)) == plain(message)


@cache
def idl(library: Any, name: str) -> Any:
    """Return a type of ROS in a library for IDL."""
    members = {field: idl_field(library, *node) for field, node in STORE.fielddefs[name][1]}
    placeholder = {"structure_needs_at_least_one_member": library.types.uint8}
    namespace = {"__annotations__": members or placeholder}
    made = type(library.IdlStruct)(name.replace("/", "_"), (library.IdlStruct,), namespace)
    return dataclass(made)


def idl_field(library: Any, node: Nodetype, detail: Any) -> Any:
    if node == Nodetype.BASE:
        kinds = {"string": str, "bool": bool, "byte": library.types.uint8}
        return kinds.get(detail[0]) or getattr(library.types, detail[0])
    if node == Nodetype.NAME:
        return idl(library, detail)
    inner, length = detail
    item = idl_field(library, *inner)
    types = library.types
    return types.array[item, length] if node == Nodetype.ARRAY else types.sequence[item]


@pytest.mark.parametrize("library", [pycdr2, cyclonedds.idl], ids=["pycdr2", "cyclonedds"])
@named
@given(data=st.data())
@settings(max_examples=2)
def test_libraries_for_dds_write_what_they_read_alike(library, kind, data):
    message = data.draw(drawn(kind))
    payload = cdr.encode(message)
    assert idl(library, kind.ROS_TYPE).deserialize(payload).serialize() == payload


WHOLE = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def annotation(kind: Any) -> Any:
    """Return how a struct says a type of ros2-pyterfaces."""
    if isinstance(kind, dict):
        return struct_of(kind)
    if isinstance(kind, core.Array | core.Sequence):
        length = kind.length if isinstance(kind, core.Array) else kind.max_length
        least = length if isinstance(kind, core.Array) else 0
        meta = msgspec.Meta(min_length=least, max_length=length)
        return Annotated[tuple[annotation(kind.subtype), ...], meta]
    if isinstance(kind, core.BoundedString):
        return Annotated[str, msgspec.Meta(max_length=kind.max_length)]
    if kind in WHOLE:
        low, high = (0, 2) if kind[0] == "u" else (-1, 1)
        half = 2 ** (int(kind.partition("int")[2]) - 1)
        return Annotated[int, msgspec.Meta(ge=low * half, le=min(high * half - 1, 2**63 - 1))]
    byte = Annotated[int, msgspec.Meta(extra={"ros": "byte"})]
    plain_kinds = {"string": str, "bool": bool, "byte": byte, "float64": float}
    return plain_kinds.get(kind, m.Float32)


def struct_of(schema: dict[str, Any]) -> type[m.Message]:
    """Return the struct of a schema of ros2-pyterfaces."""
    name = schema["__typename"]
    members = [(field, annotation(kind)) for field, kind in schema.items() if field != "__typename"]
    namespace = {"ROS_TYPE": name}
    return msgspec.defstruct("Kind", members, bases=(m.Message,), frozen=True, namespace=namespace)


SERVICES = [one for one in vars(all_srvs).values() if isinstance(one, dict) and REQUEST in one]


@pytest.mark.parametrize("service", SERVICES, ids=lambda service: service["__typename"])
def test_ros2_pyterfaces_has_the_same_hashes_of_services(service):
    request, response = struct_of(service[REQUEST]), struct_of(service["response_message"])
    assert service_hash(service["__typename"], request, response) == core.hash_rihs01(service)


KNOWN = {service["__typename"]: core.hash_rihs01(service) for service in SERVICES}


@pytest.mark.parametrize("service", PARAMETER_SERVICES, ids=lambda service: service.name)
def test_the_services_for_parameters_have_the_hashes_of_ros2_pyterfaces(service):
    assert service_hash(service.kind, *service.interface) == KNOWN[service.kind]


@pytest.mark.parametrize(
    "message",
    [
        ros_message("Parameter")(
            "follower.standoff_m",
            ros_message("ParameterValue")(
                3, True, -2, math.inf, "x", b"\x01", (True, False), (1, -2), (0.5,), ("a", "bcd")
            ),
        ),
        ros_message("ParameterDescriptor")(
            "x", 3, "in m", "> 0", True, False, (ros_message("FloatingPointRange")(0.0, 2.0, 0.5),)
        ),
        ros_message("ParameterDescriptor")(integer_range=(ros_message("IntegerRange")(-1, 2, 1),)),
        ros_message("ListParametersResult")(("a", "b.c"), ("b",)),
        ros_message("SetParametersResult")(False, "no"),
    ],
    ids=lambda message: type(message).__name__,
)
def test_rosbags_reads_parameters_alike(message):
    kind = type(message)
    payload = cdr.encode(message)
    read = STORE.deserialize_cdr(payload, kind.ROS_TYPE)
    assert bytes(STORE.serialize_cdr(read, kind.ROS_TYPE)) == payload
    assert cdr.decode(payload, kind) == message
    assert type_hash(kind) == STORE.hash_rihs01(kind.ROS_TYPE)
    for field in kind.__struct_fields__:
        if isinstance(value := getattr(message, field), bool | int | float | str):
            assert getattr(read, field) == value
