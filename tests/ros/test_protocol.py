"""rmw_zenoh's names, tokens and attachments, against what its own sources and peers give."""

import struct

import pytest
from mecazen.bridges import is_bridged
from mecazen.errors import RefusedError
from mecazen_ros.protocol import (
    LATCHED,
    SENSOR_DATA,
    Attachment,
    Node,
    Qos,
    data_key,
    dds_type,
    gid_of,
)

TWIST = "geometry_msgs::msg::dds_::Twist_"
HASHED = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"


def test_a_topics_key_has_domain_name_type_and_hash():
    key = data_key(0, "robot1/cmd_vel", TWIST, HASHED)
    assert key == f"0/robot1/cmd_vel/{TWIST}/{HASHED}"
    assert dds_type("geometry_msgs/msg/Twist") == TWIST
    assert is_bridged(key)  # so that others leave it out
    assert not is_bridged("robot1/cmd_vel")


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (Qos(), "::,10:,:,:,,"),
        (SENSOR_DATA, "2::,5:,:,:,,"),
        (LATCHED, ":1:,1:,:,:,,"),
        (Qos(100), "::,100:,:,:,,"),
    ],
)
def test_quality_of_service_is_as_rmw_zenoh_writes_it(qos, text):
    assert qos.text == text


def test_slashes_of_names_in_a_token_are_percent_signs():
    node = Node(7, "a1b2", 3, "fleet/robot1", "controller")
    assert node.token.split("/NN/") == ["@ros2_lv/7/a1b2/3/3", "%/%fleet%robot1/controller"]
    token = node.endpoint(5, "MS", "fleet/robot1/cmd_vel", TWIST, HASHED, Qos())
    assert token == (
        "@ros2_lv/7/a1b2/3/5/MS/%/%fleet%robot1/controller/%fleet%robot1%cmd_vel/"
        f"{TWIST}/{HASHED}/::,10:,:,:,,"
    )


def test_no_part_of_the_token_of_a_node_without_a_namespace_is_empty():
    expected = "@ros2_lv/0/a1b2/0/0/NN/%/%/physics"
    assert Node(0, "a1b2", 0, "", "physics").token == expected


def test_an_attachment_is_sequence_time_length_and_identity():
    gid = bytes(range(16))
    packed = Attachment(2, 3, gid).pack()
    assert packed == struct.pack("<qqB", 2, 3, 16) + gid
    assert Attachment.unpack(packed) == (2, 3, gid)
    assert Attachment.unpack(packed + b"more") == (2, 3, gid)


@pytest.mark.parametrize(
    "wrong",
    [b"", bytes(16), bytes(33), struct.pack("<qqB", -1, 0, 16) + bytes(16)],
    ids=["none", "a stamp", "a length of 0", "a negative number"],
)
def test_an_attachment_that_is_not_rmw_zenohs_is_refused(wrong):
    with pytest.raises(RefusedError, match="attachment"):
        Attachment.unpack(wrong)


def test_identities_differ():
    assert len({gid_of("a"), gid_of("b")}) == 2
    assert len(gid_of("a")) == 16
