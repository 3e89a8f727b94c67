"""Live parameters: their allowed values, and from which tick on they have changed."""

import pytest
from common.sections import Gains, Mine, scenario_with
from harness import error_of
from mecazen import messages as m
from mecazen.errors import ConfigError
from mecazen.parameters import (
    changed,
    described,
    parameters,
    refuse_unknown,
    settings_of,
    to_message,
)
from mecazen.runtime.live import LiveParameters


def test_live_fields_are_parameters_with_their_allowed_values():
    descriptors = {key: described(key, live) for key, live in parameters(scenario_with()).items()}
    assert [*descriptors] == [
        f"mine.{name}"
        for name in ("reach_m", "bearing_deg", "heading_deg", "side", "order", "turns", "gains.kp")
    ]
    assert descriptors["mine.reach_m"] == m.ParameterDescriptor(
        name="mine.reach_m",
        value="0.5",
        type="float",
        unit="m",
        range=(0.0, 1e9),
        allowed="a number > 0 and <= 1000000000",
    )
    bearing = descriptors["mine.bearing_deg"]
    assert (bearing.value, bearing.unit, bearing.range) == ("", "°", (-360.0, 360.0))
    assert bearing.allowed.endswith(", or left out")
    kinds = [descriptors[f"mine.{name}"] for name in ("side", "order", "turns")]
    values = [(kind.type, kind.value) for kind in kinds]
    assert values == [("string", '"left"'), ("list", '["a", "b"]'), ("bool", "true")]
    assert parameters(scenario_with(services=("physics",))) == {}


def test_a_change_is_a_value_or_left_out():
    start = scenario_with()
    settings = {"mine.reach_m": 2, "mine.gains.kp": 1e-3, "mine.side": "right"}
    both = {"mine.bearing_deg": 90, "mine.heading_deg": -90.0, "mine.order": ["b"]}
    after = changed(start, settings | both).mine
    assert after == Mine(2.0, 90.0, -90.0, "right", ("b",), gains=Gains(1e-3))
    left_out = both | {"mine.bearing_deg": None, "mine.heading_deg": None, "mine.turns": False}
    assert changed(start, left_out).mine == Mine(order=("b",), turns=False)
    message = m.Parameters(parameters=to_message(left_out))
    assert settings_of(message) == left_out


@pytest.mark.parametrize(
    ("key", "text", "line"),
    [
        ("mine.reach_m", "0", "mine.reach_m: got 0; allowed: a number > 0 and <= 1000000000"),
        ("mine.reach_m", "", "mine.reach_m: got None; allowed: a number > 0 and <= 1000000000"),
        ("mine.side", "[", "mine.side: [: not TOML: "),
        ("mine.bearing_deg", "9", "mine: bearing_deg and heading_deg must be given together"),
        ("mine.reach", "1", "mine.reach: no such parameter; did you mean mine.reach_m?"),
        ("a\nb", "1", r"a\nb: no such parameter; `mecazen param list` shows all"),
        ("mine", "1", "mine: can't change while it runs: its value at the start counts"),
        ("mine.file", "1", "mine.file: can't change while it runs: its value"),
        ("guard.margin_m", "1", "guard.margin_m: guard takes no part in this scenario"),
        ("robots.six.mine.reach_m", "1", "robots.six.mine.reach_m: no such parameter; did"),
    ],
)
def test_a_wrong_change_is_one_line(key, text, line):
    start = scenario_with()

    def change():
        message = m.Parameters(parameters=(m.Parameter(name=key, value=text),))
        refuse_unknown(start, settings_of(message))
        changed(start, settings_of(message))

    assert error_of(ConfigError, change).startswith(line)


BOX = {"kind": "box", "size_m": [1, 1, 1], "position_m": [0, 0]}
PERSON = {"kind": "person"}


