"""Queries over Zenoh: which are answered, what is refused, and what the asker is told."""

import queue
import threading
from types import SimpleNamespace

import pytest
import zenoh
from harness import error_of
from mecazen import keys
from mecazen.bus.queries import QueryInbox
from mecazen.bus.session import open_session
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.messages import Empty, SimState, StepRequest
from mecazen.wire import (
    MAX_ENVELOPE_BYTES,
    MAX_SAMPLE_BYTES,
)


class BadRequest(Empty):
    ticks: str = "many"


class BadAnswer(Empty):
    tick: str = "many"


@pytest.fixture
def served(open_bus, router):
    """A bus that answers what simulated time does and resets it, and a stranger's session."""
    bus, resets = open_bus(namespace="strange"), []
    bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(SimState(tick=7)))
    bus.serve(keys.SIM_RESET, lambda _, reply: (resets.append(1), reply.answer(SimState())))
    bus.serve_files("robot_description", {"a.stl": b"mesh"})
    with open_session(BusConfig(connect=(router,), namespace="strange"), "client") as session:

        def ask(expression, count=1, **sent):
            channels = [
                session.get(expression, handler=zenoh.handlers.FifoChannel(16), **sent)
                for _ in range(count)
            ]
            # the last is answered at once where it is one too many: then all have come
            replies = [channels[-1].recv()] if count > 100 else []
            for channel in channels:
                while True:
                    bus.drain()
                    try:
                        reply = channel.try_recv()
                    except zenoh.ZError:  # no more will come
                        break
                    if reply is not None:
                        replies.append(reply)
            return replies

        while not ask("sim/state"):  # nobody answers as long as the session knows of nobody
            pass
        yield bus, resets, ask


def errors_in(replies):
    return [reply.err.payload.to_string() for reply in replies if reply.err is not None]


@pytest.mark.parametrize("expression", ["**", "sim/*", "*/reset"])
def test_a_query_on_an_expression_changes_nothing_and_is_answered_by_what_only_tells(
    served, expression
):
    bus, resets, ask = served
    replies = ask(expression)
    assert not resets
    asked = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
    told = {"sim/state", "robot_description/a.stl"} if expression == "**" else {"sim/state"}
    assert asked == (told if expression in {"**", "sim/*"} else set())
    assert errors_in(replies) == ["asked on another key expression"]
    assert bus.refused["sim/reset"] == 1
    assert ask("sim/reset")[0].ok is not None
    assert resets == [1]


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        ({"payload": bytes(MAX_SAMPLE_BYTES + 1)}, f"payload of more than {MAX_SAMPLE_BYTES}"),
        ({"attachment": bytes(MAX_ENVELOPE_BYTES)}, "key and attachment of more"),
    ],
)
def test_an_oversize_query_is_refused_unread(served, sent, reason):
    _, resets, ask = served
    (error,) = errors_in(ask("sim/reset", **{"payload": b"", **sent}))
    assert error.startswith(reason)
    assert not resets


@pytest.mark.parametrize("key", ["robot_description/a.stl", "sim/state"])
def test_of_a_flood_of_queries_those_beyond_a_hundred_are_told_so(served, key):
    bus, _, ask = served
    replies = ask(key, 150)
    assert errors_in(replies) == ["100 queries wait"] * 50
    assert len([reply for reply in replies if reply.ok is not None]) == 100
    assert bus.refused[key.removesuffix("/a.stl")] == 50


def test_while_a_refusal_waits_for_room_on_a_link_the_next_query_is_received():
    ready, held = queue.SimpleQueue(), threading.Event()
    asked = SimpleNamespace(key_expr="**")
    inbox = QueryInbox(ready, "sim/reset", print, lambda *_: held.wait())
    inbox.receive(asked)  # to be refused: it would not return if this thread did that
    inbox.receive(SimpleNamespace(key_expr="sim/reset", payload=b"", attachment=b"", parameters=""))
    assert ready.qsize() == 1
    held.set()


def test_a_malformed_request_is_refused_and_the_next_is_answered(zenoh_pair):
    zenoh_pair.near.serve(keys.SIM_STEP, lambda _, reply: reply.answer(SimState(tick=1)))
    broken = Call("sim/step", BadRequest, SimState, "a test", "")
    zenoh_pair.link()
    with zenoh_pair.serving():
        text = error_of(BusError, lambda: zenoh_pair.far.call(broken, BadRequest()))
        assert text.startswith("sim/step: not a mecazen_msgs/msg/StepRequest: ")
        assert zenoh_pair.far.call(keys.SIM_STEP, StepRequest()).tick == 1
    assert zenoh_pair.near.refused == {"sim/step": 1}


def test_when_an_answer_is_no_answer_expect_one_line(zenoh_pair):
    bad = Call("sim/step", StepRequest, BadAnswer, "a test", "")
    zenoh_pair.near.serve(bad, lambda _, reply: reply.answer(BadAnswer()))
    zenoh_pair.link()
    with zenoh_pair.serving():
        text = error_of(BusError, lambda: zenoh_pair.far.call(keys.SIM_STEP, StepRequest()))
    assert text.startswith("sim/step: the answer is not a mecazen_msgs/msg/SimState: ")


def test_when_no_answer_comes_in_time_expect_one_line(zenoh_pair):
    zenoh_pair.near.serve(keys.SIM_STEP, lambda *_: None)
    zenoh_pair.link()
    text = error_of(
        BusError, lambda: zenoh_pair.far.call(keys.SIM_STEP, StepRequest(), timeout_s=0.05)
    )
    assert text.startswith("sim/step: ")
