"""The health of a service: what it reports once a second, and whether it is alive."""

import pytest
from harness import forward, wait
from mecazen.config import BusConfig
from mecazen.errors import MecazenError
from mecazen.health import health
from mecazen.keys import CLOCK, CMD_VEL, JOINT_STATES, diagnostics
from mecazen.messages import Clock
from mecazen.runtime.observer import Observer
from mecazen.wire import Stamp

TICK_NS = 10_000_000


class Toy(Observer):
    """Takes three topics, and counts its runs."""

    def __init__(self, bus, scenario):
        self.runs = 0
        super().__init__("toy", bus, scenario)
        for topic in (CLOCK, CMD_VEL, JOINT_STATES):
            self.subscribe(topic, lambda *_: None)

    def reset(self, seed):
        self.runs += 1

    def diagnostics(self):
        return {"runs": self.runs}


@pytest.fixture
def reports(bus, scenario):
    """Return the list of health reports of a toy: each status, with its values as a table."""
    toy, reports = Toy(bus, scenario), []

    def on_report(array, stamp):
        assert array.header.stamp == stamp.time
        (status,) = array.status
        assert status.name == toy.name
        reports.append((status, {pair.key: pair.value for pair in status.values}))

    bus.subscribe(diagnostics("toy"), on_report)
    return reports


def at(tick, run=1):
    return Stamp(tick * TICK_NS, run, 9)


def test_refused_payloads_and_unknown_fields_are_warnings(bus, put, reports):
    put(CLOCK, Clock(), at(0))
    for key in ("cmd_vel", "cmd_vel", "joint_states"):
        bus.put_bytes(key, b"x")
    put(CLOCK, Clock(), at(100))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":1},"angluar":{}}')
    put(CLOCK, Clock(), at(0, run=2))
    (well, values), (refused, counts), (ignored, fields) = reports
    assert (well.level, well.message) == (0, "ok")
    assert values == {"runs": "1", "refused_payloads": "0"}
    assert (refused.level, refused.message) == (1, "refused payloads")
    names = ("refused_payloads", "refused/cmd_vel", "refused/joint_states")
    assert [counts[name] for name in names] == ["3", "2", "1"]
    assert ignored.level == 1
    hint = "angluar is ignored; did you mean angular? allowed: linear, angular"
    assert fields["ignored/cmd_vel"] == hint


def test_rates_and_ages_of_inputs_are_reported_each_second(bus, put, reports):
    for tick in range(301):
        put(CLOCK, Clock(), at(tick))
        if 100 <= tick < 200 and tick % 4 == 0:
            put(CMD_VEL, forward(0.1), at(tick))
        if tick == 250:
            bus.put_bytes("cmd_vel", b"{}")  # is as old as the tick in which it came
    columns = {key: [values.get(key) for _, values in reports] for key in reports[-1][1]}
    assert columns["hz/clock"] == [None, "100.0", "100.0", "100.0"]
    assert columns["hz/cmd_vel"] == [None, "0.0", "25.0", "1.0"]
    assert columns["age_s/cmd_vel"] == [None, "never", "0.04", "0.5"]
    # a new run begins with inputs that never came
    for tick in range(101):
        put(CLOCK, Clock(), at(tick, run=2))
    values = reports[-1][1]
    assert (values["hz/cmd_vel"], values["age_s/cmd_vel"]) == ("0.0", "never")


def test_restarts_of_services_are_counted(bus, put, reports):
    returned = []
    bus.presence.on_return.append(returned.append)
    for alive in (True, False, True, True, False, True):
        bus.presence.update("controller", alive=alive)
    for alive in (True, False, True):
        bus.presence.update("tool", alive=alive)
    put(CLOCK, Clock(), at(0))
    assert returned == ["controller", "controller", "tool"]
    restarts = {key: value for key, value in reports[0][1].items() if "restarts" in key}
    assert restarts == {"restarts/controller": "2"}  # of services, not of tools


def test_a_service_is_healthy_while_it_holds_its_token(open_bus, router):
    config = BusConfig(connect=(router,), namespace="healthy")
    bus, client = open_bus(namespace="healthy"), open_bus("client", namespace="healthy")
    assert health("router", config) == "listens"
    with pytest.raises(MecazenError, match=r"^target is not on the bus$"):
        health("target", config)
    for token, state in (("target", "waiting for others"), ("target/ready", "ready")):
        bus.declare_alive(token)
        wait(client, lambda token=token: token in client.alive())  # the router knows it then
        assert health("target", config) == state
