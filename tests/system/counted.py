"""The nodes of the loop; at its end each writes down how much of the last run it has published."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec
from mecazen import keys
from mecazen.config import Scenario
from mecazen.graph import NODES
from mecazen.node import Outputs, Tick
from mecazen_controller.node import ControllerNode, OdometryNode
from mecazen_follower.node import FollowerNode
from mecazen_physics.node import PhysicsNode
from mecazen_target.node import TargetNode


class _Counting:
    """Before a node in the bases of a class, which has the node's name."""

    name: str

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.counts: Counter[str] = Counter()
        self.is_in_step = False

    def reset(self, seed: int) -> None:
        super().reset(seed)
        if not self.is_in_step:  # a follower without news for long resets itself
            self.counts.clear()

    def step(self, tick: Tick, inputs: Any) -> Any:
        self.is_in_step = True
        outputs = super().step(tick, inputs)
        self.is_in_step = False
        self.count(outputs)
        return outputs

    def count(self, outputs: Outputs) -> None:
        self.counts.update(topic.key for topic in outputs)

    def diagnostics(self) -> Mapping[str, object]:
        # asked for once in each report of the service
        if NODES[self.name].part_of == self.name:
            self.counts[f"diagnostics/{self.name}"] += 1
        return super().diagnostics()

    def close(self) -> None:
        super().close()
        (self.scenario.recorder.path.parent / self.name).write_bytes(
            msgspec.json.encode(self.counts)
        )


class Physics(_Counting, PhysicsNode):
    name = "physics"

    def count(self, outputs: Outputs) -> None:
        self.counts[keys.CLOCK.key] += 1  # the clock publishes one before every step
        super().count(outputs)


class Odometry(_Counting, OdometryNode):
    name = "odometry"


class Controller(_Counting, ControllerNode):
    name = "controller"


class Target(_Counting, TargetNode):
    name = "target"


class Follower(_Counting, FollowerNode):
    name = "follower"
