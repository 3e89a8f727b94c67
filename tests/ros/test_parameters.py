"""The parameter services of a ROS node answer as those of rclcpp, for live parameters."""

from math import inf
from typing import Literal

import msgspec
import pytest
from harness import load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.config.scenario import scenario_with
from mecazen.errors import BusError, ConfigError
from mecazen.parameters import described, parameters, settings_of
from mecazen.runtime.live import LiveParameters
from mecazen.schema import AngleDeg, Live, Positive, Section
from mecazen_ros import cdr
from mecazen_ros.interfaces import message
from mecazen_ros.parameters import PARAMETER_SERVICES, NodeParameters

Value, Parameter = message("ParameterValue"), message("Parameter")
REQUEST = {one.kind.rpartition("/")[2]: one.interface.request for one in PARAMETER_SERVICES}
BOOL, INTEGER, DOUBLE, STRING, STRINGS = 1, 2, 3, 4, 9
"""Values of rcl_interfaces/msg/ParameterType."""


class Gains(Section):
    kp: Live[Positive] = 2.0
    order: Live[tuple[str, ...]] = ("a", "b")


class Mine(Section):
    reach_m: Live[Positive] = 0.5
    count: Live[int] = 3
    most: Live[float] = inf
    bearing_deg: Live[AngleDeg | None] = None
    heading_deg: Live[AngleDeg | None] = None
    side: Live[Literal["left", "right"]] = "left"
    turns: Live[bool] = True
    gains: Gains = Gains()
    fixed: int = 3

    def __post_init__(self):
        if (self.bearing_deg is None) != (self.heading_deg is None):
            raise ValueError("bearing_deg and heading_deg must be given together")


NAMES = ("use_sim_time", "reach_m", "count", "most", "bearing_deg", "heading_deg", "side", "turns")
NAMES += ("gains.kp", "gains.order")


class Node:
    """The parameters of a node, and the changes of the simulation that has it."""

    def __init__(self, robot="", *robots):
        own = [{"name": name, "start": {"y_m": 2.0 * n}} for n, name in enumerate(robots)]
        tables = {"robot": load_robot(), "services": ("physics", "mine"), "robots": own}
        scenario = msgspec.convert(msgspec.to_builtins(tables), scenario_with(mine=Mine))
        self.live = LiveParameters(scenario, lambda *_: None)
        self.parameters = NodeParameters("mine", robot, self._ask)

    def _ask(self, call, request):
        if call is keys.GET_PARAMETERS:
            known = parameters(self.live.requested).items()
            return m.ParameterDescriptors(tuple(described(*one) for one in known))
        try:
            self.live.set(settings_of(request))
        except ConfigError as error:
            raise BusError(f"{call.key}: {error}") from None
        return m.Parameters()

    def value(self, name):
        (found,) = self.parameters.get_parameters(REQUEST["GetParameters"]((name,)))["values"]
        return found

    def set(self, **values):
        """Set each by itself; return what was refused, and why."""
        request = REQUEST["SetParameters"](tuple(parameter(*one) for one in values.items()))
        request = cdr.decode(cdr.encode(request), type(request))
        return [
            one.reason
            for one in self.parameters.set_parameters(request)["results"]
            if not one.successful
        ]

    def set_together(self, **values):
        request = REQUEST["SetParameters"](tuple(parameter(*one) for one in values.items()))
        return self.parameters.set_parameters_atomically(request)["result"]


def parameter(name, value):
    """Return a parameter as ROS's clients say it."""
    numbers = {bool: BOOL, int: INTEGER, float: DOUBLE, str: STRING, tuple: STRINGS}
    if value is None:
        return Parameter(name)
    number = numbers[type(value)]
    field = Value.__struct_fields__[number]
    return Parameter(name, Value(number, **{field: value}))


def test_a_nodes_parameters_have_their_names_without_the_sections():
    listed = Node().parameters.list_parameters(REQUEST["ListParameters"]())["result"]
    assert listed == message("ListParametersResult")(NAMES, ("gains",))


@pytest.mark.parametrize(
    ("prefixes", "depth", "names"),
    [
        (("gains",), 0, ("gains.kp", "gains.order")),
        (("gains", "side"), 1, ("side", "gains.kp", "gains.order")),
        (("gain", "gains.kp.x"), 0, ()),
        ((), 1, NAMES[:-2]),
        ((), 2, NAMES),
    ],
)
def test_a_list_is_of_what_is_below_prefixes_to_a_depth(prefixes, depth, names):
    request = REQUEST["ListParameters"](prefixes, depth)
    assert Node().parameters.list_parameters(request)["result"].names == names


def test_values_have_the_types_of_ros():
    values = {
        "use_sim_time": True,
        "reach_m": 0.5,
        "count": 3,
        "most": inf,
        "bearing_deg": None,
        "side": "left",
        "turns": True,
        "gains.order": ("a", "b"),
        "fixed": None,
    }
    request = REQUEST["GetParameters"](tuple(values))
    expected = tuple(parameter(*one).value for one in values.items())
    assert Node().parameters.get_parameters(request)["values"] == expected
    types = [BOOL, DOUBLE, INTEGER, DOUBLE, 0, STRING, BOOL, STRINGS, 0]
    assert [*Node().parameters.get_parameter_types(request)["types"]] == types


