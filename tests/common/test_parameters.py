"""What can be changed while it runs, what is allowed there, and from which tick on it counts."""

from typing import Literal

import msgspec
import pytest
from carts import ALONE, Rig
from harness import Listener, error_of, load_robot
from harness import Rig as ServiceRig
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Change, Scenario, SimConfig
from mecazen.config import scenario as config
from mecazen.errors import BusError, ConfigError
from mecazen.node import Node
from mecazen.parameters import changed, described, parameters, refuse_unknown, to_text
from mecazen.row import Row, every
from mecazen.runtime.changing import Changing
from mecazen.schema import AngleDeg, Live, Positive, Section


class Gains(Section):
    kp: Live[Positive] = 2.0
    fixed: int = 3


class Mine(Section):
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


def scenario_with(*robots, services=("physics", "mine"), **more):
    each = enumerate(robots)
    own = [{"name": name, "start": {"y_m": 2.0 * n}, **tables} for n, (name, tables) in each]
    tables = {"robot": load_robot(), "services": services, "robots": own, **more}
    return msgspec.convert(msgspec.to_builtins(tables), config.scenario_with(mine=Mine))


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
        ("mine", "1", "mine: can't change while it runs: `--set mine=…` counts from the start"),
        ("mine.file", "1", "mine.file: can't change while it runs: `--set mine.file=…` counts"),
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


class Follower(Node):
    """Writes down its steps, with the parameter that counts in them."""

    ROW = Row("follower", inputs=(every(keys.ODOM),), outputs=(keys.CMD_VEL,))

    def __init__(self, scenario):
        super().__init__(scenario)
        self.config = scenario.follower
        self.steps = []

    def reset(self, seed):
        self.steps.append("reset")

    def step(self, tick, inputs):
        self.steps.append((tick.number, self.config.standoff_m))
        return {}


@pytest.fixture
def node():
    scenario = Scenario(load_robot(), sim=SimConfig(mode="lockstep"))
    rig = ServiceRig("follower", scenario, kinds={"follower": Follower})
    steps = rig.node.steps

    def put(tick, revision=0, run=1):
        rig.put(keys.ODOM, m.Odometry(), rig.at(tick, run)._replace(revision=revision))
        made = [*steps]
        steps.clear()
        return made

    def change(tick, revision, run=1, **settings):
        values = tuple(m.Parameter(f"follower.{key}", text) for key, text in settings.items())
        message = m.Parameters(revision=revision, parameters=values)
        rig.put(keys.PARAMETERS, message, rig.at(tick, run)._replace(revision=revision))
        made = [*steps]
        steps.clear()
        return made

    put.rig, put.change = rig, change
    return put


def test_a_change_counts_from_its_tick_on_however_early_it_is_known(node):
    assert node(4)[-1] == (4, 1.0)
    node.change(6, 1, standoff_m="2")
    assert [node(5), node(6), node(7)] == [[(5, 1.0)], [(6, 2.0)], [(7, 2.0)]]
    node.change(8, 1, standoff_m="3")  # said again, for those who come late
    assert node(8) == [(8, 2.0)]


def test_a_step_waits_for_the_parameters_that_count_in_its_tick(node):
    node(4)
    assert [node(5, 1), node(6, 2)] == [[], []]
    assert node.change(5, 1, standoff_m="2") == [(5, 2.0)]
    assert node.change(6, 2, standoff_m="3") == [(6, 3.0)]
    # who comes late is told of a later tick
    assert node(7, 3) == []
    assert node.change(100, 3, standoff_m="4") == [(7, 4.0)]


def test_a_stamp_that_lies_about_changes_costs_no_more_than_its_own_step(node):
    node(4)
    assert [node(5, 2**32 - 1), node(6)] == [[], [(6, 1.0)]]


def test_what_counts_from_the_first_tick_of_a_run_is_there_when_it_begins(node):
    assert node(0, 1) == ["reset", "reset"]  # of the service, and of the run
    assert node.change(0, 1, standoff_m="2") == ["reset", (0, 2.0)]
    assert node(0, 1, run=2) == ["reset", (0, 2.0)]


def test_when_who_owns_time_has_begun_anew_changes_are_forgotten(node):
    node(4)
    node.change(5, 1, standoff_m="2")
    assert node(5, 1) == [(5, 2.0)]
    assert node(0, 0, run=2) == ["reset", (0, 1.0)]
    node.change(1, 1, run=2, standoff_m="3")
    assert node(1, 1, run=2) == [(1, 3.0)]


def test_a_change_that_is_not_allowed_or_has_no_stamp_is_not_taken(node):
    node(4)
    node.change(5, 1, standoff_m="-1")
    node.change(5, 1, nothing="1")
    node.rig.bus.put_bytes("sim/parameters", b'{"revision":7}')
    assert node(5) == [(5, 1.0)]
    assert node.rig.bus.refused == {"sim/parameters": 2}


def test_a_change_is_published_before_its_tick_and_then_each_second():
    rig = Rig(ALONE, begin=False)
    heard = Listener(rig.bus, keys.PARAMETERS, keys.CLOCK)
    rig.clock.begin()
    rig.tick()
    rig.clock.changing.ask({})
    rig.clock.changing._asked = {"follower.standoff_m": "2"}
    assert [sample.key for sample in heard.take()] == ["clock"] * 2
    rig.tick()
    first, clock = heard.take()
    assert (first.key, first.message.revision) == ("sim/parameters", 1)
    assert first.stamp == clock.stamp
    assert clock.stamp.revision == 1
    assert first.message.parameters == (m.Parameter("follower.standoff_m", "2"),)
    for _ in range(99):
        rig.tick()
    again = [sample for sample in heard.take() if sample.key == "sim/parameters"]
    assert [sample.message.parameters for sample in again] == [first.message.parameters]
    rig.bus.declare_alive("late")
    assert [sample.message.revision for sample in heard.take()] == [1]


@pytest.mark.parametrize("call", [keys.GET_PARAMETERS, keys.SET_PARAMETERS])
def test_without_parameters_there_is_nothing_to_get_or_set(call):
    rig = Rig(ALONE)
    name = "mine.reach_m"
    one = m.Parameters(parameters=(m.Parameter(name, "1"),))
    request = one if call is keys.SET_PARAMETERS else m.ParameterNames((name,))
    line = error_of(BusError, lambda: rig.bus.call(call, request))
    assert line == f"{call.key}: {name}: no such parameter; `mecazen param list` shows all"
    assert rig.bus.call(keys.GET_PARAMETERS, m.ParameterNames()) == m.ParameterDescriptors()