def test_what_was_added_is_a_parameter_until_the_next_run():
    checked = []
    live = LiveParameters(
        scenario_with(), lambda _, name: checked.append(name), lambda _: checked.append("world")
    )
    live.set({"world.added.crate": BOX, "mine.reach_m": 2.0})
    live.set({"world.added.pillar": BOX})
    live.set({"world.added.crate": None})
    assert live.apply()
    assert live.settings["world.added.crate"] is None
    assert (
        [*live.scenario.world.added]
        == ["pillar"]
        == [key.removeprefix("world.added.") for key in parameters(live.scenario) if "added" in key]
    )
    (pillar,) = live.scenario.world.solids
    assert pillar.size_m == (1.0, 1.0, 1.0)
    value = described("world.added.pillar", parameters(live.scenario)["world.added.pillar"]).value
    assert settings_of(m.Parameters(parameters=(m.Parameter("x", value),)))["x"]["kind"] == "box"
    live.begin()
    assert (live.apply(), live.settings) == (True, {"mine.reach_m": 2.0})
    assert live.scenario.world.added == {}
    assert checked == ["mine", "world", "world", "world"]


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("crate", BOX, "crate: exists already; `mecazen world remove crate` takes it away"),
        ("crat", None, "crat: was not added; did you mean crate?"),
        ("x", None, "x: was not added; added: crate"),
        (
            "a b",
            BOX,
            "a b: a name has letters, digits, _ and -, and is no person's of the scenario",
        ),
        ("target", BOX, "target: a name has letters, digits, _ and -, and is no person's"),
        ("walker_7", BOX, "walker_7: a name has letters, digits"),
        ("x", BOX | {"size_m": [1, -1, 1]}, "world.added.x.size_m.1: got -1; allowed: a number >"),
        ("x", BOX | {"position_m": [float("nan"), 0]}, "world.added.x.position_m.0: got nan; all"),
        ("x", {"kind": "ball"}, "world.added.x.kind: got 'ball'; allowed: 'box' or 'cylinder' or"),
        ("x", {"kind": "box"}, "world.added.x.size_m, world.added.x.position_m: missing"),
        ("x", 3, "world.added.x: got 3; allowed: 'box' or 'cylinder' or 'person'"),
        ("x", PERSON | {"path": {"kind": "recorded", "file": "/"}}, "world.added.x.path.kind: got"),
        ("x", PERSON, 'people need the crowd: start with --set \'services=["physics", "mine", '),
        ("x" * 70_000, BOX, "too many changes in one run; a reset undoes those of the world"),
    ],
)
def test_what_cannot_be_added_or_removed_is_one_line(name, value, line):
    live = LiveParameters(scenario_with(), lambda *_: None, lambda _: None)
    live.set({"world.added.crate": BOX})
    before = live.requested
    error = error_of(ConfigError, lambda: live.set({f"world.added.{name}": value}))
    assert error.startswith(line)
    assert live.requested is before


def test_without_a_name_all_robots_are_changed():
    start = scenario_with(("one", {}), ("two", {"mine": {"side": "right"}}))

    def reach(settings):
        refuse_unknown(start, settings)
        seen = changed(start, settings)
        return [seen.of(name).mine.reach_m for name in ("one", "two")]

    of_two = {"robots.two.mine.reach_m": 2}
    assert reach({"mine.reach_m": 3}) == [3.0, 3.0]
    assert reach(of_two) == [0.5, 2.0]
    assert reach({"robots.one.mine.reach_m": 2}) == [2.0, 0.5]
    # the last one counts
    assert reach({**of_two, "mine.reach_m": 3}) == [3.0, 3.0]
    assert reach({"mine.reach_m": 3, **of_two}) == [3.0, 2.0]
    assert changed(start, of_two).of("two").mine.side == "right"


def test_parameters_change_in_the_next_tick_all_or_none():
    live = LiveParameters(scenario_with(), lambda *_: None, lambda _: None)

    def apply():
        has_changed = live.apply()
        return has_changed, live.scenario.mine.reach_m, live.scenario.mine.side

    assert apply() == (False, 0.5, "left")
    live.set({"mine.reach_m": 3, "mine.side": "right"})
    live.set({"mine.reach_m": 4})
    assert live.scenario.mine.reach_m == 0.5
    for settings in ({"mine.reach_m": 7, "mine.side": "up"}, {"sim.tick_s": 1.0}):
        with pytest.raises(ConfigError):
            live.set(settings)
    assert apply() == (True, 4.0, "right")
    assert [*live.settings] == ["mine.side", "mine.reach_m"]
    live.set({"mine.side": "right"})  # as it is
    assert apply() == (False, 4.0, "right")
