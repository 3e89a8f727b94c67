"""Types, definitions and hashes are those that ROS 2 Jazzy computes of its own files."""

from typing import Annotated

import msgspec
import pytest
from mecazen import messages as m
from mecazen.messages import Message
from mecazen_ros import cdr
from mecazen_ros.interfaces import service
from mecazen_ros.types import RosTypeError, definition, service_hash, type_hash

HASHES = {
    m.Twist: "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    m.Odometry: "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    m.JointState: "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    m.LaserScan: "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    m.Clock: "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    m.String: "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    m.DiagnosticArray: "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}
"""As in the logs of ROS 2 Jazzy."""


class Flag(Message):
    ROS_TYPE = "std_srvs/srv/SetBool_Request"
    data: bool = False


@pytest.mark.parametrize("kind", HASHES, ids=lambda kind: kind.__name__)
def test_the_hash_of_a_message_is_ros_own(kind):
    assert type_hash(kind) == f"RIHS01_{HASHES[kind]}"


@pytest.mark.parametrize(
    ("name", "request_kind", "response", "known"),
    [
        (
            "std_srvs/srv/Trigger",
            m.Empty,
            service("std_srvs/srv/Trigger").response,
            "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
        ),
        (
            "std_srvs/srv/SetBool",
            Flag,
            service("std_srvs/srv/Trigger").response,
            "abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
        ),
        (
            "std_srvs/srv/Empty",
            m.Empty,
            m.Empty,
            "5888399dedec5ccc85ea6451949fd2c9f97bfdf963f9a588821639fcd31b5d19",
        ),
    ],
)
def test_the_hash_of_a_service_is_ros_own(name, request_kind, response, known):
    assert service_hash(name, request_kind, response) == f"RIHS01_{known}"


def test_a_definition_is_followed_by_those_it_depends_on_each_once_as_it_is_first_met():
    line = "=" * 80
    assert definition(m.DiagnosticArray) == (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n"
        f"{line}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        f"{line}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        f"{line}\nMSG: diagnostic_msgs/DiagnosticStatus\n"
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n"
        "string message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
        f"{line}\nMSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n"
    )


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
