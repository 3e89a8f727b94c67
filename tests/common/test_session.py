"""Sessions of Zenoh: meeting points, refused endpoints, router limits and errors."""

import json
import logging
import socket
from contextlib import closing

import pytest
import zenoh
from harness import error_of, wait
from mecazen.bus.session import is_open, open_session, session_config
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError


def test_a_routers_taken_port_is_one_line(router):
    with socket.create_server(("127.0.0.1", 0)) as server:
        for endpoint in (router, f"tcp/127.0.0.1:{server.getsockname()[1]}"):
            config = BusConfig(connect=(endpoint,))
            text = error_of(BusError, lambda config=config: open_session(config, "router"))
            assert text.startswith(f"can't listen on {endpoint}: the port is taken")


@pytest.mark.parametrize("mode", ["router", "peer", "client"])
def test_a_wrong_endpoint_is_one_line(mode):
    for endpoint in ("nonsense", "carrier-pigeon/127.0.0.1:1"):
        config = BusConfig(connect=(endpoint,))
        text = error_of(BusError, lambda config=config: open_session(config, mode))
        assert ".rs" not in text
        assert "the port is taken" not in text


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("bad.json5", "{ nope", "expected array, boolean, null, number, object, or string"),
        ("unknown.json5", '{ modee: "peer" }', "unknown field `modee`, expected one of "),
        ("zenoh.txt", "{}", "Unsupported file type"),
    ],
)
def test_a_wrong_zenoh_configuration_is_one_line(tmp_path, name, content, problem):
    path = tmp_path / name
    path.write_text(content)
    text = error_of(BusError, lambda: open_session(BusConfig(zenoh_config=path), "peer"))
    assert text.startswith(f"{path}: not a Zenoh configuration: ")
    assert problem in text
    assert ".rs" not in text


def test_sessions_stay_on_loopback_without_multicast_by_default():
    listening = (("router", "tcp/127.0.0.1:7447"), ("peer", "tcp/127.0.0.1:0"), ("client", "[]"))
    for mode, endpoint in listening:
        config = session_config(BusConfig(), mode)
        assert config.get_json("scouting/multicast/enabled") == "false"
        assert endpoint in config.get_json("listen/endpoints")
        assert "/[::]" not in config.get_json("listen/endpoints")


def test_a_router_limits_rate_per_link_and_key_and_size(free_port):
    config = BusConfig(connect=(f"tcp/127.0.0.1:{free_port}",))
    samples, ends = [], set()
    options = {"most_hz": 1e-3, "robots": ("one", "two"), "renamed": {"one/cmd_vel": "one/drive"}}
    router = open_session(config, "router", **options)
    with router, closing(ZenohBus(config, "client")) as near:
        for keys in ("*/*", "*/diagnostics/*"):
            near.subscribe_bytes(keys, lambda key, payload, *_: samples.append((key, payload)))
        near.subscribe_bytes("end/*/*", lambda key, *_: ends.add(key))

        def put(end, payload, *names):
            with open_session(config, "client") as session:
                block = zenoh.CongestionControl.BLOCK
                links = [
                    session.declare_publisher(key, congestion_control=block)
                    for key in (*names, end)
                ]
                wait(near, lambda: all(link.matching_status.matching for link in links))
                for link in (*links[:-1], *links[:-1]):
                    link.put(payload)
                links[-1].put(b"")  # on the same link, so all earlier samples have arrived with it
                wait(near, lambda: end in ends)

        services = ("one/diagnostics/target", "one/diagnostics/follower")  # of one process
        limited = ("one/drive", "one/odom", "two/odom", "two/cmd_vel", *services)
        put("end/of/flood", b"1", *limited)
        put("end/of/size", bytes((1 << 16) + 1), *limited)
        put("end/of/other", b"2", *limited)
    assert samples == [(key, payload) for payload in (b"1", b"2") for key in limited]


@pytest.mark.parametrize(
    ("endpoint", "mutual_tls", "expected"),
    [
        ("tcp/127.8.9.10:0", False, False),
        ("tcp/localhost:7447", False, False),
        ("tcp/[::1]:7447", False, False),
        ("tcp/[::ffff:127.0.0.1]:7447?prio=1-7", False, False),
        ("unixsock-stream//tmp/mecazen.sock", False, False),
        ("tls/0.0.0.0:7447#enable_mtls=true", False, False),
        ("quic/192.168.1.7:7447", True, False),
        ("tcp/0.0.0.0:7447#iface=lo", True, True),
        ("tcp/[::]:7447", True, True),
        ("tcp/[::ffff:192.168.1.7]:7447", True, True),
        ("tcp/localhost.example.org:7447", True, True),
        ("udp/224.0.0.224:7446", True, True),
        ("serial//dev/ttyUSB0#baudrate=115200", True, True),
        ("tls/0.0.0.0:0#so_sndbuf=1;enable_mtls=false", True, True),
        ("tls/0.0.0.0:7447", False, True),
    ],
)
def test_unknown_programs_reach_endpoints_beyond_loopback(endpoint, mutual_tls, expected):
    assert is_open(endpoint, mutual_tls=mutual_tls) is expected


@pytest.mark.parametrize(
    ("mode", "role", "settings"),
    [
        ("router", "listen", {"connect": ("tcp/0.0.0.0:7447",)}),
        ("peer", "connect", {"connect": ("tcp/192.168.1.7:7447",)}),
        ("peer", "listen", {"listen": ("tcp/127.0.0.1:0", "tls/0.0.0.0:0")}),
    ],
)
def test_open_endpoints_are_refused_or_warned_of_if_allowed(mode, role, settings, caplog):
    endpoint = settings[next(iter(settings))][-1]
    text = error_of(BusError, lambda: session_config(BusConfig(**settings), mode))
    problem = f"{role} endpoint {endpoint} of a {mode} is beyond loopback and without TLS"
    assert text.startswith(problem)
    assert "bus.insecure = true" in text
    with caplog.at_level(logging.WARNING):
        session_config(BusConfig(**settings, insecure=True), mode)
    assert caplog.text.count(problem) == 1


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_endpoints_of_a_zenoh_configuration_are_checked(tmp_path, mode):
    path, tls = tmp_path / "zenoh.json5", {"tls": {"enable_mtls": False}}
    for settings, endpoint in (
        ({}, "tcp/[::]:"),  # Zenoh's default is open to all
        ({"listen": {"endpoints": ["tcp/10.0.0.1:1"]}}, "tcp/10.0.0.1:1 "),
        ({"listen": {"endpoints": {mode: ["tcp/10.0.0.1:1"]}}}, "tcp/10.0.0.1:1 "),
        (
            {"listen": {"endpoints": ["tls/10.0.0.1:1"]}, "transport": {"link": tls}},
            "tls/10.0.0.1:1 ",
        ),
    ):
        path.write_text(json.dumps(settings))
        text = error_of(BusError, lambda: session_config(BusConfig(zenoh_config=path), mode))
        assert "beyond loopback and without TLS" in text
        assert endpoint in text
