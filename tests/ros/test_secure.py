"""With certificates only the operator drives from ROS; all other clients look on."""

import struct

import pytest
from harness import ROOT, SCENARIOS
from mecazen import keys
from mecazen.messages import Empty
from mecazen_tools import certificates
from ros import grammar

TWIST = b"\x00\x01\x00\x00" + struct.pack("<6d", -0.2, 0.0, 0.0, 0.0, 0.0, 0.0)
EMPTY = b"\x00\x01\x00\x00\x00"
SECURE = ROOT / "configs" / "zenoh" / "secure.json5"


@pytest.fixture(scope="module")
def running(up, tmp_path_factory):
    folder = tmp_path_factory.mktemp("authority") / "keys"
    certificates.create(folder)
    settings = f"bus.keys={str(folder)!r}", f"bus.zenoh_config={str(SECURE)!r}"
    return up(SCENARIOS / "teleop.toml", "sensor.also=[]", *settings)


@pytest.fixture(scope="module")
def node_of(running, raw_node):
    """Open a node with a certificate."""

    def open_node(name: str):
        folder = running.scenario.bus.keys
        files = {"root_ca_certificate": "ca.crt", "connect_certificate": f"{name}.crt",
                 "connect_private_key": f"{name}.key"}  # fmt: skip
        tls = {setting: str(folder / file) for setting, file in files.items()}
        return raw_node(running.endpoint, **{"transport/link/tls": {**tls, "enable_mtls": True}})

    return open_node


@pytest.fixture
def commands(running):
    """The commands that come on the plain key from now on."""
    received = []
    running.bus.subscribe(keys.CMD_VEL, lambda twist, stamp: received.append(twist), every=True)
    return received


@pytest.fixture
def prefix(running):
    return f"/{running.scenario.bus.namespace}"


def test_a_viewer_sees_what_is_published(node_of):
    viewer, kinds = node_of("viewer"), {"NN", "MP", "MS", "SS"}
    viewer.wait(lambda: {grammar.token(token).kind for token in viewer.live} == kinds)
    samples = viewer.subscribe("0/**")
    viewer.wait(lambda: any("Odometry" in sample.key for sample in samples))
    latched = viewer.subscribe(viewer.key_of("MP", "/tf_static"), latched=True)
    viewer.wait(lambda: latched)


def test_the_operator_drives(running, node_of, prefix, commands):
    operator = node_of("operator")
    key = operator.key_of("MS", f"{prefix}/cmd_vel", "/Twist")
    running.wait(lambda: operator.put(key, TWIST) or commands)
    assert commands[0].linear.x == -0.2
    assert operator.call(operator.key_of("SS", f"{prefix}/sim/pause"), EMPTY)
    assert running.call(keys.SIM_STATE, Empty()).paused
    assert operator.call(operator.key_of("SS", f"{prefix}/sim/resume"), EMPTY)


@pytest.mark.parametrize("name", ["viewer", "physics"])
def test_no_other_client_drives_or_stops_the_simulation(running, node_of, prefix, commands, name):
    intruder = node_of(name)
    key = intruder.key_of("MS", f"{prefix}/cmd_vel", "/Twist")
    for _ in range(20):
        intruder.put(key, TWIST)
    intruder.put("0/**", TWIST)
    for service in ("sim/pause", "sim/reset", "reset_simulation", "controller/set_parameters"):
        assert intruder.call(intruder.key_of("SS", f"{prefix}/{service}"), EMPTY, timeout=0.3) == []
    # what any client may ask comes after all that on the same link
    assert intruder.call(intruder.key_of("SS", f"{prefix}/get_simulation_state"), EMPTY)
    assert not running.call(keys.SIM_STATE, Empty()).paused
    assert commands == []
