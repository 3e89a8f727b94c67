"""Where strangers may be: which endpoints need certificates, or the word that none are needed."""

import logging

import pytest
from mecazen.bus.endpoints import is_open
from mecazen.bus.session import session_config
from mecazen.config import BusConfig
from mecazen.errors import BusError

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
