"""Live parameters: their allowed values, and from which tick on they have changed."""

from typing import Literal

import msgspec
import pytest
from harness import error_of, load_robot
from mecazen import messages as m
from mecazen.config import scenario as config
from mecazen.errors import ConfigError
from mecazen.parameters import (
    ADDED,
    LiveParameters,
    changed,
    described,
    parameters,
    settings_of,
    to_message,
)
from mecazen.schema import AngleDeg, Live, Positive, Section

BOX = {"kind": "box", "size_m": [1, 1, 1], "position_m": [0, 0]}
PERSON = {"kind": "person"}


class Gains(Section):
    kp: Live[Positive] = 2.0
    fixed: int = 3


class Mine(Section):
    """A section with a parameter of each kind."""

    reach_m: Live[Positive] = 0.5
    bearing_deg: Live[AngleDeg | None] = None
    heading_deg: Live[AngleDeg | None] = None
    side: Live[Literal["left", "right"]] = "left"
    order: Live[tuple[str, ...]] = ("a", "b")
    turns: Live[bool] = True
    gains: Gains = Gains()
    file: str = "x"

    def __post_init__(self):
        if (self.bearing_deg is None) != (self.heading_deg is None):
            raise ValueError("bearing_deg and heading_deg must be given together")


def scenario_with(*robots, services=("physics", "mine")):
    """Return a scenario with such a section, and with robots by their names and tables."""
    starts = {name: {"y_m": 2.0 * n} for n, (name, _) in enumerate(robots)}
    robot_tables = [{"name": name, "start": starts[name], **tables} for name, tables in robots]
    tables = {"robot": load_robot(), "services": services, "robots": robot_tables}
    return msgspec.convert(msgspec.to_builtins(tables), config.scenario_with(mine=Mine))


def live_parameters():
    return LiveParameters(scenario_with(), lambda _: None)


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
    message = m.Parameters(parameters=(m.Parameter("mine.side", "["),))
    assert error_of(ConfigError, lambda: settings_of(message)).startswith("mine.side: [: not TOML")


def test_what_was_added_is_a_parameter_until_the_next_run():
    live = live_parameters()
    live.set({f"{ADDED}crate": BOX, "mine.reach_m": 2.0})
    live.set({f"{ADDED}pillar": BOX})
    live.set({f"{ADDED}crate": None})
    assert live.apply()
    assert [*live.scenario.world.added] == ["pillar"]
    (pillar,) = live.scenario.world.solids
    assert pillar.size_m == (1.0, 1.0, 1.0)
    value = described("x", parameters(live.scenario)[f"{ADDED}pillar"]).value
    assert settings_of(m.Parameters(parameters=(m.Parameter("x", value),)))["x"]["kind"] == "box"
    live.begin()
    assert (live.apply(), live.settings) == (True, {"mine.reach_m": 2.0})
    assert live.scenario.world.added == {}


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("mine.reach_m", 0, "mine.reach_m: got 0; allowed: a number > 0 and <= 1000000000"),
        ("mine.reach_m", None, "mine.reach_m: got None; allowed: a number > 0 and <= 1000000000"),
        ("mine.bearing_deg", 9, "mine: bearing_deg and heading_deg must be given together"),
        ("mine.reach", 1, "mine.reach: no such parameter; did you mean mine.reach_m?"),
        ("a\nb", 1, r"a\nb: no such parameter; `mecazen param list` shows all"),
        ("mine.file", "1", "mine.file: can't change while it runs: its value"),
        ("guard.margin_m", 1, "guard.margin_m: guard takes no part in this scenario"),
        (f"{ADDED}crate", BOX, "crate: exists already; `mecazen world remove crate` takes it away"),
        (f"{ADDED}crat", None, "crat: was not added; did you mean crate?"),
        (f"{ADDED}x", None, "x: was not added; added: crate"),
        (f"{ADDED}a b", BOX, "a b: a name has letters, digits, _ and -, and is no person's"),
        (f"{ADDED}target", BOX, "target: a name has letters, digits, _ and -, and is no person's"),
        (f"{ADDED}x", {"kind": "ball"}, "world.added.x.kind: got 'ball'; allowed: 'box' or"),
        (f"{ADDED}x", PERSON, 'people need the crowd: start with --set \'services=["physics"'),
        (f"{ADDED}{'x' * 70_000}", BOX, "too many changes in one run; a reset undoes those of"),
    ],
)
def test_a_wrong_change_is_one_line(key, value, line):
    live = live_parameters()
    live.set({f"{ADDED}crate": BOX})
    before = live.requested
    assert error_of(ConfigError, lambda: live.set({key: value})).startswith(line)
    assert live.requested is before


def test_without_a_name_all_robots_are_changed():
    start = scenario_with(("one", {}), ("two", {"mine": {"side": "right"}}))

    def reach(settings):
        seen = changed(start, settings)
        return [seen.of(name).mine.reach_m for name in ("one", "two")]

    of_two = {"robots.two.mine.reach_m": 2}
    assert reach({"mine.reach_m": 3}) == [3.0, 3.0]
    assert reach(of_two) == [0.5, 2.0]
    # the last one counts
    assert reach({**of_two, "mine.reach_m": 3}) == [3.0, 3.0]
    assert reach({"mine.reach_m": 3, **of_two}) == [3.0, 2.0]
    assert changed(start, of_two).of("two").mine.side == "right"


def test_parameters_change_in_the_next_tick_all_or_none():
    live = live_parameters()

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
