"""Sessions of Zenoh: where they meet, how many samples a router passes on, what is wrong."""

import secrets
import socket
from contextlib import closing

import pytest
from harness import error_of, wait
from mecazen import keys
from mecazen.bus.session import includes, open_session, session_config
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.wire import Stamp

STAMP = Stamp(0, 1, 0)


@pytest.mark.parametrize(
    ("expression", "key", "held"),
    [
        ("**", "odom", True),
        ("target/*", "target/odom", True),
        ("target/*", "target/a/b", False),
        ("odom", "odom", True),
        ("odom", "od", False),
    ],
)
def test_a_key_expression_holds_keys(expression, key, held):
    assert includes(expression, key) is held


@pytest.mark.parametrize("expression", ["", "/odom", "a//b", "o*"])
def test_what_is_no_key_expression_is_one_line(expression):
    assert "is not a key expression" in error_of(BusError, lambda: includes(expression, "odom"))


def test_when_a_routers_port_is_taken_by_another_or_by_anybody_expect_one_line(router):
    with socket.create_server(("127.0.0.1", 0)) as server:
        for endpoint in (router, f"tcp/127.0.0.1:{server.getsockname()[1]}"):
            config = BusConfig(connect=(endpoint,))
            text = error_of(BusError, lambda config=config: open_session(config, "router"))
            assert text.startswith(f"can't listen on {endpoint}: the port is taken")


def test_when_there_is_no_router_expect_a_client_to_say_so(free_port):
    config = BusConfig(connect=(f"tcp/127.0.0.1:{free_port}",))
    text = error_of(BusError, lambda: ZenohBus(config, "client"))
    assert text == f"nothing answers at tcp/127.0.0.1:{free_port}: is `mecazen up` running?"


def test_a_peer_that_is_there_before_the_router_meets_others_when_it_comes(free_port):
    config = BusConfig(connect=(f"tcp/127.0.0.1:{free_port}",))
    with closing(ZenohBus(config)) as early:
        early.declare_alive("early")
        with open_session(config, "router"), closing(ZenohBus(config)) as late:
            late.declare_alive("late")
            wait(early, lambda: "late" in early.presence.names)


@pytest.mark.parametrize("mode", ["router", "peer", "client"])
@pytest.mark.parametrize("endpoint", ["nonsense", "carrier-pigeon/127.0.0.1:1"])
def test_when_an_endpoint_is_none_expect_one_line_without_places_in_sources(mode, endpoint):
    text = error_of(BusError, lambda: open_session(BusConfig(connect=(endpoint,)), mode))
    assert ".rs" not in text
    assert "the port is taken" not in text


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("bad.json5", "{ nope", "line 1, column 1: expected "),
        ("unknown.json5", '{ modee: "peer" }', "unknown field `modee`, expected one of "),
        ("zenoh.txt", "{}", "Unsupported file type"),
    ],
)
def test_when_a_zenoh_configuration_is_wrong_expect_one_line(tmp_path, name, text, expected):
    path = tmp_path / name
    path.write_text(text)
    error = error_of(BusError, lambda: open_session(BusConfig(zenoh_config=path), "peer"))
    assert error.startswith(f"{path}: not a Zenoh configuration: {expected}")
    assert ".rs" not in error


def test_a_zenoh_configuration_file_says_where_to_meet(tmp_path, router):
    path = tmp_path / "zenoh.json5"
    path.write_text(f'{{ // where to meet\n connect: {{ endpoints: ["{router}"] }} }}')
    config = BusConfig(zenoh_config=path, namespace=f"test{secrets.token_hex(6)}")
    with closing(ZenohBus(config, "client")) as bus:
        assert bus.alive() == set()


@pytest.mark.parametrize("mode", ["router", "peer", "client"])
def test_sessions_stay_on_loopback_without_multicast_by_default(mode):
    config = session_config(BusConfig(), mode)
    assert config.get_json("scouting/multicast/enabled") == "false"
    listening = config.get_json("listen/endpoints")
    expected = {"router": "tcp/127.0.0.1:7447", "peer": "tcp/127.0.0.1:0", "client": ""}[mode]
    assert expected in listening
    assert "/[::]" not in listening


def test_a_router_takes_no_more_samples_a_second_from_each_link_than_it_is_told(free_port):
    config = BusConfig(connect=(f"tcp/127.0.0.1:{free_port}",))
    speeds, ended = [], set()
    with open_session(config, "router", most_hz=1e-3), closing(ZenohBus(config, "client")) as near:
        near.subscribe(keys.CMD_VEL, lambda twist, _: speeds.append(twist.linear.x), every=True)
        near.subscribe_bytes("end/*", lambda key, *_: ended.add(key))

        def flood(end, numbers):
            with open_session(config, "client") as session:
                links = [session.declare_publisher(key) for key in ("cmd_vel", end)]
                wait(near, lambda: all(link.matching_status.matching for link in links))
                for number in numbers:
                    links[0].put(b'{"linear":{"x":%d}}' % number)
                links[1].put(b"")  # on the same link: what came before it has arrived with it
                wait(near, lambda: end in ended)

        flood("end/one", range(10))
        flood("end/other", range(100, 110))
    assert speeds == [0, 100]


def test_a_routers_limit_is_for_each_of_several_robots(free_port):
    config = BusConfig(connect=(f"tcp/127.0.0.1:{free_port}",))
    names, heard = ("one", "two"), []
    router = open_session(config, "router", most_hz=1e-3, robots=names)
    with router, closing(ZenohBus(config, "client")) as near, open_session(config, "client") as far:
        near.subscribe_bytes("**", lambda key, *_: heard.append(key))
        keys_of = [*(f"{name}/ground_truth/odom" for name in names), "end"]
        links = [far.declare_publisher(key) for key in keys_of]
        wait(near, lambda: all(link.matching_status.matching for link in links))
        for link in (*links[:2], *links):  # in one moment, as physics does; the rest is a flood
            link.put(b"{}")
        wait(near, lambda: "end" in heard)
    assert heard == keys_of
