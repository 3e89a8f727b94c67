"""The examples, and other programs of a user: nodes of a scenario, and processes of plain Zenoh."""

import importlib.util
import os
import subprocess
import sys
from contextlib import closing

import msgspec
import numpy as np
import pytest
from harness import ROOT, SCENARIOS, Newest, here, tools
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario, parse_settings
from mecazen_gym.policy import SIZE
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.cli.up import settings_without
from mecazen_tools.simulate import simulate
from mecazen_tools.simulation import Simulation

EXAMPLES = ROOT / "examples" / "new"
BACK = SCENARIOS / "back.toml"
SENSOR = f"programs.my_sensor={EXAMPLES}/my_sensor.py:MySensor"


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


JOY = """
from mecazen.geometry import Twist2D
from mecazen.keys import CLOCK, command_topic
from mecazen.messages import Twist
from mecazen.node import Node, Row, every

COMMAND = command_topic("joy/cmd_vel")

class Joy(Node):
    ROW = Row("joy", inputs=(every(CLOCK),), outputs=(COMMAND,))

    def reset(self, seed):
        pass

    def step(self, tick, inputs):
        is_held = 40 <= tick.number < 90
        return {COMMAND: Twist.planar(Twist2D(y=0.4))} if is_held else {}
"""
SCENARIO = """
robot = "nexus"
programs.joy = "joy.py:Joy"
start.x_m = -1.0
sim.duration_s = 2.5

[[controller.commands]]
key = "joy/cmd_vel"
priority = 7
timeout_s = 0.1
"""


def test_a_node_takes_over_from_the_follower_and_hands_back(tmp_path):
    (tmp_path / "joy.py").write_text(JOY)
    path = tmp_path / "joy.toml"
    path.write_text(SCENARIO)
    y = simulate(load_scenario(path), "joy")[1].to_numpy()["robot_y_m"]
    assert y[45] == pytest.approx(0.0, abs=1e-2)
    assert y[95] > 0.1  # pushed aside
    assert abs(y[-1]) < y[95]  # and followed again


PLAIN = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
session = zenoh.open(config)
publisher = session.declare_publisher(sys.argv[2])
for line in sys.stdin:
    publisher.put('{"linear":{"x":0.1}}')
"""


@pytest.fixture
def programs():
    """Start plain programs of Python; they end with the test."""
    started = []

    def start(*arguments):
        environment = {"PATH": os.environ["PATH"]}  # nothing of mecazen
        command = [sys.executable, *map(str, arguments)]
        process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdin.close()


def test_programs_that_drive_are_named_and_so_are_commands_that_no_service_reads(
    stack, programs, tmp_path
):
    running = stack(SCENARIOS / "back.toml", "sim.mode=real_time")
    running.start()
    namespace, options = running.scenario.bus.namespace, tools(running.scenario.bus)
    silent = PLAIN.replace("declare_publisher(sys.argv[2])", "get").replace(
        "publisher.put(", "session.put(sys.argv[2], "
    )
    for name, source in (("plain.py", PLAIN), ("silent.py", silent)):
        (tmp_path / name).write_text(source)
    with closing(ZenohBus(running.scenario.bus, "client")) as tool:
        diagnostics = Diagnostics(tool, closely=True)

        def put(drivers):
            for process in drivers:
                process.stdin.write("\n")
                process.stdin.flush()
            tool.drain()
            return diagnostics.drives().get("", ""), "\n".join(diagnostics.contests())

        running.wait(lambda: put(())[0] == "follower")
        command = tmp_path / "plain.py", running.endpoint, f"{namespace}/cmd_vel"
        plain = [programs(*command)]
        running.wait(lambda: f"pid {plain[0].pid}: python" in put(plain)[0])
        plain.append(programs(*command))
        names = [f"pid {process.pid}: " for process in plain]
        running.wait(lambda: all(name in put(plain)[1] for name in names))
        assert "follower and pid" in here(*options, "topics", "--live").stdout
        running.wait(lambda: put(())[0] == "follower")

        declared = programs(tmp_path / "plain.py", running.endpoint, "rt/cmd_vel")
        putting = programs(tmp_path / "silent.py", running.endpoint, f"{namespace}/one/cmd_vel")
        warning = f"no service reads this key, only {namespace}/cmd_vel (publisher: "
        lines = [
            f"rt/cmd_vel: {warning}pid {declared.pid}: ",
            f"{namespace}/one/cmd_vel: {warning}",
        ]
        running.wait(lambda: all(line in put([putting])[1] for line in lines))
        declared.kill()
        running.wait(lambda: lines[0] not in put(())[1])


def test_a_process_of_plain_zenoh_follows(stack, programs, tmp_path):
    here("new", "process", "my_process", folder=tmp_path)
    path = SCENARIOS / "back.toml"
    without = settings_without(load_scenario(path), ["follower"])
    running = stack(path, "sim.mode=real_time", *without)
    robot, person = (Newest(running.bus, topic) for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM))
    running.start()
    source = (
        tmp_path / "my_process.py"
    ).read_text()  # its keys are those of a run without a namespace
    for key in ("cmd_vel", "target/observation"):
        source = source.replace(f'"{key}"', f'"{running.scenario.bus.namespace}/{key}"')
    (tmp_path / "my_process.py").write_text(source)
    programs(tmp_path / "my_process.py", running.endpoint)

    def gap():
        poses = [newest.message.pose.pose.to_planar() for newest in (robot, person)]
        return poses[0].x, poses[0].distance(poses[1])

    running.wait(lambda: robot.message and person.message and gap()[0] > 0.0)
    assert gap()[1] == pytest.approx(1.13, abs=0.1)  # it lags by speed over gain, 0.2/1.5 m


def test_training_writes_weights_that_compare_takes(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("train", ROOT / "examples" / "train.py")
    train = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(train)
    for name, value in {"CANDIDATES": 4, "PERSONS": 2, "WALKS": train.WALKS[-1:]}.items():
        monkeypatch.setattr(train, name, value)
    train.main(str(tmp_path / "mine.npz"), "2")
    weights = np.load(tmp_path / "mine.npz")["weights"]
    assert weights.shape == (SIZE,)
    assert weights.any()
    short = ("--seeds", "1", "--duration", "2", "--json")
    compared = here("compare", "back", "policy:mine.npz", "default", *short, folder=tmp_path)
    means = msgspec.json.decode(compared.stdout)["means"]
    assert [*means] == ["mine.npz", "default"], compared.stderr
