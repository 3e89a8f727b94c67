"""Live parameters and their allowed values."""

import pytest
from common.sections import Gains, Mine, scenario_with
from harness import error_of
from mecazen import messages as m
from mecazen.errors import ConfigError
from mecazen.parameters import changed, described, parameters, refuse_unknown, to_text


def test_live_fields_are_parameters_and_say_what_is_allowed():
    found = {key: described(key, live) for key, live in parameters(scenario_with()).items()}
    assert [*found] == [
        f"mine.{name}"
        for name in ("reach_m", "bearing_deg", "heading_deg", "side", "order", "turns", "gains.kp")
    ]
    assert found["mine.reach_m"] == m.ParameterDescriptor(
        name="mine.reach_m",
        value="0.5",
        type="float",
        unit="m",
        range=(0.0, 1e9),
        allowed="a number > 0 and <= 1000000000",
    )
    bearing = found["mine.bearing_deg"]
    assert (bearing.value, bearing.unit, bearing.range) == ("", "°", (-360.0, 360.0))
    assert bearing.allowed.endswith(", or left out")
    kinds = {key.rpartition(".")[2]: (one.type, one.value) for key, one in found.items()}
    assert kinds["side"] == ("string", '"left"')
    assert kinds["order"] == ("list", '["a", "b"]')
    assert kinds["turns"] == ("bool", "true")
    assert parameters(scenario_with(services=("physics",))) == {}


def test_a_change_is_as_the_loader_takes_it_and_may_leave_out_what_may_be_left_out():
    start = scenario_with()
    settings = {"mine.reach_m": "2", "mine.gains.kp": "1e-3", "mine.side": "right"}
    both = {"mine.bearing_deg": "90", "mine.heading_deg": "-90.0", "mine.order": '["b"]'}
    after = changed(start, settings | both).mine
    assert after == Mine(2.0, 90.0, -90.0, "right", ("b",), gains=Gains(1e-3))
    left_out = both | {"mine.bearing_deg": "", "mine.heading_deg": "", "mine.turns": "false"}
    assert changed(start, left_out).mine == Mine(order=("b",), turns=False)
    assert [to_text(v) for v in (None, 0.1, float("inf"), True, "a")] == [
        "",
        "0.1",
        "inf",
        "true",
        '"a"',
    ]


@pytest.mark.parametrize(
    ("key", "text", "line"),
    [
        ("mine.reach_m", "0", "mine.reach_m: got 0; allowed: a number > 0 and <= 1000000000"),
        ("mine.reach_m", "", "mine.reach_m: got ''; allowed: a number > 0 and <= 1000000000"),
        ("mine.side", "up", "mine.side: got 'up'; allowed: 'left' or 'right'"),
        ("mine.gains.kp", "nan", "mine.gains.kp: got nan; allowed: a number > 0 and <= 1000000000"),
        ("mine.bearing_deg", "9", "mine: bearing_deg and heading_deg must be given together"),
        ("mine.reach", "1", "mine.reach: no such parameter; did you mean mine.reach_m?"),
        ("a\nb", "1", r"a\nb: no such parameter; `mecazen param list` shows all"),
        ("mine", "1", "mine: can't change while it runs: its value at the start counts"),
        ("mine.file", "1", "mine.file: can't change while it runs: its value"),
        ("guard.margin_m", "1", "guard.margin_m: guard takes no part in this scenario"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line(key, text, line):
    start = scenario_with()

    def change():
        refuse_unknown(start, {key: text})
        changed(start, {key: text})

    assert error_of(ConfigError, change).startswith(line)


def test_without_a_name_all_robots_are_changed_and_with_one_only_that():
    start = scenario_with(("one", {}), ("two", {"mine": {"side": "right"}}))

    def reach(settings):
        refuse_unknown(start, settings)
        seen = changed(start, settings)
        return [seen.of(name).mine.reach_m for name in ("one", "two")]

    of_two = {"robots.two.mine.reach_m": "2"}
    assert reach({"mine.reach_m": "3"}) == [3.0, 3.0]
    assert reach(of_two) == [0.5, 2.0]
    assert reach({"robots.one.mine.reach_m": "2"}) == [2.0, 0.5]
    # the last one counts
    assert reach({**of_two, "mine.reach_m": "3"}) == [3.0, 3.0]
    assert reach({"mine.reach_m": "3", **of_two}) == [3.0, 2.0]
    assert changed(start, of_two).of("two").mine.side == "right"
    wrong = {"robots.six.mine.reach_m": "1"}
    assert "did you mean" in error_of(ConfigError, lambda: reach(wrong))
