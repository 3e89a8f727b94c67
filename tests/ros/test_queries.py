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


@pytest.mark.parametrize(
    ("steps", "reason", "asked", "result"),
    [
        (5, "", [(keys.SIM_STEP, 5)], (OK, "")),
        (5, "not paused", [(keys.SIM_STEP, 5)], (FAILED, "not paused")),
        (0, "", [], (UNSUPPORTED, "0 steps: from 1 to 1000000000 are allowed")),
    ],
)
def test_a_request_is_asked_as_a_query_and_a_refusal_is_a_response(steps, reason, asked, result):
    made, given = [], []

    def ask(call, request, reply):
        made.append((call, request.ticks))
        if reason:
            reply.refuse(reason)
        else:
            reply.answer(SimState(tick=request.ticks))

    by_query(STEP, ask)(cdr.encode(STEP.interface.request(steps)), given.append)
    assert made == asked
    (response,) = given
    assert (response.result.result, response.result.error_message) == result


def test_bytes_that_are_no_request_are_told_so():
    given = []
    by_query(STEP, lambda *_: pytest.fail("asked"))(b"\x00", given.append)
    assert given[0].result.result == UNSUPPORTED


def test_a_malformed_request_for_parameters_gets_an_empty_response():
    given = []
    service = STEP._replace(ask=lambda parameters, request: {"result": (parameters, request.steps)})
    for payload in (cdr.encode(STEP.interface.request(3)), b"\x00"):
        by_parameters(service, "of a node")(payload, given.append)
    assert [one.result for one in given] == [("of a node", 3), STEP.interface.response().result]


def test_an_attachment_comes_back_with_its_number_and_identity():
    gid = bytes(range(16))
    came = SimpleNamespace(attachment=SimpleNamespace(to_bytes=lambda: attachment_of(7, gid)))
    found = attached(came)
    assert isinstance(found, Attachment)
    assert (found.sequence, found.gid) == (7, gid)
    with pytest.raises(RefusedError):
        attached(SimpleNamespace(attachment=None))
