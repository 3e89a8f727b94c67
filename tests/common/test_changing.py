"""Which parameters have other values from which tick on."""

import pytest
from common.sections import scenario_with
from harness import error_of
from mecazen.config import Change
from mecazen.errors import ConfigError
from mecazen.runtime.changing import Changing


def test_what_is_set_stays_over_a_reset_and_the_script_begins_anew():
    script = (
        Change(0.03, {"mine": {"reach_m": 3.0}}),
        Change(0.0, {"mine": {"gains": {"kp": 9.0}}}),
    )
    changing = Changing(scenario_with(changes=script), lambda *_: None)

    def at(tick):
        differs = changing.take(tick)
        mine = changing.scenario.mine
        return differs, mine.reach_m, mine.gains.kp, mine.side

    assert [at(tick) for tick in (0, 1)] == [(True, 0.5, 9.0, "left"), (False, 0.5, 9.0, "left")]
    changing.ask({"mine.side": "right"})
    with pytest.raises(ConfigError):
        changing.ask({"mine.reach_m": "7", "mine.side": "up"})  # all or nothing
    assert [at(tick) for tick in (2, 3)] == [(True, 0.5, 9.0, "right"), (True, 3.0, 9.0, "right")]
    assert (changing.revision, [*changing.settings]) == (
        3,
        ["mine.gains.kp", "mine.side", "mine.reach_m"],
    )
    assert at(0) == (True, 0.5, 9.0, "right")
    assert at(1) == (False, 0.5, 9.0, "right")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (Change(0.005, {}), "changes[0].at_s"),
        (Change(1.0, {"mine": {"side": "up"}}), "changes[0]: mine.side: got 'up'"),
        (Change(1.0, {"sim": {"tick_s": 1.0}}), "changes[0]: sim.tick_s: can't change"),
    ],
)
def test_a_script_that_can_not_be_is_refused_at_the_start(change, words):
    scenario = scenario_with(changes=(change,))
    assert words in error_of(ConfigError, lambda: Changing(scenario, lambda *_: None))
