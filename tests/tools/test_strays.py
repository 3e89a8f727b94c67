"""Warnings about keys without samples, and about samples without effect."""

from types import SimpleNamespace

import pytest
import tomli_w
from mecazen.keys import TOPICS
from mecazen.messages import String
from mecazen_tools.strays import absent, ignored, mistake


def test_a_mistyped_key_is_answered_with_a_similar_one():
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
        (BACK, "**", "nothing has been published"),
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
        (BACK, DRIVEN, "target/cmd_vel", None),
        ((), {}, "cmd_vel", "no service that runs there takes it"),
        (BACK, {}, "odom", "taken only from controller, which runs there"),
        (("physics", "follower"), {}, "odom", None),
        (BACK, {}, "my/key", None),
    ],
)
def test_why_a_sample_has_no_effect(alive, scenario, key, reason):
    assert ignored(bus(*alive, **scenario), key) == (reason and f"{key}: {reason}")
