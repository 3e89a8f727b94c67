"""ROS services ask mecazen's own queries, and their responses say how it went."""

import pytest
from mecazen import keys
from mecazen import messages as m
from mecazen.errors import RefusedError
from mecazen_ros.interfaces import message
from mecazen_ros.services import FAILED, OK, SERVICES, UNSUPPORTED

SERVICE = {service.name: service for service in SERVICES}
STATE = message("SimulationState")


def request(service, *fields):
    return service.interface.request(*fields)


def test_a_trigger_says_whether_it_was_done():
    reset = SERVICE["sim/reset"]
    response = reset.interface.response
    assert reset.ask(None) == (keys.SIM_RESET, m.ResetRequest())
    assert reset.respond(OK, "", m.SimState(tick=7)) == response(True, "tick 7")
    assert reset.respond(OK, "", m.String("4 wheels turn")) == response(True, "4 wheels turn")
    assert reset.respond(FAILED, "busy") == response(False, "busy")


def test_the_standard_services_ask_mecazens_own():
    step = SERVICE["step_simulation"]
    assert step.ask(request(step, 5)) == (keys.SIM_STEP, m.StepRequest(5))
    assert step.respond(OK, "", m.SimState()).result.result == OK
    assert step.respond(FAILED, "not paused").result == message("Result")(FAILED, "not paused")
    set_state = SERVICE["set_simulation_state"]
    for state, call in ((1, keys.SIM_RESUME), (2, keys.SIM_PAUSE)):
        assert set_state.ask(request(set_state, STATE(state)))[0] is call
    get_state = SERVICE["get_simulation_state"]
    told = [get_state.respond(OK, "", m.SimState(paused=p)).state.state for p in (False, True)]
    assert told == [1, 2]
    assert get_state.respond(UNSUPPORTED, "no").result.result == UNSUPPORTED


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("step_simulation", 0),
        ("step_simulation", 10**9 + 1),
        ("reset_simulation", 1),
        ("set_simulation_state", STATE(0)),
    ],
)
def test_what_the_simulation_cant_do_is_refused(name, asked):
    with pytest.raises(RefusedError):
        SERVICE[name].ask(request(SERVICE[name], asked))
