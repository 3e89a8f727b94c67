"""ROS services, over mecazen's own queries: of the simulation, and of the parameters of each node.

The simulation has services of `std_srvs/srv/Trigger`, for simple clients, and of
simulation_interfaces, the standard. A node has the parameters of its service's section, named
without the section, and `use_sim_time`. The owner of time answers for all nodes, since it owns the
changes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from mecazen import keys
from mecazen import messages as m
from mecazen.bus.base import Reply
from mecazen.errors import BusError, RefusedError
from mecazen.files import parse_value
from mecazen.keys import Call
from mecazen.messages import Message
from mecazen.parameters import ROBOTS, to_message

from mecazen_ros.types import message

UNSUPPORTED, OK, FAILED = 0, 1, 4
PLAYING, PAUSED = 1, 2
"""Results and states of simulation_interfaces."""
MAX_STEPS = 10**9
TRIGGER = "std_srvs/srv/Trigger"
Result = message("simulation_interfaces/msg/Result")
SimulationState = message("simulation_interfaces/msg/SimulationState")

USE_SIM_TIME = "use_sim_time"
SIM_TIME = m.ParameterDescriptor(USE_SIM_TIME, "true", "bool", allowed="true")
NOT_SET = m.ParameterDescriptor()
STRING, STRINGS = 4, 9
NUMBERS = {"bool": 1, "integer": 2, "float": 3, "string": STRING, "list": STRINGS}
"""Numbers of types in ROS."""
ParameterValue = message("rcl_interfaces/msg/ParameterValue")
SetParametersResult = message("rcl_interfaces/msg/SetParametersResult")
FIELDS = ParameterValue.__struct_fields__
"""Fields of a value, by the number of its type."""

Query = tuple[Call[Any, Any], Message]
Respond = Callable[[Message], None]
"""Sends the response to a request."""


class RosService(NamedTuple):
    """A ROS service of the node that answers the query `call`, or of each node."""

    name: str
    package: str
    call: Call[Any, Any]
    """The query that a client must be allowed to make."""
    ask: Callable[..., Any]
    """Returns the query for a request, or raises RefusedError; for services of `NodeParameters`,
    the fields of the response."""

    @property
    def kind(self) -> str:
        """The type, after which the service is named, except triggers."""
        if self.package == "std_srvs":
            return TRIGGER
        return f"{self.package}/srv/{self.name.title().replace('_', '')}"

    @property
    def request(self) -> Any:
        return message(f"{self.kind}_Request")

    @property
    def response(self) -> Any:
        return message(f"{self.kind}_Response")

    def respond(self, result: int, reason: str, answer: Any = None) -> Any:
        """Return the response: a result of simulation_interfaces, and the reason of a refusal."""
        if self.kind == TRIGGER:
            if answer is not None:
                reason = answer.data if isinstance(answer, m.String) else f"tick {answer.tick}"
            return self.response(success=result == OK, message=reason)
        if self in OF_NODE:  # the responses have no field for a malformed request
            return self.response()
        fields = {"result": Result(result, reason)}
        if self.call is keys.SIM_STATE and answer is not None:
            fields["state"] = SimulationState(PAUSED if answer.paused else PLAYING)
        return self.response(**fields)

    def reply(self, respond: Respond) -> Reply[Any]:
        """Return the reply to a query that sends the response to a request.

        ROS clients do not react to an error of Zenoh, so a refusal is a response as well.
        """
        return Reply(
            lambda answer: respond(self.respond(OK, "", answer)),
            lambda reason: respond(self.respond(FAILED, reason)),
        )


def _same(call: Call[Any, Any]) -> Callable[[Any], Query]:
    return lambda _: (call, call.request())


def _reset(request: Any) -> Query:
    if request.scope not in (0, 255):  # by default, and all
        raise RefusedError("only all of it can be reset: scope 0 or 255")
    return keys.SIM_RESET, m.ResetRequest()


def _step(request: Any) -> Query:
    if not 1 <= request.steps <= MAX_STEPS:
        raise RefusedError(f"{request.steps} steps: from 1 to {MAX_STEPS} are allowed")
    return keys.SIM_STEP, m.StepRequest(ticks=request.steps)


def _set_state(request: Any) -> Query:
    calls = {PLAYING: keys.SIM_RESUME, PAUSED: keys.SIM_PAUSE}
    if request.state.state not in calls:
        raise RefusedError(f"state {request.state.state}: only 1 (playing) and 2 (paused)")
    return calls[request.state.state], m.Empty()


TRIGGERS = keys.SIM_RESET, keys.SIM_PAUSE, keys.SIM_RESUME, keys.STOP_MOTORS, keys.RELEASE_MOTORS
INTERFACES = "simulation_interfaces"
OF_SIMULATION = (
    *(RosService(call.key, "std_srvs", call, _same(call)) for call in TRIGGERS),
    RosService("reset_simulation", INTERFACES, keys.SIM_RESET, _reset),
    RosService("step_simulation", INTERFACES, keys.SIM_STEP, _step),
    RosService("set_simulation_state", INTERFACES, keys.SIM_PAUSE, _set_state),
    RosService("get_simulation_state", INTERFACES, keys.SIM_STATE, _same(keys.SIM_STATE)),
)


class NodeParameters:
    """The parameters of one ROS node, with those of its robot, if there are several.

    `ask` queries the owner of time; a refusal is a BusError.
    """

    def __init__(self, service: str, robot: str, ask: Callable[[Call[Any, Any], Any], Any]) -> None:
        self._prefixes = [f"{service}."]
        if robot:
            self._prefixes.append(f"{ROBOTS}.{robot}.{service}.")
        self._ask = ask

    def list_parameters(self, request: Any) -> dict[str, Any]:
        """Return the names below the requested prefixes, to the requested depth."""
        names = tuple(name for name in self._descriptors() if _is_listed(name, request))
        prefixes = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
        result = message("rcl_interfaces/msg/ListParametersResult")
        return {"result": result(names, tuple(prefixes))}

    def get_parameters(self, request: Any) -> dict[str, Any]:
        """Return values; unknown names and settings that are left out have type 0, not set."""
        return {"values": tuple(map(_value, self._named(request)))}

    def get_parameter_types(self, request: Any) -> dict[str, Any]:
        return {"types": bytes(_value(parameter).type for parameter in self._named(request))}

    def describe_parameters(self, request: Any) -> dict[str, Any]:
        return {"descriptors": tuple(map(_descriptor, request.names, self._named(request)))}

    def set_parameters(self, request: Any) -> dict[str, Any]:
        return {"results": tuple(self._set([parameter]) for parameter in request.parameters)}

    def set_parameters_atomically(self, request: Any) -> dict[str, Any]:
        return {"result": self._set(request.parameters)}

    def _descriptors(self) -> dict[str, m.ParameterDescriptor]:
        parameters = self._ask(keys.GET_PARAMETERS, m.ParameterNames()).parameters
        return {USE_SIM_TIME: SIM_TIME} | {
            parameter.name.removeprefix(prefix): parameter
            for prefix in self._prefixes
            for parameter in parameters
            if parameter.name.startswith(prefix)
        }

    def _named(self, request: Any) -> Sequence[m.ParameterDescriptor]:
        descriptors = self._descriptors()
        return [descriptors.get(name, NOT_SET) for name in request.names]

    def _set(self, parameters: Sequence[Any]) -> Any:
        descriptors, call = self._descriptors(), keys.SET_PARAMETERS
        try:
            settings = {self._key(new.name, descriptors): _set_value(new) for new in parameters}
            self._ask(call, m.Parameters(parameters=to_message(settings)))
        except (RefusedError, BusError) as error:
            reason = str(error).removeprefix(f"{call.key}: ")
            prefixes = "|".join(map(re.escape, self._prefixes))
            reason = re.sub(rf"(^|did you mean )({prefixes})", r"\1", reason)
            return SetParametersResult(False, reason)
        return SetParametersResult(True)

    def _key(self, name: str, descriptors: Mapping[str, m.ParameterDescriptor]) -> str:
        if name == USE_SIM_TIME:
            raise RefusedError(f"{name} is read-only: all nodes follow simulated time")
        return descriptors[name].name if name in descriptors else self._prefixes[0] + name


def _is_listed(name: str, request: Any) -> bool:
    """Return whether a request for a list includes a name, as in rclcpp; a depth of 0 is any."""
    starts = [f"{prefix}." for prefix in request.prefixes] or [""]
    return name in request.prefixes or any(
        not request.depth or name.removeprefix(start).count(".") < request.depth
        for start in starts
        if name.startswith(start)
    )


def _value(parameter: m.ParameterDescriptor) -> Any:
    """Return a parameter's value; as text in TOML if it is of another type."""
    if not parameter.value:
        return ParameterValue()
    value = parse_value(parameter.value)
    if isinstance(value, bool):
        return ParameterValue(NUMBERS["bool"], bool_value=value)
    if parameter.type == "float":
        return ParameterValue(NUMBERS["float"], double_value=float(value))
    if isinstance(value, int) and abs(value) < 2**63:
        return ParameterValue(NUMBERS["integer"], integer_value=value)
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return ParameterValue(STRINGS, string_array_value=tuple(value))
    text = value if isinstance(value, str) else parameter.value
    return ParameterValue(STRING, string_value=text)


