"""The ROS services of the simulation, over mecazen's own queries.

There are services of `std_srvs/srv/Trigger`, for simple clients, and of simulation_interfaces, the
standard.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from mecazen import keys
from mecazen import messages as m
from mecazen.errors import RefusedError
from mecazen.keys import Call
from mecazen.messages import Message

from mecazen_ros.interfaces import Interface, message, service

UNSUPPORTED, OK, FAILED = 0, 1, 4
"""Results of simulation_interfaces."""
PLAYING, PAUSED = 1, 2
"""States of a simulation in simulation_interfaces."""
WHOLE = (0, 255)
"""Scopes of a reset in simulation_interfaces that mean everything."""
MAX_STEPS = 10**9
TRIGGER = "std_srvs/srv/Trigger"
STATE = "simulation_interfaces/srv/GetSimulationState"

Query = tuple[Call[Any, Any], Message]
"""A query and its request."""


class Service(NamedTuple):
    """A ROS service of the node that answers the query `call`, or of each node."""

    name: str
    kind: str
    call: Call[Any, Any]
    """The query that a client must be allowed to make."""
    ask: Callable[..., Any]
    """Returns the query for a request, or raises RefusedError; for services on the parameters of a
    node, returns the fields of the response."""

    @property
    def interface(self) -> Interface:
        """The messages of the service."""
        return service(self.kind)

    def respond(self, result: int, reason: str, answer: Any = None) -> Any:
        """Return the response: a result of simulation_interfaces, and the reason of a refusal."""
        response = self.interface.response
        if self.kind == TRIGGER:
            if isinstance(answer, m.String):
                reason = answer.data
            elif answer is not None:
                reason = f"tick {answer.tick}"
            return response(success=result == OK, message=reason)
        fields = {"result": message("Result")(result, reason)}
        if self.kind == STATE and answer is not None:
            fields["state"] = message("SimulationState")(PAUSED if answer.paused else PLAYING)
        return response(**fields)


def _reset(request: Any) -> Query:
    if request.scope not in WHOLE:
        raise RefusedError("only all of it can be reset: scope 0 or 255")
    return keys.SIM_RESET, m.ResetRequest()


def _step(request: Any) -> Query:
    if not 1 <= request.steps <= MAX_STEPS:
        raise RefusedError(f"{request.steps} steps: from 1 to {MAX_STEPS} are allowed")
    return keys.SIM_STEP, m.StepRequest(ticks=request.steps)


def _set(request: Any) -> Query:
    calls = {PLAYING: keys.SIM_RESUME, PAUSED: keys.SIM_PAUSE}
    if request.state.state not in calls:
        raise RefusedError(f"state {request.state.state}: only 1 (playing) and 2 (paused)")
    return calls[request.state.state], m.Empty()


def _trigger(call: Call[Any, Any]) -> Service:
    return Service(call.key, TRIGGER, call, lambda _: (call, call.request()))


def kind(package: str, name: str) -> str:
    """Return the type of a service that is named after its type."""
    return f"{package}/srv/{name.title().replace('_', '')}"


def _standard(name: str, call: Call[Any, m.SimState], ask: Callable[[Any], Query]) -> Service:
    return Service(name, kind("simulation_interfaces", name), call, ask)


SERVICES: tuple[Service, ...] = (
    _trigger(keys.SIM_RESET),
    _trigger(keys.SIM_PAUSE),
    _trigger(keys.SIM_RESUME),
    _trigger(keys.STOP_MOTORS),
    _trigger(keys.RELEASE_MOTORS),
    _standard("reset_simulation", keys.SIM_RESET, _reset),
    _standard("step_simulation", keys.SIM_STEP, _step),
    _standard("set_simulation_state", keys.SIM_PAUSE, _set),
    _standard("get_simulation_state", keys.SIM_STATE, lambda _: (keys.SIM_STATE, m.Empty())),
)
