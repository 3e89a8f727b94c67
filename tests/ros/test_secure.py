"""With certificates the operator alone drives from ROS; everybody else only looks on."""

import struct

import pytest
from harness import ROOT, SCENARIOS
from mecazen import keys
from mecazen.bus.session import _certificates
from mecazen.messages import Empty
from mecazen_tools import certificates
from ros import grammar

TWIST = b"\x00\x01\x00\x00" + struct.pack("<6d", -0.2, 0.0, 0.0, 0.0, 0.0, 0.0)
EMPTY = b"\x00\x01\x00\x00\x00"
SECURE = ROOT / "configs" / "zenoh" / "secure.json5"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("authority") / "keys"
    certificates.create(made)
    return made


@pytest.fixture(scope="module")
def running(up, folder):
    settings = f"bus.keys={str(folder)!r}", f"bus.zenoh_config={str(SECURE)!r}"
    return up(SCENARIOS / "teleop.toml", "sensor.also=[]", *settings)


@pytest.fixture(scope="module")
def node_of(running, folder, raw_node):
    """Open a node with somebody's certificate."""

    def come(name: str):
        tls = {"transport/link/tls": _certificates(folder, name)}
        return raw_node(running.endpoint, **tls)

    return come


@pytest.fixture
def commands(running):
    """The commands that come on the plain key from now on."""
    heard = []
    running.bus.subscribe(keys.CMD_VEL, lambda twist, stamp: heard.append(twist), every=True)
    return heard


@pytest.fixture(scope="module")
def prefix(running):
    return f"/{running.scenario.bus.namespace}"


def test_everybody_sees_what_is_published(running, node_of):
    viewer = node_of("viewer")
    kinds = {grammar.token(token).kind for token in viewer.tokens()}
    assert kinds == {"NN", "MP", "MS", "SS"}
    heard = viewer.hear("0/**")
    viewer.wait(lambda: any("Odometry" in one.key for one in heard))
    late = viewer.hear(viewer.key_of("MP", "/tf_static"), latched=True)
    viewer.wait(lambda: late)


def test_the_operator_drives(running, node_of, prefix, commands):
    operator = node_of("operator")
    key = operator.key_of("MS", f"{prefix}/cmd_vel", "/Twist")

    def is_heard() -> bool:
        operator.put(key, TWIST)
        return bool(commands)

    running.wait(is_heard)
    assert commands[0].linear.x == -0.2
    assert operator.call(operator.key_of("SS", f"{prefix}/sim/pause"), EMPTY)
    assert running.bus.call(keys.SIM_STATE, Empty()).paused
    assert operator.call(operator.key_of("SS", f"{prefix}/sim/resume"), EMPTY)


@pytest.mark.parametrize("name", ["viewer", "recorder", "physics", "target"])
def test_nobody_else_drives_or_stops_the_simulation(running, node_of, prefix, commands, name):
    intruder = node_of(name)
    key = intruder.key_of("MS", f"{prefix}/cmd_vel", "/Twist")
    for _ in range(20):
        intruder.put(key, TWIST)
    intruder.put("0/**", TWIST)
    for service in ("sim/pause", "sim/reset", "reset_simulation", "controller/set_parameters"):
        assert intruder.call(intruder.key_of("SS", f"{prefix}/{service}"), EMPTY, timeout=0.3) == []
    # what anyone may ask comes after all that on the same link
    assert intruder.call(intruder.key_of("SS", f"{prefix}/get_simulation_state"), EMPTY)
    assert not running.bus.call(keys.SIM_STATE, Empty()).paused
    assert commands == []
