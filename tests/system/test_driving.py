"""Who drives a running scenario: its follower, programs that take over, and nodes of the user."""

import pytest
from harness import SCENARIOS, forward
from mecazen import keys
from mecazen.loading import load_scenario
from mecazen.wire import JSON_ENCODING, encode
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
