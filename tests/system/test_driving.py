"""The drivers of a running scenario: its follower, programs that take over, nodes of the user."""

import os
import subprocess
import sys
from contextlib import closing

import pytest
from harness import ROOT, SCENARIOS, Newest, forward, mecazen, tools
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario
from mecazen.wire import JSON_ENCODING, encode
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.cli.up import settings_without
from mecazen_tools.simulate import simulate, simulate_distributed

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


def test_a_node_takes_over_alike_in_one_process_and_many(tmp_path):
    (tmp_path / "joy.py").write_text(JOY)
    path = tmp_path / "joy.toml"
    path.write_text(SCENARIO)
    result, trajectory = simulate(load_scenario(path), "joy")
    assert result.trajectory_sha256 == simulate_distributed(path, (), "joy")[0].trajectory_sha256
    y = trajectory.to_numpy()["robot_y_m"]
    assert y[45] == pytest.approx(0.0, abs=1e-2)
    assert y[95] > 0.1  # pushed aside
    assert abs(y[-1]) < y[95]  # and followed again


def test_a_program_takes_over_from_the_follower(stack):
    running = stack(SCENARIOS / "back.toml", "sim.mode=real_time")
    reports = []
    running.bus.subscribe(keys.diagnostics("controller"), lambda report, _: reports.append(report))

    def drives():
        values = [pair for report in reports[-1:] for s in report.status for pair in s.values]
        return next((pair.value for pair in values if pair.key == "drives"), None)

    def push():
        running.bus.put_bytes(keys.CMD_VEL.key, encode(forward(-0.2)), JSON_ENCODING)
        return drives() == "cmd_vel"

    running.start()
    running.wait(lambda: drives() == "follower")
    running.wait(push)
    running.wait(lambda: drives() == "follower")


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


def test_two_programs_on_a_key_are_named(stack, programs, tmp_path):
    running = stack(SCENARIOS / "back.toml", "sim.mode=real_time")
    running.start()
    (tmp_path / "plain.py").write_text(PLAIN)
    key = f"{running.scenario.bus.namespace}/cmd_vel"
    plain = [programs(tmp_path / "plain.py", running.endpoint, key)]
    with closing(ZenohBus(running.scenario.bus, "client")) as tool:
        diagnostics = Diagnostics(tool)

        def put(drivers):
            for process in drivers:
                process.stdin.write("\n")
                process.stdin.flush()
            tool.drain()
            return diagnostics.drives().get("", ""), diagnostics.contests()

        running.wait(lambda: f"pid {plain[0].pid}: python" in put(plain)[0])
        assert put(plain)[1] == ()
        plain.append(programs(tmp_path / "plain.py", running.endpoint, key))
        names = [f"pid {process.pid}: " for process in plain]
        running.wait(lambda: all(name in "".join(put(plain)[1]) for name in names))
        options = tools(running.scenario.bus)
        shown = mecazen(*options, "topics", "--live").stdout
        assert "follower and pid" in shown
        pub = mecazen(*options, "pub", "cmd_vel", "{}")
        assert all(name in pub.stderr for name in names)
        assert pub.stderr.startswith("warning: cmd_vel: 3 programs publish, ")


def test_commands_that_no_service_reads_are_named(stack, programs, tmp_path):
    running = stack(SCENARIOS / "back.toml", "sim.mode=real_time")
    running.start()
    namespace = running.scenario.bus.namespace
    silent = PLAIN.replace("declare_publisher(sys.argv[2])", "get").replace(
        "publisher.put(", "session.put(sys.argv[2], "
    )
    for name, source in (("plain.py", PLAIN), ("silent.py", silent)):
        (tmp_path / name).write_text(source)
    declared = programs(tmp_path / "plain.py", running.endpoint, "rt/cmd_vel")
    putting = programs(tmp_path / "silent.py", running.endpoint, f"{namespace}/robot1/cmd_vel")
    warning = f"no service reads this key, only {namespace}/cmd_vel (publisher: "
    lines = [
        f"rt/cmd_vel: {warning}pid {declared.pid}: ",
        f"{namespace}/robot1/cmd_vel: {warning}",
    ]
    with closing(ZenohBus(running.scenario.bus, "client")) as tool:
        diagnostics = Diagnostics(tool, closely=True)

        def are_named():
            putting.stdin.write("\n")
            putting.stdin.flush()
            tool.drain()
            contests = "\n".join(diagnostics.contests())
            return all(line in contests for line in lines)

        running.wait(are_named)
        options = tools(running.scenario.bus)
        assert f"warning: {lines[0]}" in mecazen(*options, "topics", "--live").stderr
        pub = mecazen(*options, "pub", "robot1/cmd_vel", "{}")
        assert pub.stderr == f"warning: {lines[1].partition(' (')[0]}\n"
        declared.kill()
        running.wait(lambda: lines[0] not in "\n".join(diagnostics.contests()))


def test_a_process_of_plain_zenoh_follows(stack, programs, tmp_path):
    example = ROOT / "examples" / "new" / "my_process.py"
    assert example.read_text().strip() in (ROOT / "docs" / "process.md").read_text()
    path = SCENARIOS / "back.toml"
    without = settings_without(load_scenario(path), ["follower"])
    running = stack(path, "sim.mode=real_time", *without)
    robot, person = (Newest(running.bus, topic) for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM))
    running.start()
    source = example.read_text()  # its keys are those of a run without a namespace
    for key in ("cmd_vel", "target/observation"):
        source = source.replace(f'"{key}"', f'"{running.scenario.bus.namespace}/{key}"')
    (tmp_path / "my_process.py").write_text(source)
    programs(tmp_path / "my_process.py", running.endpoint)

    def gap():
        poses = [newest.message.pose.pose.to_planar() for newest in (robot, person)]
        return poses[0].x, poses[0].distance(poses[1])

    running.wait(lambda: robot.message and person.message and gap()[0] > 0.0)
    assert gap()[1] == pytest.approx(1.13, abs=0.1)  # it lags by speed over gain, 0.2/1.5 m
