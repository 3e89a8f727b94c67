"""Toy nodes. Tests also copy this file beside a scenario, as the program of a user."""

import sys
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from mecazen.config import FollowerConfig
from mecazen.keys import CLOCK, CMD_VEL, ODOM, TARGET_CMD_VEL
from mecazen.node import Node
from mecazen.row import Row, every, latest
from mecazen.runtime.observer import Observer
from mecazen.schema import Positive, Section
from msgspec import field


class Toy(Node):
    """Does nothing, and has no row."""

    def reset(self, seed): ...

    def step(self, tick, inputs):
        return {}


class Slow(Section, tag="slow", tag_field="kind"):
    speed_m_s: float = 0.1


class Fast(Section, tag="fast", tag_field="kind"):
    speed_m_s: Positive


class Gain(Section):
    """A section with a setting of each kind."""

    gain: Positive = 1.0
    walk: Slow | Fast = Slow()
    weights: dict[str, float] = field(default_factory=dict)
    limit: Positive | None = None
    mixed: float | str = 0.0


class RequiredGain(Section):
    gain: Positive


class FollowerGain(FollowerConfig):
    gain: Positive = 1.0


class Mine(Toy):
    ROW = Row("mine", inputs=(every(CLOCK), latest(CMD_VEL)), outputs=(TARGET_CMD_VEL,))
    SECTION = Gain


class Required(Mine):
    SECTION = RequiredGain


class Untyped(Mine):
    SECTION = int


class Broken(Mine):
    def reset(self, seed):
        raise ZeroDivisionError("no seed")


class Prompt(Mine):
    """Has real-time priority."""

    ROW = Row("prompt", inputs=Mine.ROW.inputs, priority=2)


class Leader(Toy):
    ROW = Row("leader", inputs=(every(ODOM),), outputs=(CMD_VEL,))


class Gainer(Leader):
    SECTION = FollowerGain


class Watcher(Observer):
    """Records its runs and samples: the seed of a run; the message and stamp of a sample."""

    TOPICS = ()

    def __init__(self, bus, scenario):
        super().__init__("toy", bus, scenario)
        self.events = []
        for topic in self.TOPICS:
            self.subscribe(topic, lambda *sample: self.events.append(sample))

    def reset(self, seed):
        self.events.append(seed)

    def diagnostics(self):
        return {"runs": sum(isinstance(event, int) for event in self.events)}


@contextmanager
def user_nodes(*rows, base=Toy):
    """Make a class for each row, which programs can name; yield the programs by node name."""
    kinds = {row.name: type(row.name, (base,), {"ROW": row}) for row in rows}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "user", SimpleNamespace(**kinds))
        yield {name: f"user:{name}" for name in kinds}
