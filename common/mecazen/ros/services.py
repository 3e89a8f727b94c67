"""The ROS services of the simulation, over mecazen's own queries.

`std_srvs/srv/Trigger` for who has nothing else, and simulation_interfaces, the standard.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from mecazen import keys
from mecazen import messages as m
from mecazen.keys import Call
from mecazen.messages import Message
from mecazen.ros import interfaces as i
from mecazen.wire import RefusedError

UNSUPPORTED, OK, FAILED = 0, 1, 4
"""Results of simulation_interfaces."""
PLAYING, PAUSED = 1, 2
"""Its states of a simulation."""
WHOLE = (0, 255)
"""Its scopes of a reset that mean everything."""
MOST_STEPS = 10**9

Query = tuple[Call[Any, Any], Message]
"""What is asked, and with which request."""


class Service(NamedTuple):
    """A ROS service; the node that answers the query `call` has it."""

    name: str
    kind: str
    request: type[Message]
    response: type[Message]
    call: Call[Any, Any]
    ask: Callable[[Any], Query]
    """Gives the query for a request; refuses one by RefusedError."""
    tell: Callable[[Any], Message]
    """Gives the response for the query's answer ..."""
    refuse: Callable[[str, int], Message]
    """... and for a refusal: its reason, and UNSUPPORTED or FAILED."""


def _trigger(call: Call[Any, m.SimState]) -> Service:
    return Service(
        call.key,
        "std_srvs/srv/Trigger",
        i.TriggerRequest,
        i.TriggerResponse,
        call,
        lambda _: (call, call.request()),
        lambda answer: i.TriggerResponse(success=True, message=f"tick {answer.tick}"),
        lambda reason, _: i.TriggerResponse(success=False, message=reason),
    )


def _standard(
    name: str,
    kind: str,
    request: type[Message],
    call: Call[Any, m.SimState],
    ask: Callable[[Any], Query],
) -> Service:
    return Service(
        name,
        f"simulation_interfaces/srv/{kind}",
        request,
        i.ResultResponse,
        call,
        ask,
        lambda _: i.ResultResponse(i.Result(OK)),
        lambda reason, result: i.ResultResponse(i.Result(result, reason)),
    )


def _reset(request: i.ResetSimulationRequest) -> Query:
    if request.scope not in WHOLE:
        raise RefusedError("only all of it can be reset: scope 0 or 255")
    return keys.SIM_RESET, m.ResetRequest()


def _step(request: i.StepSimulationRequest) -> Query:
    if not 1 <= request.steps <= MOST_STEPS:
        raise RefusedError(f"{request.steps} steps: from 1 to {MOST_STEPS} are allowed")
    return keys.SIM_STEP, m.StepRequest(ticks=request.steps)


def _set(request: i.SetSimulationStateRequest) -> Query:
    calls = {PLAYING: keys.SIM_RESUME, PAUSED: keys.SIM_PAUSE}
    if request.state.state not in calls:
        raise RefusedError(f"state {request.state.state}: only 1 (playing) and 2 (paused)")
    return calls[request.state.state], m.Empty()


def _state(answer: m.SimState) -> Message:
    state = i.SimulationState(PAUSED if answer.paused else PLAYING)
    return i.GetSimulationStateResponse(state, i.Result(OK))


SERVICES: tuple[Service, ...] = (
    _trigger(keys.SIM_RESET),
    _trigger(keys.SIM_PAUSE),
    _trigger(keys.SIM_RESUME),
    _standard(
        "reset_simulation", "ResetSimulation", i.ResetSimulationRequest, keys.SIM_RESET, _reset
    ),
    _standard("step_simulation", "StepSimulation", i.StepSimulationRequest, keys.SIM_STEP, _step),
    _standard(
        "set_simulation_state",
        "SetSimulationState",
        i.SetSimulationStateRequest,
        keys.SIM_PAUSE,
        _set,
    ),
    Service(
        "get_simulation_state",
        "simulation_interfaces/srv/GetSimulationState",
        i.GetSimulationStateRequest,
        i.GetSimulationStateResponse,
        keys.SIM_STATE,
        lambda _: (keys.SIM_STATE, m.Empty()),
        _state,
        lambda reason, result: i.GetSimulationStateResponse(result=i.Result(result, reason)),
    ),
)
