"""Warnings about keys without samples, and about samples without effect."""

import json
from types import SimpleNamespace

import pytest
import tomli_w
from mecazen.keys import TOPICS
from mecazen.messages import String
from mecazen_tools.publishers import Programs
from mecazen_tools.strays import absent, ignored, mistake


def test_similar_key_is_suggested_for_a_typo():
    assert mistake("cmd_vle") == "cmd_vle: no key of mecazen; did you mean cmd_vel?"
    assert mistake("sim/rest").endswith("did you mean sim/reset?")
    assert mistake("qqq") == "qqq: no key of mecazen; `mecazen topics` shows all"
    assert mistake("cmd_v\x1b") == "cmd_v\\u001b: no key of mecazen; did you mean cmd_vel?"
    assert len(mistake("x" * 10_000)) < 120
    assert mistake("two/set_odometry").startswith("two/set_odometry: answers queries")
    assert mistake("**") is None
    for topic in TOPICS:
        key = topic.key.replace("*", "physics")
        assert mistake(key) is mistake(f"two/{key}") is None


def bus(*alive, **scenario):
    """Return a bus on which services are alive, and physics answers with a scenario."""
    answer = String(data=tomli_w.dumps(scenario))
    return SimpleNamespace(alive=lambda: set(alive), call=lambda *_: answer)


BACK = ("physics", "physics/ready", "controller", "target", "follower")


@pytest.mark.parametrize(
    ("alive", "key", "reason"),
    [
        (BACK, "follower/state", "nothing has been published"),
        (BACK[:-1], "follower/state", "follower would publish it, and no such service runs"),
        (["two/follower"], "two/follower/state", "nothing has been published"),
        (BACK, "target/cmd_vel", "no service publishes it, only tools such as `mecazen pub`"),
        ((), "odom", "no simulation runs there"),
    ],
)
def test_why_a_key_is_silent(alive, key, reason):
    assert absent(bus(*alive), key) == reason


WALKS, DRIVEN = ({"target": {"path": {"kind": kind}}} for kind in ("circle", "driven"))
TWO = {**WALKS, "robots": [{"name": "one", **DRIVEN}, {"name": "two"}]}
OBEYS = "the person goes their own way: target.path = { kind = 'driven' } obeys"


@pytest.mark.parametrize(
    ("alive", "scenario", "key", "reason"),
    [
        (BACK, WALKS, "target/cmd_vel", OBEYS),
        (BACK, TWO, "two/target/cmd_vel", OBEYS),
        (BACK, TWO, "one/target/cmd_vel", None),
        ((), {}, "cmd_vel", "no service that runs there takes it"),
        (BACK, {}, "odom", "taken only from controller, which runs there"),
        (("physics", "follower"), {}, "odom", None),
        (BACK, {}, "my/key", None),
    ],
)
def test_why_a_sample_has_no_effect(alive, scenario, key, reason):
    assert ignored(bus(*alive, **scenario), key) == (reason and f"{key}: {reason}")


ROS = "geometry_msgs::msg::dds_::Twist_/RIHS01_9c45"
HOLDERS = {"token/lab/mecazen/controller": "c", "token/lab/mecazen/follower": "f",
           "subscriber/lab/cmd_vel": "c", "publisher/lab/cmd_vel": "f", "publisher/lab/odom": "c",
           f"publisher/0/lab/follower/cmd_vel/{ROS}": "ros", "subscriber/**": "recorder",
           "token/two/mecazen/controller": "t", "subscriber/two/cmd_vel": "t"}  # fmt: skip
ONLY = "no service reads this key, only lab/cmd_vel, two/cmd_vel"


@pytest.mark.parametrize(
    ("key", "warning"),
    [
        ("rt/cmd_vel", ONLY),
        ("cmd_vel", ONLY),
        ("lab/robot1/cmd_vel", ONLY),
        (f"0/cmd_vel/{ROS}", f"{ONLY}; ROS needs `mecazen up --ros2`"),
        *((key, None) for key in ("lab/cmd_vel", "two/cmd_vel", "lab/guard/cmd_vel", "rt/scan")),
    ],
)
def test_commands_that_no_service_reads_are_named(key, warning):
    holders = HOLDERS | {f"publisher/{key}": "stranger"}
    entries = {
        entry: json.dumps({"peers": [program], "clients": []}) for entry, program in holders.items()
    }
    programs = Programs(SimpleNamespace(prefix="lab/", router_entries=lambda: entries))
    lines = programs.in_vain()
    assert lines == programs.in_vain([key])
    assert [line.partition(" (")[0] for line in lines] == (
        [f"{key[:60]}{'…' * (len(key) > 60)}: {warning}"] if warning else []
    )
