"""Which parameters have other values from which tick on."""

import pytest
from common.sections import scenario_with
from mecazen.errors import ConfigError
from mecazen.runtime.live import LiveParameters


def test_parameters_change_in_the_next_tick_all_or_none():
    live = LiveParameters(scenario_with(), lambda *_: None)

    def apply():
        has_changed = live.apply()
        return has_changed, live.scenario.mine.reach_m, live.scenario.mine.side

    assert apply() == (False, 0.5, "left")
    live.set({"mine.reach_m": "3", "mine.side": "right"})
    live.set({"mine.reach_m": "4"})
    assert live.scenario.mine.reach_m == 0.5
    for settings in ({"mine.reach_m": "7", "mine.side": "up"}, {"sim.tick_s": "1.0"}):
        with pytest.raises(ConfigError):
            live.set(settings)
    assert apply() == (True, 4.0, "right")
    assert [*live.settings] == ["mine.side", "mine.reach_m"]
    live.set({"mine.side": "right"})  # as it is
    assert apply() == (False, 4.0, "right")
