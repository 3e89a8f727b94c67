"""Entrants: a pure class, a node of mecazen, a policy; and one line for any other."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mecazen.errors import ConfigError, MecazenError
from mecazen_experiments.followbench.entrants import entrant, observation
from mecazen_experiments.followbench.episodes import Density
from mecazen_experiments.followbench.generate import generate
from mecazen_experiments.followbench.kind import FOLLOWBENCH, drawn
from mecazen_experiments.followbench.play import World, play

FULL_SPEED = """
from mecazen.keys import CMD_VEL, ODOM, PEOPLE, SCAN
from mecazen.messages import Twist
from mecazen.geometry import Twist2D
from mecazen.node import Node, Row, every

class Mine(Node):
    ROW = Row("follower", inputs=(every(ODOM),), outputs=(CMD_VEL,))

    def reset(self, seed):
        self.target = None

    def step(self, tick, inputs):
        names = [one.id for one in inputs[PEOPLE].persons]
        assert ("target" in names) == (len(inputs[SCAN].ranges) == 200)
        return {CMD_VEL: Twist.planar(Twist2D(1.0, 0.0, 0.5))}

class Policy:
    def predict(self, observation):
        assert observation.shape == (234,)
        return (1.0, 0.5), None

class Pure:
    def reset(self, seed):
        pass

    def command(self, view):
        return 1.0, 0.5

class Neither:
    pass
"""
DOCUMENT = Path(__file__).parents[3] / "docs" / "followbench.md"
EPISODE = generate("Parallel", "back", Density(5), 1)


@pytest.mark.parametrize("name", ["Mine", "Policy", "Pure"])
def test_a_node_a_policy_and_a_pure_class_may_enter(tmp_path, name):
    file = tmp_path / "mine.py"
    file.write_text(FULL_SPEED)
    short = msgspec.structs.replace(EPISODE, max_steps=10)
    record = play(short, entrant(f"{file}:{name}")(), 1)
    # a twentieth of a turn in 1 s; the heading before each step counts
    assert record.robot[-1, 2] - record.robot[0, 2] == pytest.approx(0.5)
    assert np.hypot(*(record.robot[-1, :2] - record.robot[0, :2])) == pytest.approx(1.0, rel=0.02)


def test_the_planner_of_the_documents_follows_the_target(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    file = tmp_path / "mine.py"
    file.write_text(code)
    alone = msgspec.structs.replace(EPISODE, humans=())
    record = play(alone, entrant(f"{file}:Mine")(), 1)
    assert not record.collided
    assert record.visible.all()


@pytest.mark.parametrize(
    ("name", "says"),
    [("mine", "no such planner; known: .*social"), ("{file}:Neither", "must be a class with")],
)
def test_who_can_not_play_is_one_line(tmp_path, name, says):
    file = tmp_path / "mine.py"
    file.write_text(FULL_SPEED)
    with pytest.raises(ConfigError, match=says):
        entrant(name.format(file=file))


def test_an_unseen_target_is_zeros_in_the_observation_of_a_policy():
    world = World(EPISODE)
    seen = world.sees()
    shown = observation(world.view(seen))
    hidden = observation(world.view([False] * len(seen)))
    assert shown[4] == 1.0
    assert not hidden[4:34].any()
    assert np.array_equal(shown[34:], hidden[34:])


@pytest.mark.parametrize(
    ("program", "error"),
    [
        (
            "from mecazen.node import Node\nclass Mine(Node):\n"
            "    def reset(self, seed):\n        pass\n"
            "    def step(self, tick, inputs):\n        return 'stop'\n",
            "follower: step must return a mapping of topics to messages, got str",
        ),
        (
            "class Mine:\n    def reset(self, seed):\n        pass\n"
            "    def command(self, view):\n        return 1 / 0\n",
            r"mine\.py:Mine: ZeroDivisionError: .*mine\.py:5 command",
        ),
    ],
)
def test_a_fault_of_an_entrant_is_one_line(tmp_path, program, error):
    (tmp_path / "mine.py").write_text(program)
    (series,) = drawn([f"{tmp_path / 'mine.py'}:Mine"], [1], ["uTurn"])[:1]
    with pytest.raises(MecazenError, match=error):
        FOLLOWBENCH.measure(series.jobs[0])
