"""The health of a service: what it reports once a second, and whether it is alive."""

import pytest
from harness import forward, wait
from mecazen.config import BusConfig
from mecazen.errors import MecazenError
from mecazen.health import health
from mecazen.keys import CLOCK, CMD_VEL, JOINT_STATES, diagnostics
from mecazen.messages import Clock, KeyValue
from mecazen.runtime.observer import Observer
from mecazen.wire import Stamp

TICK_NS = 10_000_000
ALL_WELL = (0, "toy", "ok")


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


@pytest.fixture(autouse=True)
def toy(bus, scenario):
    return Toy(bus, scenario)


@pytest.fixture
def reports(bus):
    """Return the list of health reports: each time [s], and the values."""
    reports = []

    def on_report(array, stamp):
        assert array.header.stamp == stamp.time
        reports.append((stamp.time.sec, {v.key: v.value for v in array.status[0].values}))

    bus.subscribe(diagnostics("toy"), on_report)
    return reports


def at(tick, run=1, seed=9):
    return Stamp(tick * TICK_NS, run, seed)


def test_when_all_is_well_expect_level_ok(bus, put):
    heard = []
    bus.subscribe(diagnostics("toy"), lambda array, _: heard.append(array.status[0]))
    put(CLOCK, Clock(), at(0))
    assert [(status.level, status.name, status.message) for status in heard] == [ALL_WELL]
    assert heard[0].values == (KeyValue("runs", "1"), KeyValue("refused_payloads", "0"))
    for key in ("cmd_vel", "cmd_vel", "joint_states"):
        bus.put_bytes(key, b"x")
    put(CLOCK, Clock(), at(100))
    assert (heard[1].level, heard[1].message) == (1, "refused payloads")
    refused = {v.key: v.value for v in heard[1].values if v.key.startswith("refused")}
    assert refused == {"refused_payloads": "3", "refused/cmd_vel": "2", "refused/joint_states": "1"}


def test_a_field_that_is_ignored_is_a_warning(bus, put):
    heard = []
    bus.subscribe(diagnostics("toy"), lambda array, _: heard.append(array.status[0]))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":1},"angluar":{}}')
    put(CLOCK, Clock(), at(0))
    told = "angluar is ignored; did you mean angular? allowed: linear, angular"
    assert (heard[0].level, heard[0].message) == (1, "unknown fields")
    assert KeyValue("ignored/cmd_vel", told) in heard[0].values


def test_rates_and_ages_of_inputs_are_told_once_each_second_in_simulated_time(bus, put, reports):
    for tick in range(301):
        put(CLOCK, Clock(), at(tick))
        if 100 <= tick < 200 and tick % 4 == 0:
            put(CMD_VEL, forward(0.1), at(tick))
        if tick == 250:
            bus.put_bytes("cmd_vel", b"{}")  # is as old as the tick in which it came
    said = {key: [values.get(key) for _, values in reports] for key in reports[-1][1]}
    assert [second for second, _ in reports] == [0, 1, 2, 3]
    assert said["hz/clock"] == [None, "100.0", "100.0", "100.0"]
    assert said["hz/cmd_vel"] == [None, "0.0", "25.0", "1.0"]
    assert said["age_s/cmd_vel"] == [None, "never", "0.04", "0.5"]
    assert said["age_s/joint_states"] == [None, "never", "never", "never"]


def test_a_new_run_begins_with_inputs_that_never_came(put, reports):
    for run in (1, 2):
        for tick in range(101):
            put(CLOCK, Clock(), at(tick, run=run))
            if run == 1:
                put(CMD_VEL, forward(0.1), at(tick, run=run))
    said = [[values.get(f"{what}/cmd_vel") for what in ("hz", "age_s")] for _, values in reports]
    assert said == [[None, None], ["100.0", "0.01"], [None, None], ["0.0", "never"]]


def test_who_has_gone_and_come_back_is_counted_and_told(bus, put, reports):
    back = []
    bus.presence.on_return.append(back.append)
    for alive in (True, False, True, True, False, True):
        bus.presence.update("controller", alive=alive)
    for alive in (True, False, True):
        bus.presence.update("tool", alive=alive)
    put(CLOCK, Clock(), at(0))
    assert back == ["controller", "controller", "tool"]
    said = {key: value for key, value in reports[0][1].items() if "restarts" in key}
    assert said == {"restarts/controller": "2"}  # who takes part, not every tool


def test_a_service_is_healthy_while_it_holds_its_token(open_bus, router):
    config = BusConfig(connect=(router,), namespace="healthy")
    bus, client = open_bus(namespace="healthy"), open_bus("client", namespace="healthy")
    assert health("router", config) == "listens"
    with pytest.raises(MecazenError, match=r"^target is not on the bus$"):
        health("target", config)
    for token, said in (("target", "waiting for others"), ("target/ready", "ready")):
        bus.declare_alive(token)
        wait(client, lambda token=token: token in client.alive())  # the router knows it then
        assert health("target", config) == said
