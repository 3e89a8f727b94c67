"""Types, definitions and hashes are those that ROS 2 Jazzy computes of its own files."""

from typing import Annotated

import msgspec
import pytest
from drawn import KINDS
from harness import ROOT
from mecazen import messages as m
from mecazen.messages import Message
from mecazen_ros import cdr
from mecazen_ros.interfaces import message, service
from mecazen_ros.parameters import PARAMETER_SERVICES
from mecazen_ros.types import RosTypeError, definition, service_hash, type_hash
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

with pytest.MonkeyPatch.context() as patch:
    patch.setenv("ROS_DISTRO", "jazzy")  # else it takes itself for Humble
    from ros2_pyterfaces import core
    from ros2_pyterfaces.core.rcl_interfaces import srv

JAZZY = get_typestore(Stores.ROS2_JAZZY)
"""ROS's own types, and those of the package that a user builds."""
for file in (ROOT / "ros2" / "mecazen_msgs" / "msg").glob("*.msg"):
    JAZZY.register(get_types_from_msg(file.read_text(), f"mecazen_msgs/msg/{file.stem}"))
ONLY_ROS = ("TwistStamped", "TFMessage", "Parameter", "ParameterDescriptor", "ListParametersResult")


@pytest.mark.parametrize("kind", [*KINDS, *map(message, ONLY_ROS)], ids=lambda kind: kind.__name__)
def test_a_message_has_ros_own_definition_and_hash(kind):
    if kind.ROS_TYPE in JAZZY.fielddefs:
        assert definition(kind) == JAZZY.generate_msgdef(kind.ROS_TYPE, ros_version=2)[0]
        assert type_hash(kind) == JAZZY.hash_rihs01(kind.ROS_TYPE)


@pytest.mark.parametrize(
    ("kind", "known"),
    [
        # as in the logs of ROS 2 Jazzy
        (m.Twist, "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"),
        (m.DiagnosticArray, "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ],
)
def test_the_hash_of_a_message_is_that_of_ros_logs(kind, known):
    assert type_hash(kind) == f"RIHS01_{known}"


def test_the_hash_of_a_service_is_that_of_ros_logs():
    known = "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    name = "std_srvs/srv/Trigger"
    assert service_hash(name, *service(name)) == f"RIHS01_{known}"


@pytest.mark.parametrize("one", PARAMETER_SERVICES, ids=lambda one: one.name)
def test_the_services_for_parameters_have_the_hashes_of_ros2_pyterfaces(one):
    known = core.hash_rihs01(getattr(srv, one.kind.rpartition("/")[2]))
    assert service_hash(one.kind, *one.interface) == known


@pytest.mark.parametrize(
    ("annotation", "ros"),
    [
        (m.UInt8, "uint8"),
        (Annotated[int, msgspec.Meta(gt=-1, lt=257)], "uint16"),
        (Annotated[int, msgspec.Meta(ge=-128, le=127)], "int8"),
        (Annotated[int, msgspec.Meta(ge=-129, le=0)], "int16"),
        (Annotated[int, msgspec.Meta(ge=-1, le=2**31)], "int64"),
        (Annotated[int, msgspec.Meta(ge=0)], "uint64"),
        (Annotated[int, msgspec.Meta(ge=0, le=3, extra={"ros": "byte"})], "byte"),
        (int, "int64"),
        (float, "float64"),
        (m.Float32, "float32"),
        (m.Matrix3, "float64[9]"),
        (Annotated[tuple[str, ...], msgspec.Meta(max_length=4)], "string[<=4]"),
        (Annotated[str, msgspec.Meta(max_length=8)], "string<=8"),
        (bytes, "uint8[]"),
        (tuple[m.Time, ...], "builtin_interfaces/Time[]"),
    ],
)
def test_the_type_of_a_field_is_the_narrowest_that_holds_its_bounds(annotation, ros):
    kind = msgspec.defstruct("Kind", [("field", annotation)], bases=(Message,), frozen=True)
    kind.ROS_TYPE = f"test_msgs/msg/Kind{abs(hash(ros))}"
    assert definition(kind).startswith(f"{ros} field\n")


def test_what_ros_can_not_say_is_an_error_that_names_the_field():
    with pytest.raises(RosTypeError, match="mecazen_msgs/msg/ResetRequest: seed: ROS has no type"):
        type_hash(m.ResetRequest)
    for annotation in (dict[str, int], tuple[tuple[int, ...], ...], str | None):
        kind = msgspec.defstruct("Kind", [("odd", annotation)], bases=(Message,), frozen=True)
        kind.ROS_TYPE = "my_msgs/msg/Kind"
        with pytest.raises(RosTypeError, match="my_msgs/msg/Kind: odd: ROS has no type for"):
            cdr.encode(kind(odd={}))


def test_another_message_of_the_same_name_is_an_error():
    class Time(Message):
        ROS_TYPE = m.Time.ROS_TYPE
        sec: float = 0.0

    type_hash(m.Time)
    with pytest.raises(RosTypeError, match="builtin_interfaces/msg/Time: another message of this"):
        type_hash(Time)
