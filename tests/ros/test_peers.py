"""The ROS side and the grammar are right by themselves: a node by hand, and what it must refuse."""

import pytest
from ros import grammar
from ros.node import attachment

TWIST = "geometry_msgs/msg/Twist"
HASHES = {
    # as in the logs of ROS 2 Jazzy
    TWIST: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "nav_msgs/msg/Odometry": (
        "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
    ),
    "std_srvs/srv/Trigger": (
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    ),
}
TWIST_KEY = f"0/cmd_vel/geometry_msgs::msg::dds_::Twist_/{HASHES[TWIST]}"
TOKEN = (
    "@ros2_lv/0/1a2b/3/7/MP/%/%robot1/mecazen/%robot1%cmd_vel/"
    f"geometry_msgs::msg::dds_::Twist_/{HASHES[TWIST]}/2:1:,5:,:,:,,"
)


@pytest.fixture(scope="module")
def side(router, ros_side):
    return ros_side(router)


def test_the_libraries_agree_with_ros_2_on_hashes(side):
    for name, known in HASHES.items():
        said = side("hashes", name)
        assert said == dict.fromkeys(said, known)


def test_what_the_sdk_says_of_itself_is_of_the_grammar(router, side, raw_node):
    node = raw_node(router)
    heard = node.hear(TWIST_KEY)
    side("subscribe", "/cmd_vel", TWIST)
    side("publish", "/cmd_vel", TWIST, {"linear": {"x": 0.5}})
    node.wait(lambda: heard)
    assert grammar.key(heard[0].key) == grammar.Data(0, "/cmd_vel", TWIST, HASHES[TWIST])
    assert grammar.attachment(heard[0].attachment).sequence >= 0
    assert side("read", TWIST, [heard[0].payload.hex()])[0]["linear"]["x"] == 0.5
    kinds = [grammar.token(token).kind for token in node.tokens()]
    assert sorted(kinds) == ["MP", "MS", "NN", "NN"]


def test_the_sdk_hears_a_node_by_hand(router, side, raw_node):
    payload = side("write", TWIST, {"linear": {"y": 0.25}})
    side("subscribe", "/cmd_vel", TWIST)
    node = raw_node(router)
    node.put(TWIST_KEY, bytes.fromhex(payload))
    (twist,) = side("take", "/cmd_vel")
    assert twist["linear"] == {"x": 0.0, "y": 0.25, "z": 0.0}


def test_the_parts_of_a_token_are_told_apart():
    said = grammar.token(TOKEN)
    assert (said.zid, said.node_id, said.id, said.kind) == ("1a2b", 3, 7, "MP")
    assert (said.namespace, said.node) == ("/robot1", "mecazen")
    assert said.data == grammar.Data(0, "/robot1/cmd_vel", TWIST, HASHES[TWIST])
    infinite = (9223372036, 854775807)
    assert said.qos == grammar.Qos(False, True, False, 5, *[infinite] * 3)
    assert grammar.qos("::,:,:,:,,") == grammar.Qos(True, False, False, 42, *[infinite] * 3)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("/mecazen/", "//"),
        ("/mecazen/", "/my-node/"),
        ("/mecazen/", "/"),
        ("%robot1/", "robot-1/"),
        ("/%robot1%cmd_vel/", "/%2nd/"),
        ("/1a2b/", "/01A2B/"),
        ("/MP/", "/XX/"),
        ("/MP/", "/SS/"),
        ("/3/7/", "/03/7/"),
        ("Twist_/", "Twist/"),
        ("9c45", "9C45"),
        ("2:1:,5:,:,:,,", "2:1:,5:,:,:,"),
        ("2:1:,5:,:,:,,", "2:1:,5:,:,"),
        ("2:1:,5:,:,:,,", "3:1:,5:,:,:,,"),
        (",,", ",,/more"),
    ],
)
def test_what_is_no_token_is_refused(old, new):
    assert old in TOKEN
    with pytest.raises(ValueError):  # noqa: PT011  # any: the grammar says no more
        grammar.token(TOKEN.replace(old, new))


@pytest.mark.parametrize("wrong", [{"sequence": -1}, {"time_ns": -1}, {"gid": b"short"}])
def test_what_is_no_attachment_is_refused(wrong):
    with pytest.raises(ValueError):  # noqa: PT011
        grammar.attachment(attachment(**wrong))
