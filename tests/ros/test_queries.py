"""Requests of ROS services: answered by queries, or by the parameters of a node."""

from types import SimpleNamespace

import pytest
from mecazen import keys
from mecazen.errors import RefusedError
from mecazen.messages import SimState
from mecazen_ros import cdr
from mecazen_ros.protocol import Attachment
from mecazen_ros.queries import attached, attachment_of, by_parameters, by_query
from mecazen_ros.services import FAILED, OK, SERVICES, UNSUPPORTED

STEP = next(service for service in SERVICES if service.name == "step_simulation")


class Process:
    """Answers a query, or refuses it for a reason."""

    def __init__(self, reason=""):
        self.reason = reason
        self.asked = []

    def ask(self, call, request, reply):
        self.asked.append((call, request.ticks))
        if self.reason:
            reply.refuse(self.reason)
        else:
            reply.answer(SimState(tick=request.ticks))


@pytest.mark.parametrize(
    ("steps", "reason", "asked", "result"),
    [
        (5, "", [(keys.SIM_STEP, 5)], (OK, "")),
        (5, "not paused", [(keys.SIM_STEP, 5)], (FAILED, "not paused")),
        (0, "", [], (UNSUPPORTED, "0 steps: from 1 to 1000000000 are allowed")),
    ],
)
def test_a_request_is_asked_as_a_query_and_a_refusal_is_a_response(steps, reason, asked, result):
    process, given = Process(reason), []
    by_query(STEP, process)(cdr.encode(STEP.interface.request(steps)), given.append)
    assert process.asked == asked
    (response,) = given
    assert (response.result.result, response.result.error_message) == result


def test_bytes_that_are_no_request_are_told_so():
    process, given = Process(), []
    by_query(STEP, process)(b"\x00", given.append)
    assert given[0].result.result == UNSUPPORTED
    assert not process.asked


def test_a_service_for_parameters_gets_the_request_or_none_where_it_is_malformed():
    got, given = [], []
    service = SimpleNamespace(
        interface=STEP.interface, respond=lambda _, request: got.append(request) or "response"
    )
    respond = by_parameters(service, None)
    for payload in (cdr.encode(STEP.interface.request(3)), b"\x00"):
        respond(payload, given.append)
    assert got == [STEP.interface.request(3), None]
    assert given == ["response", "response"]


def test_an_attachment_comes_back_with_its_number_and_identity():
    gid = bytes(range(16))
    came = SimpleNamespace(attachment=SimpleNamespace(to_bytes=lambda: attachment_of(7, gid)))
    found = attached(came)
    assert isinstance(found, Attachment)
    assert (found.sequence, found.gid) == (7, gid)
    with pytest.raises(RefusedError):
        attached(SimpleNamespace(attachment=None))
