"""The examples: nodes of one's own, by one file and one line of a scenario."""

import os

import pytest
from harness import ROOT, SCENARIOS, assert_one_line, mecazen
from mecazen.loading import load_scenario, parse_settings
from mecazen_recorder.reader import Recording
from mecazen_tools.processes import ProcessError
from mecazen_tools.simulate import simulate, simulate_distributed
from mecazen_tools.simulation import Simulation

EXAMPLES = ROOT / "examples" / "new"
BACK = SCENARIOS / "back.toml"
SENSOR = f"programs.my_sensor={EXAMPLES}/my_sensor.py:MySensor"


def test_the_follower_keeps_its_distance():
    program = {"programs.follower": f"{EXAMPLES}/my_follower.py:MyFollower"}
    scenario = load_scenario(BACK, {**program, "sim.duration_s": 6.0})
    d_err_m = simulate(scenario, "mine")[0].d_err_m
    # a proportional law lags by speed over gain, 0.2/1.5 m
    assert d_err_m < 0.15


def test_the_sensors_node_leaves_the_trajectory_as_it_is_and_measures_the_true_distance():
    own = {"my_sensor.std_m": 0.0, "my_sensor.rate_hz": 50.0}
    settings = {"sim.duration_s": 2.0, **parse_settings([SENSOR]), **own}
    measured = []

    def keep(sample, _):
        measured.append((sample.header.stamp.ns / 1e9, sample.distance))

    with Simulation(BACK, settings) as sim:
        (topic,) = (topic for topic in sim.host.graph.topics if topic.key == "my_sensor")
        sim.bus.subscribe(topic, keep)
        sim.reset()  # with the samples of the first tick
        sim.run()
        rows = {row[0]: row for row in sim.trajectory.rows()}
        x, tx = (sim.trajectory.columns.index(f"{name}_x_m") for name in ("robot", "target"))
    assert [time_s for time_s, _ in measured] == pytest.approx([0.02 * n for n in range(100)])
    time_s, distance = measured[-1]
    row = rows[time_s]
    # both go along x: y differs by less than the rounding of a centimetre
    assert distance == pytest.approx(float(row[tx]) - float(row[x]), abs=0.01)


def test_a_node_that_nobody_waits_for_makes_every_step_in_processes_too(tmp_path):
    # it is slower than the others, so samples wait for it; all that it gives is recorded
    (tmp_path / "slow.py").write_text(
        "import time\n"
        "from my_sensor import MySensor\n"
        "class Slow(MySensor):\n"
        "    def step(self, tick, inputs):\n"
        "        time.sleep(0.015)\n"
        "        return super().step(tick, inputs)\n"
    )
    settings = (
        "sim.duration_s=1.0",
        f"programs.my_sensor={tmp_path}/slow.py:Slow",
        'services=["physics","target","controller","recorder"]',
        f"recorder.file={tmp_path}/run.mcap",
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{EXAMPLES}:{os.environ.get('PYTHONPATH', '')}")
        patch.syspath_prepend(EXAMPLES)
        simulate_distributed(BACK, settings, "slow")
        samples = [s for s in Recording(tmp_path / "run.mcap").samples() if s.key == "my_sensor"]
    assert [sample.time_ns for sample in samples] == [n * 100_000_000 for n in range(10)]


def test_a_mistake_in_a_user_node_is_one_line(tmp_path):
    (tmp_path / "wrong.py").write_text(
        "from my_sensor import MySensor\n"
        "class Wrong(MySensor):\n"
        "    def step(self, tick, inputs):\n"
        "        return {} / 2\n"
    )
    program = ("--set", f"programs.my_sensor={tmp_path}/wrong.py:Wrong", "--duration", "1")
    path = f"{EXAMPLES}:{os.environ.get('PYTHONPATH', '')}"
    done = mecazen("simulate", "back", "--distributed", *program, PYTHONPATH=path)
    assert_one_line(done, 1, "error: my_sensor: TypeError: unsupported", "(wrong.py:4 step)")


def test_a_node_that_hangs_is_named_and_not_those_that_wait_for_it(tmp_path):
    (tmp_path / "hanging.py").write_text(
        "import time\n"
        "from mecazen_follower.node import FollowerNode\n"
        "class Hanging(FollowerNode):\n"
        "    def step(self, tick, inputs):\n"
        "        time.sleep(1000.0 * (tick.number == 20))\n"
        "        return super().step(tick, inputs)\n"
    )
    settings = (f"programs.follower={tmp_path}/hanging.py:Hanging", "sim.answer_timeout_s=1")
    hung = "follower did not answer tick 20 "
    with pytest.raises(ProcessError, match=hung):
        simulate_distributed(BACK, settings, "back")