def _set_value(parameter: Any) -> Any:
    """Return the value of a parameter; None if it is not set, which leaves the setting out."""
    number = parameter.value.type
    if not number:
        return None
    if number >= len(FIELDS):
        raise RefusedError(f"{parameter.name}: there is no type {number}")
    value = getattr(parameter.value, FIELDS[number])
    return [*value] if isinstance(value, tuple | bytes) else value


def _descriptor(name: str, parameter: m.ParameterDescriptor) -> Any:
    limits: dict[str, Any] = {}
    if parameter.range and parameter.type == "float":
        floats = message("rcl_interfaces/msg/FloatingPointRange")
        limits["floating_point_range"] = (floats(*parameter.range),)
    elif parameter.range and max(map(abs, parameter.range)) < 2.0**63:
        integers = message("rcl_interfaces/msg/IntegerRange")
        limits["integer_range"] = (integers(*map(int, parameter.range)),)
    return message("rcl_interfaces/msg/ParameterDescriptor")(
        name=name,
        type=_value(parameter).type or NUMBERS.get(parameter.type, 0),
        description=f"in {parameter.unit}" if parameter.unit else "",
        additional_constraints=parameter.allowed,
        read_only=parameter is SIM_TIME,
        **limits,
    )


def _of_node(name: str, method: Callable[..., Any]) -> RosService:
    call = keys.SET_PARAMETERS if name.startswith("set") else keys.GET_PARAMETERS
    return RosService(name, "rcl_interfaces", call, method)


OF_NODE = tuple(_of_node(*item) for item in vars(NodeParameters).items() if item[0][0] != "_")
"""Services of every node, with names relative to the node: the methods of its parameters."""
