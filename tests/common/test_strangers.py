"""What a stranger sends beside good messages: queries on expressions, and too much of anything."""

import pytest
import zenoh
from harness import wait
from mecazen import keys
from mecazen.bus import base
from mecazen.bus.session import open_session
from mecazen.config import BusConfig
from mecazen.messages import SimState
from mecazen.text import printable
from mecazen.wire import MAX_ENVELOPE_BYTES, MAX_SAMPLE_BYTES


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


def test_of_a_flood_of_queries_for_files_those_beyond_a_hundred_are_told_so(served):
    bus, _, ask = served
    errors = errors_in(ask("robot_description/a.stl", 150))
    assert errors == ["100 queries wait"] * 50
    assert bus.refused["robot_description"] == 50


def test_a_long_attachment_is_refused_before_it_waits(zenoh_pair, monkeypatch):
    near, far = zenoh_pair.near, zenoh_pair.far
    heard = []
    near.subscribe(keys.CMD_VEL, lambda *_: heard.append("cmd_vel"))
    near.subscribe_bytes("of/ones/own", lambda key, *_: heard.append(key))
    zenoh_pair.link()
    monkeypatch.setattr(base, "decode_sample", None)  # none of them is decoded
    for key in ("cmd_vel", "of/ones/own"):
        far.put_bytes(key, b"{}", attachment=bytes(MAX_ENVELOPE_BYTES))
    zenoh_pair.settle()
    wait(near, lambda: near.refused.total() == 2)
    assert not heard


def test_a_sample_of_bytes_counts_with_its_key_its_encoding_and_its_attachment(zenoh_pair):
    near, far, heard = zenoh_pair.near, zenoh_pair.far, []
    most = 500 + len("of/ones/own") + len("text/plain") + 16 + 2
    for backlog in (most, most - 1):
        near.subscribe_bytes("of/ones/own", lambda *sample: heard.append(sample), backlog)
    zenoh_pair.link()
    far.put_bytes("of/ones/own", b"{}", "text/plain", bytes(16))
    zenoh_pair.settle()
    assert heard == [("of/ones/own", b"{}", "text/plain", bytes(16))]
    assert near.refused == {"of/ones/own": 1}


def test_refused_keys_are_counted_by_name_up_to_a_number(open_bus):
    bus = open_bus()
    for number in range(base.REFUSED_KEYS + 5):
        bus.refuse(f"diagnostics/{number}", "for a test")
    assert len(bus.refused) == base.REFUSED_KEYS + 1
    assert bus.refused[base.OTHER_KEYS] == 5


def test_text_keeps_its_letters_and_loses_what_moves_the_cursor():
    assert printable("[/oops] né |") == "[/oops] né |"
    assert printable("a\x1b[2Jb\n\x9bc\u202e") == "a\\u001b[2Jb\\n\\u009bc\\u202e"
