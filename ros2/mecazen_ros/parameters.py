"""The parameters of ROS nodes: the live settings of each service, over mecazen's own queries.

A node has the parameters of its service's section, named without the section, and `use_sim_time`.
The owner of time answers for all nodes, since it owns the changes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mecazen import keys
from mecazen import messages as m
from mecazen.errors import BusError, RefusedError
from mecazen.files import parse_value
from mecazen.keys import Call
from mecazen.parameters import ROBOTS, to_message, to_text

from mecazen_ros.interfaces import message
from mecazen_ros.services import Service, kind

USE_SIM_TIME = "use_sim_time"
SIM_TIME = m.ParameterDescriptor(USE_SIM_TIME, "true", "bool", allowed="true")
NOT_SET = m.ParameterDescriptor()
NUMBERS = {"bool": 1, "integer": 2, "float": 3, "string": 4, "list": 9}
"""Numbers of types in ROS. A list that is left out counts as a list of texts."""
ITEMS = {bool: 1, int: 2, float: 3, str: 4}
ARRAYS = {1: 6, 2: 7, 3: 8, 4: 9}
"""Types of arrays by those of their items."""
Value, Result = message("ParameterValue"), message("SetParametersResult")
FIELDS = Value.__struct_fields__
"""Fields of a value, by the number of its type."""


class NodeParameters:
    """The parameters of one ROS node.

    Args:
        service: Service of the node.
        robot: Robot of the node, if there are several. Other settings apply to all robots.
        ask: Queries the owner of time; a refusal is a BusError.
    """

    def __init__(self, service: str, robot: str, ask: Callable[[Call[Any, Any], Any], Any]) -> None:
        self._prefixes = [f"{service}."]
        if robot:
            self._prefixes.append(f"{ROBOTS}.{robot}.{service}.")
        self._ask = ask

    def list_parameters(self, request: Any) -> dict[str, Any]:
        """Return the names below the requested prefixes, to the requested depth."""
        names = tuple(name for name in self._known() if _is_listed(name, request))
        prefixes = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
        return {"result": message("ListParametersResult")(names, tuple(prefixes))}

    def get_parameters(self, request: Any) -> dict[str, Any]:
        """Return values; unknown names and settings that are left out have type 0, not set."""
        return {"values": tuple(map(_value, self._of(request)))}

    def get_parameter_types(self, request: Any) -> dict[str, Any]:
        """Return the types of values; see `get_parameters`."""
        return {"types": bytes(_value(of).type for of in self._of(request))}

    def describe_parameters(self, request: Any) -> dict[str, Any]:
        """Return units and allowed values."""
        described = zip(request.names, self._of(request), strict=True)
        return {"descriptors": tuple(_descriptor(*one) for one in described)}

    def set_parameters(self, request: Any) -> dict[str, Any]:
        """Set each parameter independently of the others."""
        return {"results": tuple(self._set([one]) for one in request.parameters)}

    def set_parameters_atomically(self, request: Any) -> dict[str, Any]:
        """Set all parameters or none."""
        return {"result": self._set(request.parameters)}

    def _known(self) -> dict[str, m.ParameterDescriptor]:
        """Return the parameters by their names in the node."""
        parameters = self._ask(keys.GET_PARAMETERS, m.ParameterNames()).parameters
        known = {USE_SIM_TIME: SIM_TIME}
        for prefix in self._prefixes:
            known |= {
                one.name.removeprefix(prefix): one
                for one in parameters
                if one.name.startswith(prefix)
            }
        return known

    def _of(self, request: Any) -> Sequence[m.ParameterDescriptor]:
        known = self._known()
        return [known.get(name, NOT_SET) for name in request.names]

    def _set(self, parameters: Sequence[Any]) -> Any:
        known, call = self._known(), keys.SET_PARAMETERS
        try:
            settings = {self._key(one.name, known): _text(one) for one in parameters}
            self._ask(call, m.Parameters(parameters=to_message(settings)))
        except (RefusedError, BusError) as error:
            return Result(False, self._named(str(error).removeprefix(f"{call.key}: ")))
        return Result(True)

    def _named(self, problem: str) -> str:
        """Return an error of the simulation with the names of the node's parameters."""
        own = "|".join(map(re.escape, self._prefixes))
        return re.sub(rf"(^|did you mean )({own})", r"\1", problem)

    def _key(self, name: str, known: Mapping[str, m.ParameterDescriptor]) -> str:
        if name == USE_SIM_TIME:
            raise RefusedError(f"{name} is read-only: all nodes follow simulated time")
        return known[name].name if name in known else self._prefixes[0] + name


