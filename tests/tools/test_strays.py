"""Keys that are mistyped: which are heard, at no cost to the loop, and what is said of them."""

import secrets
from itertools import chain
from types import SimpleNamespace

import pytest
import tomli_w
from harness import wait
from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.keys import CALLS, TOPICS
from mecazen.messages import String
from mecazen_tools.strays import (
    KEYS,
    OPEN,
    absent,
    asked_only,
    ignored,
    likes,
    report_strays,
    slips,
    unknown_key,
)


def hears(expressions, key):
    return any(includes(expression, key) for expression in expressions)


@pytest.mark.parametrize(
    "typed", ["cmd_vle", "cmdvel", "cmd_ve", "cmmd_vel", "cmd_vell", "mcd_vel", "cdm_vel"]
)
def test_a_slip_is_heard_however_the_robot_is_driven(typed):
    assert hears(slips("cmd_vel"), typed)
    assert hears(likes("cmd_vel"), typed)


@pytest.mark.parametrize("typed", ["cmd-vel", "cmd_val", "cmd_wel", "cmd", "Cmd_vel"])
def test_where_nobody_drives_all_that_begins_or_ends_alike_is_heard(typed):
    assert hears(likes("cmd_vel"), typed)
    assert hears(likes("target/cmd_vel"), f"target/{typed}")
    assert hears(likes("target/cmd_vel"), "tarjet/cmd_vel")


def test_nothing_that_a_node_publishes_is_heard_so_it_costs_the_loop_nothing():
    assert OPEN == ("cmd_vel", "emergency_stop", "target/cmd_vel")
    published = {topic.key.replace("*", "physics") for topic in TOPICS}
    for key in OPEN:
        # while a node drives, only slips are heard; otherwise no node publishes on the key
        assert not any(hears(slips(key), one) for one in published)
        assert not any(hears(likes(key), one) for one in published - {key})


def test_what_is_said_of_a_key_and_of_which_nothing_is():
    assert unknown_key("cmd_vle") == "cmd_vle: no key of mecazen; did you mean cmd_vel?"
    assert unknown_key("sim/rest").endswith("did you mean sim/reset?")
    assert unknown_key("qqq") == "qqq: no key of mecazen; `mecazen topics` shows all"
    assert unknown_key("cmd_v\x1b") == "cmd_v\\u001b: no key of mecazen; did you mean cmd_vel?"
    assert len(unknown_key("x" * 10_000)) < 120
    for one in chain(TOPICS, CALLS):
        key = one.key.replace("*", "physics")
        assert unknown_key(key) is None
        assert unknown_key(f"two/{key}") is None
    assert asked_only("sim/pause").startswith("sim/pause: answers queries")
    assert asked_only("two/set_odometry").startswith("two/set_odometry: answers queries")
    assert asked_only("odom") is asked_only("my/key") is None


def there(*alive, **scenario):
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
    assert absent(there(*alive), key) == reason


def test_why_a_sample_has_no_effect():
    walks, driven = ({"target": {"path": {"kind": kind}}} for kind in ("circle", "driven"))
    two = {**walks, "robots": [{"name": "one", **driven}, {"name": "two"}]}
    for scenario, key in ((walks, "target/cmd_vel"), (two, "two/target/cmd_vel")):
        told = ignored(there(*BACK, **scenario), key)
        assert (
            told
            == f"{key}: the person goes their own way: target.path = {{ kind = 'driven' }} obeys"
        )
    for scenario, key in ((driven, "target/cmd_vel"), (two, "one/target/cmd_vel")):
        assert ignored(there(*BACK, **scenario), key) is None
    assert ignored(there(), "cmd_vel") == "cmd_vel: no service that runs there takes it"
    assert ignored(there(*BACK), "odom") == "odom: taken only from controller, which runs there"
    assert ignored(there(*BACK[:2], "follower"), "odom") is None
    assert ignored(there(*BACK), "cmd_vel") is ignored(there(), "my/key") is None


def test_each_key_is_told_of_once_and_not_more_than_so_many(router):
    config = BusConfig(connect=(router,), namespace=f"strays{secrets.token_hex(6)}")
    bus, hand = ZenohBus(config, "client"), ZenohBus(config, "client")
    told = []
    report_strays(bus, ("one", "two"), {"cmd_vel"}, told.append)
    typed = ["two/cmd_vle", "one/cmd_vel", "one/target/cmd_vel", "my/key", "two/cmd_vle"]
    flood = [f"one/target/cmd_{number}" for number in range(10 * KEYS)]

    def put(*keys):
        for key in keys:
            hand.put_bytes(key, b"{}")

    try:
        # until the router knows of the last subscription, hence of all
        wait(bus, lambda: told or put("two/target/cmd_vle"))
        put(*typed)
        wait(bus, lambda: len(told) == 2)
        assert told == [
            "two/target/cmd_vle: no key of mecazen; did you mean two/target/cmd_vel?",
            "two/cmd_vle: no key of mecazen; did you mean two/cmd_vel?",
        ]
        put(*flood)
        wait(bus, lambda: len(told) == KEYS)
        bus.drain()
        assert len(set(told)) == len(told) == KEYS
    finally:
        bus.close()
        hand.close()
