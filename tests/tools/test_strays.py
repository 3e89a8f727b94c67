"""Keys that are mistyped, silent, or without effect: the reason that a user sees."""

from itertools import chain
from types import SimpleNamespace

import pytest
import tomli_w
from mecazen.keys import CALLS, TOPICS
from mecazen.messages import String
from mecazen_tools.strays import absent, asked_only, ignored, unknown_key


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