def _is_listed(name: str, request: Any) -> bool:
    """Return whether a request for a list includes a name, as in rclcpp."""
    below = [
        name.removeprefix(f"{prefix}.")
        for prefix in request.prefixes
        if name.startswith(f"{prefix}.")
    ]
    return name in request.prefixes or any(
        not request.depth or rest.count(".") < request.depth
        for rest in (below if request.prefixes else [name])
    )


def _value(parameter: m.ParameterDescriptor) -> Any:
    """Return a parameter's value; as text in TOML if ROS has no type for it."""
    if not parameter.value:
        return Value()
    value = parse_value(parameter.value)
    if parameter.type == "float":
        value = float(value)
    if isinstance(value, list) and {type(one) for one in value} == {int, float}:
        value = [*map(float, value)]
    number = _number(value)
    if not number:
        number, value = NUMBERS["string"], parameter.value
    filled: dict[str, Any] = {FIELDS[number]: tuple(value) if isinstance(value, list) else value}
    return Value(number, **filled)


def _number(value: Any) -> int:
    """Return the number of a value's type; 0 if ROS has no such type."""
    if not isinstance(value, list):
        is_large = isinstance(value, int) and not -(2**63) <= value < 2**63
        return 0 if is_large else ITEMS.get(type(value), 0)
    of_items = {_number(one) for one in value} or {ITEMS[str]}
    (number,) = of_items if len(of_items) == 1 else (0,)
    return ARRAYS.get(number, 0)


def _text(parameter: Any) -> str:
    """Return a value in TOML; empty if it is not set, which leaves the setting out."""
    number = parameter.value.type
    if not number:
        return ""
    if number >= len(FIELDS):
        raise RefusedError(f"{parameter.name}: there is no type {number}")
    value = getattr(parameter.value, FIELDS[number])
    return to_text([*value] if isinstance(value, tuple | bytes) else value)


def _descriptor(name: str, parameter: m.ParameterDescriptor) -> Any:
    limits: dict[str, Any] = {}
    if parameter.range and parameter.type == "float":
        limits["floating_point_range"] = (message("FloatingPointRange")(*parameter.range),)
    elif parameter.range and max(map(abs, parameter.range)) < 2.0**63:
        limits["integer_range"] = (message("IntegerRange")(*map(int, parameter.range)),)
    return message("ParameterDescriptor")(
        name=name,
        type=_value(parameter).type or NUMBERS.get(parameter.type, 0),
        description=f"in {parameter.unit}" if parameter.unit else "",
        additional_constraints=parameter.allowed,
        read_only=parameter is SIM_TIME,
        **limits,
    )


_METHODS: dict[str, Call[Any, Any]] = {
    "list_parameters": keys.GET_PARAMETERS,
    "get_parameters": keys.GET_PARAMETERS,
    "get_parameter_types": keys.GET_PARAMETERS,
    "describe_parameters": keys.GET_PARAMETERS,
    "set_parameters": keys.SET_PARAMETERS,
    "set_parameters_atomically": keys.SET_PARAMETERS,
}
PARAMETER_SERVICES = tuple(
    Service(name, kind("rcl_interfaces", name), call, getattr(NodeParameters, name))
    for name, call in _METHODS.items()
)
"""Services of every node, with names relative to the node; methods of `NodeParameters` answer."""
