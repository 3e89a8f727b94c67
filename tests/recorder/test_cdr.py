"""Every message survives CDR and JSON bit for bit, and others read it as ROS's."""

import math
from typing import Any

import msgspec
import msgspec.inspect as mi
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic
from mecazen import messages, wire
from mecazen.keys import TOPICS
from mecazen.messages import Message
from mecazen.wire import RefusedError
from mecazen_recorder import cdr, writer
from rosbags.typesys import Stores, get_typestore

KINDS = [
    kind
    for kind in vars(messages).values()
    if isinstance(kind, type) and issubclass(kind, Message)
    # two that only queries carry, which are not recorded: one without a field, for which ROS
    # writes a byte of its own, and one whose seed may be none, which ROS can't say
    if kind not in {Message, messages.Empty, messages.ResetRequest}
]
SINGLE = 3.4028234663852886e38
"""The bound of what ROS holds in 32 bits."""
ROS = get_typestore(Stores.ROS2_HUMBLE)


def values(node: mi.Type) -> st.SearchStrategy[Any]:
    """All values of a type, with the extremes of its bounds."""
    if isinstance(node, mi.StructType):
        fields = msgspec.structs.fields(node.cls)
        return st.builds(node.cls, **{f.name: values(mi.type_info(f.type)) for f in fields})
    if isinstance(node, mi.VarTupleType):
        longest = node.max_length or 4
        items = st.lists(values(node.item_type), min_size=node.min_length or 0, max_size=longest)
        return items.map(tuple)
    if isinstance(node, mi.FloatType):
        low = -math.inf if node.ge is None else node.ge
        width = 32 if node.le == SINGLE else 64
        return st.floats(low, node.le, allow_nan=False, allow_infinity=False, width=width)
    if isinstance(node, mi.IntType):
        assert node.ge is not None
        high = node.le if node.lt is None else node.lt - 1
        return st.integers(int(node.ge), int(high)) | st.sampled_from([int(node.ge), int(high)])
    if isinstance(node, mi.BytesType):
        return st.binary(max_size=8)
    return {mi.StrType: st.text(max_size=8), mi.BoolType: st.booleans()}[type(node)]


def bits(value: Any) -> Any:
    """Return a value whose equality is that of bits: -0.0 is not 0.0."""
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, dict):
        return {name: bits(item) for name, item in value.items()}
    return [bits(item) for item in value] if isinstance(value, list | tuple) else value


def plain(message: Message) -> Any:
    return bits(msgspec.to_builtins(message, builtin_types=(bytes,)))


def from_others(value: Any) -> Any:
    """Return what the independent decoder gives as plain values."""
    if hasattr(value, "__slots__"):
        return {name: from_others(getattr(value, name)) for name in value.__slots__}
    return [from_others(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
@settings(max_examples=30)
def test_a_message_is_the_same_after_cdr_and_after_json(kind, data):
    message = data.draw(values(mi.type_info(kind)))
    assert plain(cdr.decode(cdr.encode(message), kind)) == plain(message)
    assert plain(wire.decode(wire.encode(message, "json"), kind)) == plain(message)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
@settings(max_examples=10)
def test_an_independent_decoder_reads_the_same_by_the_schema(kind, data):
    message = data.draw(values(mi.type_info(kind)))
    schema = writer.schema_of(kind, "cdr")
    read = generate_dynamic(schema.name, schema.data.decode())[schema.name]
    assert bits(from_others(read(cdr.encode(message)))) == plain(message)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_the_definition_is_ros_own_and_has_the_fields_of_the_struct(kind):
    text = cdr.definition(kind).partition("=====")[0].strip()
    lines = [line.split() for line in text.splitlines() if "=" not in line]
    assert tuple(line[1] for line in lines) == kind.__struct_fields__
    if not kind.ROS_TYPE.startswith("mecazen_msgs/"):
        assert cdr.definition(kind) == ROS.generate_msgdef(kind.ROS_TYPE, ros_version=2)[0]


def test_the_definitions_of_our_own_messages_are_these():
    def own(kind):
        return cdr.definition(kind).partition("\n=====")[0].splitlines()

    assert own(messages.Observation) == [
        "std_msgs/Header header",
        "geometry_msgs/PoseWithCovariance[] poses",
        "string[] ids",
    ]
    assert own(messages.SimState) == [
        "builtin_interfaces/Time clock",
        "uint64 tick",
        "uint32 seed",
        "string mode",
        "bool paused",
        "float64 speed",
        "float64 rtf",
        "uint64 missed_deadlines",
    ]


@pytest.mark.parametrize("kind", sorted({t.type for t in TOPICS}, key=lambda k: k.__name__))
def test_a_json_schema_has_the_message_at_its_root_and_all_that_it_refers_to(kind):
    schema = writer.schema_of(kind, "json")
    table = msgspec.json.decode(schema.data)
    assert (schema.encoding, schema.name) == ("jsonschema", kind.ROS_TYPE)
    assert table["type"] == "object"
    assert tuple(table["properties"]) == kind.__struct_fields__
    references = [part.partition(b'"')[0] for part in schema.data.split(b'"$ref":"#/$defs/')[1:]]
    assert {name.decode() for name in references} <= set(table["$defs"])


@pytest.mark.parametrize("payload", [b"", b"\x00\x01\x00\x00", b"{}", bytes(40)])
def test_what_is_no_cdr_of_a_message_is_refused(payload):
    with pytest.raises(RefusedError, match="nav_msgs/msg/Odometry"):
        cdr.decode(payload, messages.Odometry)


def test_numbers_that_are_not_finite_are_refused():
    payload = bytearray(cdr.encode(messages.Vector3(x=1.0)))
    payload[4:12] = bytes(6) + b"\xf0\x7f"  # infinity
    with pytest.raises(RefusedError, match="Vector3"):
        cdr.decode(bytes(payload), messages.Vector3)
