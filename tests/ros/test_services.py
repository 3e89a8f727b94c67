"""The parameter services of a ROS node answer as those of rclcpp, for live parameters."""

from harness import SCENARIOS
from mecazen import keys
from mecazen import messages as m
from mecazen.errors import BusError, ConfigError
from mecazen.loading import load_scenario
from mecazen.parameters import LiveParameters, described, parameters, settings_of
from mecazen_ros import cdr
from mecazen_ros.services import OF_NODE, NodeParameters
from mecazen_ros.types import message

Value = message("rcl_interfaces/msg/ParameterValue")
Parameter = message("rcl_interfaces/msg/Parameter")
SERVICE = {service.name: service for service in OF_NODE}
BOOL, INTEGER, DOUBLE, STRING = 1, 2, 3, 4
"""Values of rcl_interfaces/msg/ParameterType."""


class Simulation:
    """The parameters of a scenario, and those of one of its nodes."""

    def __init__(self, scenario="back", node="follower", robot=""):
        self.live = LiveParameters(load_scenario(SCENARIOS / f"{scenario}.toml"), lambda _: None)
        self.node = NodeParameters(node, robot, self.ask)

    def ask(self, call, request):
        if call is keys.GET_PARAMETERS:
            live = parameters(self.live.requested).items()
            return m.ParameterDescriptors(tuple(described(*parameter) for parameter in live))
        try:
            self.live.set(settings_of(request))
        except ConfigError as error:
            raise BusError(f"{call.key}: {error}") from None
        return m.Parameters()

    def values(self, *names):
        return called(self.node, "get_parameters", names).values

    def set(self, name="set_parameters", **values):
        """Return the reasons of refusals."""
        response = called(self.node, name, tuple(Parameter(*item) for item in values.items()))
        results = response.results if name == "set_parameters" else [response.result]
        return [result.reason for result in results if not result.successful]


def called(node, name, *fields):
    """Return a service's response after both messages have been in CDR."""
    service = SERVICE[name]
    request = cdr.decode(cdr.encode(service.request(*fields)), service.request)
    response = service.response(**service.ask(node, request))
    return cdr.decode(cdr.encode(response), service.response)


def double(value):
    return Value(DOUBLE, double_value=value)


def test_values_and_descriptors_have_the_types_of_ros():
    node = Simulation().node
    names = "use_sim_time", "standoff_m", "bearing_deg", "view", "unknown"
    types = [BOOL, DOUBLE, 0, STRING, 0]
    assert [*called(node, "get_parameter_types", names).types] == types
    time, standoff, bearing, *_ = called(node, "describe_parameters", names).descriptors
    assert (time.read_only, standoff.read_only, standoff.description) == (True, False, "in m")
    assert (standoff.floating_point_range[0].to_value, bearing.type) == (100.0, DOUBLE)
    assert standoff.additional_constraints == "a number > 0 and <= 100"


def test_parameters_are_set_one_by_one_or_atomically():
    simulation, atomically = Simulation(), "set_parameters_atomically"
    reasons = simulation.set(
        standoff_m=Value(INTEGER, integer_value=2),  # as `ros2 param set … standoff_m 2` sends it
        standof_m=double(1.0),
        use_sim_time=Value(BOOL),
        bearing_deg=Value(10),
    )
    assert reasons == [
        "standof_m: no such parameter; did you mean standoff_m?",
        "use_sim_time is read-only: all nodes follow simulated time",
        "bearing_deg: there is no type 10",
    ]
    assert simulation.values("standoff_m") == (double(2.0),)
    both = {"bearing_deg": double(1.0), "heading_deg": double(2.0)}
    assert len(simulation.set(**both)) == 2  # neither is allowed without the other
    assert not simulation.set(atomically, **both)
    assert simulation.set(atomically, standoff_m=double(3.0), view=Value(STRING))
    assert simulation.values("standoff_m", "bearing_deg") == (double(2.0), double(1.0))
    assert not simulation.set(atomically, bearing_deg=Value(), heading_deg=Value())
    assert simulation.values("bearing_deg") == (Value(),)


def test_a_node_of_one_of_several_robots_sets_its_own():
    scenario = load_scenario(SCENARIOS / "convoy.toml")
    first, second, *_ = scenario.names
    simulation = Simulation("convoy", robot=second)
    assert not simulation.set(standoff_m=double(2.5))
    live = parameters(simulation.live.requested)
    assert live[f"robots.{second}.follower.standoff_m"].value == 2.5
    assert live[f"robots.{first}.follower.standoff_m"].value != 2.5
