"""Sessions of Zenoh: where they meet, who may connect, and what is wrong."""

import logging
import secrets
import socket
from contextlib import closing

import pytest
from harness import error_of, wait
from mecazen import keys
from mecazen.bus.session import includes, is_open, open_session, session_config
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


LOCAL = [
    "tcp/127.0.0.1:7447",
    "tcp/127.8.9.10:0",
    "tcp/localhost:7447",
    "tcp/[::1]:7447",
    "tcp/[::ffff:127.0.0.1]:7447",
    "udp/127.0.0.1:7447",
    "ws/localhost:7447",
    "tcp/127.0.0.1:7447?prio=1-7",
    "tcp/127.0.0.1:7447#iface=lo",
    "unixsock-stream//tmp/mecazen.sock",
    "unixpipe//tmp/mecazen.pipe",
]
OPEN = [
    "tcp/0.0.0.0:7447",
    "tcp/[::]:7447",
    "tcp/192.168.1.7:7447",
    "tcp/[fe80::1]:7447",
    "tcp/[::ffff:192.168.1.7]:7447",
    "tcp/robot.local:7447",
    "tcp/localhost.example.org:7447",
    "tcp/127.0.0.1.example.org:7447",
    "tcp/0.0.0.0:7447#iface=lo",
    "udp/224.0.0.224:7446",
    "ws/0.0.0.0:7447",
    "vsock/-1:7447",
    "serial//dev/ttyUSB0#baudrate=115200",
]
TLS = ["tls/0.0.0.0:7447", "tls/[::]:0", "tls/robot.local:7447", "quic/192.168.1.7:7447"]


@pytest.mark.parametrize("mutual_tls", [True, False])
def test_on_loopback_there_are_no_strangers(mutual_tls):
    assert not [endpoint for endpoint in LOCAL if is_open(endpoint, mutual_tls=mutual_tls)]


@pytest.mark.parametrize("mutual_tls", [True, False])
def test_anywhere_else_there_are(mutual_tls):
    assert [endpoint for endpoint in OPEN if is_open(endpoint, mutual_tls=mutual_tls)] == OPEN


def test_tls_keeps_them_out_where_it_wants_certificates_of_both_ends():
    assert not [endpoint for endpoint in TLS if is_open(endpoint, mutual_tls=True)]
    assert [endpoint for endpoint in TLS if is_open(endpoint, mutual_tls=False)] == TLS


@pytest.mark.parametrize(("said", "is_it_open"), [("true", False), ("false", True), ("0", True)])
def test_an_endpoints_own_configuration_has_the_last_word(said, is_it_open):
    endpoint = f"tls/0.0.0.0:7447#so_sndbuf=1;enable_mtls={said}"
    assert is_open(endpoint, mutual_tls=not is_it_open) is is_it_open


@pytest.mark.parametrize(
    ("mode", "way", "settings"),
    [
        ("router", "listen", {"connect": ("tcp/0.0.0.0:7447",)}),
        ("peer", "connect", {"connect": ("tcp/192.168.1.7:7447",)}),
        ("peer", "listen", {"listen": ("tcp/[::]:0",)}),
        ("peer", "listen", {"listen": ("tcp/127.0.0.1:0", "tls/0.0.0.0:0")}),
    ],
)
def test_beyond_loopback_without_tls_needs_a_word_and_then_there_is_a_warning(
    mode, way, settings, caplog
):
    with pytest.raises(BusError) as caught:
        session_config(BusConfig(**settings), mode)
    endpoint = settings[next(iter(settings))][-1]
    line = f"{way} endpoint {endpoint} of a {mode} is beyond loopback and without TLS"
    assert str(caught.value).startswith(line)
    assert "bus.insecure = true" in str(caught.value)
    with caplog.at_level(logging.WARNING):
        session_config(BusConfig(**settings, insecure=True), mode)
    assert caplog.text.count(line) == 1


def test_a_client_listens_nowhere_and_may_look_at_any_router(caplog):
    config = session_config(BusConfig(connect=("tcp/192.168.1.7:7447",)), "client")
    assert config.get_json("listen/endpoints") == "[]"
    assert config.get_json("connect/endpoints") == '["tcp/192.168.1.7:7447"]'
    assert not caplog.messages


@pytest.mark.parametrize("mode", ["router", "peer"])
@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        # what a file leaves out, Zenoh has open to all
        ("{}", "tcp/[::]:"),
        ('{listen: {endpoints: ["tcp/10.0.0.1:7447"]}}', "tcp/10.0.0.1:7447"),
        (
            '{listen: {endpoints: {router: ["tcp/10.0.0.1:1"], peer: ["tcp/10.0.0.1:1"]}}}',
            "tcp/10.0.0.1:1",
        ),
        (
            '{listen: {endpoints: ["tls/10.0.0.1:1"]},'
            " transport: {link: {tls: {enable_mtls: false}}}}",
            "tls/10.0.0.1:1",
        ),
    ],
)
def test_endpoints_of_a_zenoh_configuration_are_held_to_the_same(tmp_path, mode, text, endpoint):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusError, match="beyond loopback and without TLS") as caught:
        session_config(BusConfig(zenoh_config=path), mode)
    assert endpoint in str(caught.value)
