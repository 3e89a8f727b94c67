"""Observers: their samples and runs; and the health that a service reports once a second."""

import pytest
from harness import forward
from mecazen.bus import StoppedError
from mecazen.keys import CLOCK, CMD_VEL, JOINT_STATES, diagnostics
from mecazen.messages import Clock, JointState
from mecazen.wire import Stamp
from toys import Watcher

TICK_NS = 10_000_000


class Viewer(Watcher):
    TOPICS = (CMD_VEL, JOINT_STATES, CLOCK)


@pytest.fixture(autouse=True)
def viewer(bus, scenario):
    return Viewer(bus, scenario)


@pytest.fixture
def reports(bus, viewer):
    """Return the list of health reports: each status, with its values as a table."""
    reports = []

    def on_report(array, stamp):
        assert array.header.stamp == stamp.time
        (status,) = array.status
        assert status.name == viewer.name
        reports.append((status, {pair.key: pair.value for pair in status.values}))

    bus.subscribe(diagnostics("toy"), on_report)
    return reports


def at(tick, run=1, seed=9):
    return Stamp(tick * TICK_NS, run, seed)


def test_neither_ended_runs_nor_open_topics_begin_a_run(viewer, bus, put):
    for run in (1, 2, 3):
        put(CLOCK, Clock(), at(2, run=run, seed=run))
    # a new run resets before its first sample
    assert viewer.events[-2:] == [3, (Clock(), at(2, run=3, seed=3))]
    viewer.events.clear()
    for run in (0, 1, 2):
        put(JOINT_STATES, JointState(), at(100, run=run))
    for run in (0, 1, 2, 3, 4):
        put(CMD_VEL, forward(0.2), at(3, run=run))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    put(JOINT_STATES, JointState(), at(1, run=3))
    late = (JointState(), at(1, run=3))
    assert viewer.events == [(forward(0.2), at(3, run=3)), (forward(0.3), None), late]
    assert viewer.stamp == at(2, run=3, seed=3)
    bus.stop()
    with pytest.raises(StoppedError):
        viewer.run()


def test_refused_payloads_unknown_fields_and_restarts_are_reported(bus, put, reports):
    for alive in (True, False, True):
        bus.presence.update("controller", alive=alive)
        bus.presence.update("tool", alive=alive)
    put(CLOCK, Clock(), at(0))
    for key in ("cmd_vel", "cmd_vel", "joint_states"):
        bus.put_bytes(key, b"x")
    put(CLOCK, Clock(), at(100))
    bus.put_bytes("cmd_vel", b'{"linear":{"x":1},"angluar":{}}')
    put(CLOCK, Clock(), at(0, run=2))
    (well, values), (refused, counts), (ignored, fields) = reports
    assert (well.level, well.message) == (0, "ok")
    # of services, not of tools
    assert values == {"runs": "1", "refused_payloads": "0", "restarts/controller": "1"}
    assert (refused.level, refused.message) == (1, "refused payloads")
    names = ("refused_payloads", "refused/cmd_vel", "refused/joint_states")
    assert [counts[name] for name in names] == ["3", "2", "1"]
    assert ignored.level == 1
    hint = "angluar is ignored; did you mean angular? allowed: linear, angular"
    assert fields["ignored/cmd_vel"] == hint


def test_rates_and_ages_of_inputs_are_reported(bus, put, reports):
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
    for tick in range(101):  # a new run begins with inputs that never came
        put(CLOCK, Clock(), at(tick, run=2))
    values = reports[-1][1]
    assert (values["hz/cmd_vel"], values["age_s/cmd_vel"]) == ("0.0", "never")