def test_a_descriptor_says_unit_and_range_and_what_is_read_only():
    request = REQUEST["GetParameters"](("reach_m", "bearing_deg", "use_sim_time", "fixed"))
    reach, bearing, time, fixed = Node().parameters.describe_parameters(request)["descriptors"]
    assert (reach.type, reach.description) == (DOUBLE, "in m")
    assert reach.floating_point_range == (message("FloatingPointRange")(0.0, 1e9),)
    assert reach.additional_constraints == "a number > 0 and <= 1000000000"
    assert (bearing.type, bearing.description) == (DOUBLE, "in °")
    assert bearing.floating_point_range == (message("FloatingPointRange")(-360.0, 360.0),)
    assert (reach.read_only, time.read_only) == (False, True)
    assert fixed == message("ParameterDescriptor")("fixed")


@pytest.mark.parametrize(
    ("limits", "shown"), [((1.0, 5.0), (message("IntegerRange")(1, 5),)), ((0.0, 2.0**63), ())]
)
def test_a_descriptor_of_a_whole_number_has_its_range_if_ros_can_say_it(limits, shown):
    answer = m.ParameterDescriptor("mine.n", "2", "integer", range=limits)
    node = NodeParameters("mine", "", lambda *_: m.ParameterDescriptors((answer,)))
    (described_,) = node.describe_parameters(REQUEST["GetParameters"](("n",)))["descriptors"]
    assert (described_.type, described_.integer_range) == (INTEGER, shown)
    assert not described_.floating_point_range


@pytest.mark.parametrize(
    ("text", "kind", "number", "value"),
    [
        ("2", "float", DOUBLE, 2.0),
        ("2", "string", INTEGER, 2),  # Literal[1, 2]
        (f"{2**63}", "integer", STRING, f"{2**63}"),
        ("[]", "list", STRINGS, ()),
        ("[true]", "list", 6, (True,)),
        ("[1, 2]", "list", 7, (1, 2)),
        ("[1, 2.5]", "list", 8, (1.0, 2.5)),
        ('[1, "a"]', "list", STRING, '[1, "a"]'),
        ("[[1]]", "list", STRING, "[[1]]"),
        (f"[{2**63}]", "list", STRING, f"[{2**63}]"),
        ("{a = 1}", "string", STRING, "{a = 1}"),
    ],
)
def test_what_ros_has_no_type_for_is_a_text(text, kind, number, value):
    answer = m.ParameterDescriptors((m.ParameterDescriptor("mine.n", text, kind),))
    node = NodeParameters("mine", "", lambda *_: answer)
    (service,) = (one for one in PARAMETER_SERVICES if one.name == "get_parameters")
    response = service.interface.response(**service.ask(node, service.interface.request(("n",))))
    (got,) = cdr.decode(cdr.encode(response), type(response)).values
    assert got.type == number
    assert getattr(got, Value.__struct_fields__[number]) == value


def test_each_is_set_by_itself_and_a_refusal_has_the_reason():
    node = Node()
    # `ros2 param set … reach_m 2` sends a whole number
    wrong = node.set(reach_m=2, side="up", count=4, turns=1, most=inf, reached_m=1.0, fixed=4)
    assert wrong == [
        "side: got 'up'; allowed: 'left' or 'right'",
        "turns: got 1; allowed: true or false",
        "reached_m: no such parameter; did you mean reach_m?",
        "fixed: can't change while it runs: its value at the start counts",
    ]
    assert node.value("reach_m") == Value(DOUBLE, double_value=2.0)
    assert node.value("count") == Value(INTEGER, integer_value=4)
    assert node.value("turns") == Value(BOOL, bool_value=True)
    assert not node.set(**{"gains.order": ("b",)})
    assert node.value("gains.order").string_array_value == ("b",)


@pytest.mark.parametrize("value", ["0.7", "", (), True, float("nan"), -inf, None, ("1",)])
def test_a_value_of_another_type_or_out_of_its_range_is_refused(value):
    node = Node()
    (reason,) = node.set(reach_m=value)
    assert reason.startswith("reach_m: got ")
    assert node.value("reach_m").double_value == 0.5


def test_bytes_and_types_that_ros_does_not_have_are_refused():
    for value in (Value(5, byte_array_value=b"1"), Value(10)):
        request = REQUEST["SetParameters"]((Parameter("reach_m", value),))
        (result,) = Node().parameters.set_parameters(request)["results"]
        assert not result.successful
        assert result.reason.startswith("reach_m: got [49]") or result.reason == (
            "reach_m: there is no type 10"
        )


def test_what_only_goes_together_is_set_atomically_or_not_at_all():
    node = Node()
    assert len(node.set(bearing_deg=1.0, heading_deg=2.0)) == 2
    assert node.set_together(bearing_deg=1.0, heading_deg=2.0).successful
    refused = node.set_together(reach_m=2.0, side="up")
    assert refused.reason == "side: got 'up'; allowed: 'left' or 'right'"
    assert node.value("reach_m").double_value == 0.5
    assert node.set_together(bearing_deg=None, heading_deg=None).successful
    assert node.value("bearing_deg") == Value()


def test_simulated_time_can_not_be_left():
    reasons = Node().set(use_sim_time=False)
    assert reasons == ["use_sim_time is read-only: all nodes follow simulated time"]


def test_a_node_of_one_of_several_robots_sets_its_own():
    node = Node("two", "one", "two")
    assert node.parameters.list_parameters(REQUEST["ListParameters"]())["result"].names == NAMES
    assert not node.set(reach_m=2.0)
    found = parameters(node.live.requested)
    assert found["robots.two.mine.reach_m"].value == 2.0
    assert found["robots.one.mine.reach_m"].value == 0.5
