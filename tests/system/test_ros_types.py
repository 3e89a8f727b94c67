"""What others know of ROS 2's types agrees with us: rosbags, pycdr2, cyclonedds, ros2-pyterfaces.

Definitions of ROS's own types come from rosbags; those of `mecazen_msgs` from the folder that a
user builds.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import cyclonedds.idl
import cyclonedds.idl.types
import pycdr2
import pycdr2.types
import pytest
from drawn import KINDS, drawn, plain
from harness import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen.ros import cdr
from mecazen.ros.types import definition, type_hash
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

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


def test_ros2_pyterfaces_has_the_same_hashes_of_services(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    from ros2_pyterfaces.cyclone import std_srvs

    print(std_srvs)
