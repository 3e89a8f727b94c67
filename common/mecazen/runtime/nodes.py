"""Nodes as the loop calls them: an adapter for worlds, and checks of user nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any, cast

from mecazen.config import Scenario
from mecazen.errors import MecazenError, NodeError, RefusedError, explained
from mecazen.keys import CLOCK, Topic, of_robot
from mecazen.limits import refuse_implausible
from mecazen.loop import Steps
from mecazen.messages import Clock, Message
from mecazen.node import Computing, Inputs, Node, Outputs, Tick, World
from mecazen.plan import Turn
from mecazen.wire import encode


@contextmanager
def explaining(name: str) -> Iterator[None]:
    """Convert exceptions of user code into a NodeError that names the node and the line."""
    try:
        yield
    except (MecazenError, RefusedError):
        raise
    except Exception as error:
        raise NodeError(f"{name}: {explained(error)}") from error


def mapping(name: str, outputs: object) -> Outputs:
    """Return the outputs of a user node's step; raise NodeError if they are no mapping."""
    if not isinstance(outputs, Mapping):
        kind = type(outputs).__name__
        raise NodeError(f"{name}: step must return a mapping of topics to messages, got {kind}")
    return cast(Outputs, outputs)


class Hosted:
    """A node in its process; errors of a user node are explained, and its outputs checked."""

    def __init__(
        self, turn: Turn, kind: type[Computing], scenario: Scenario, *, is_own: bool
    ) -> None:
        self.turn = turn
        self.name = turn.row.name
        self.scenario = scenario
        self._is_own = is_own
        with self.calling():
            self.node = kind(scenario)
        self.steps: Steps = cast(Node, self.node)
        if isinstance(self.node, World):
            self.steps = WorldSteps(self.node, turn, scenario.names)
        self.steps = OwnSteps(self.steps, turn) if is_own else CheckedSteps(self.steps, turn)

    def calling(self) -> Any:
        """Return the context in which methods of the node are called."""
        return explaining(self.name) if self._is_own else nullcontext()

    def configure(self, scenario: Scenario) -> None:
        """Continue with a scenario in which parameters have changed."""
        if scenario != self.scenario:
            self.scenario = scenario
            with self.calling():
                self.node.configure(scenario)

    def diagnostics(self) -> Mapping[str, object]:
        """Return values on the node's health, by name."""
        with self.calling():
            return self.node.diagnostics()

    def close(self) -> None:
        """Close the node."""
        with self.calling():
            self.node.close()


class WorldSteps:
    """Adapts a world to the loop: full keys for the robots' topics, and the clock as an output."""

    def __init__(self, world: World, turn: Turn, robots: tuple[str, ...]) -> None:
        self._world = world
        self._name = turn.row.name
        self._robots = robots
        self._clocks = [of_robot(CLOCK, name) for name in dict.fromkeys(("", *robots))]
        self._topics = {
            name: {
                of_robot(i.topic, name): i.topic
                for i in turn.row.inputs
                # the first robot receives the shared topics
                if not i.topic.shared or name == robots[0]
            }
            for name in robots
        }

    def reset(self, seed: int) -> None:
        """Begin a run."""
        self._world.reset(seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Advance the world with the outputs of the tick before; return time and the new state."""
        parts = {name: inputs.renamed(topics) for name, topics in self._topics.items()}
        states = self._world.step(tick, parts)
        if not isinstance(states, Mapping) or set(states) != set(self._robots):
            robots = list(self._robots)
            raise NodeError(f"{self._name}: step must return the outputs of each robot of {robots}")
        for name, part in parts.items():
            for topic, reason in part.refused:
                inputs.refuse(of_robot(topic, name), reason)
        outputs: dict[Topic[Any], Message] = dict.fromkeys(self._clocks, Clock(clock=tick.time))
        for name, state in states.items():
            for topic, message in state.items():
                outputs[of_robot(topic, name)] = message
        return outputs


class CheckedSteps:
    """Refuses implausible outputs of a node, as a receiver in another process would."""

    def __init__(self, steps: Steps, turn: Turn) -> None:
        self._steps = steps
        self._name = turn.row.name
        self._topics = {given for given, _, _ in turn.gives}

    def reset(self, seed: int) -> None:
        """Begin a run."""
        self._steps.reset(seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of a tick.

        Raises:
            NodeError: A number of an output is beyond its limit.
        """
        outputs = self._steps.step(tick, inputs)
        for topic, message in outputs.items():
            self._refuse_implausible(topic, message)
        return outputs

    def _refuse_implausible(self, topic: Topic[Any], message: Message) -> None:
        try:
            refuse_implausible(topic.name, message)
        except RefusedError as refusal:
            raise NodeError(f"{self._name} gives {topic.key} whose {refusal}") from None


class OwnSteps(CheckedSteps):
    """Adapts a user node to the loop: explains its errors and checks its outputs."""

    def reset(self, seed: int) -> None:
        """Begin a run."""
        with explaining(self._name):
            self._steps.reset(seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of a tick.

        Raises:
            NodeError: The node failed, or its outputs do not match its row.
        """
        with explaining(self._name):
            outputs = mapping(self._name, self._steps.step(tick, inputs))
        for topic, message in outputs.items():
            if not isinstance(topic, Topic):
                raise NodeError(f"{self._name}: step returns {topic!r:.80}, which is no topic")
            if type(message) is not topic.type:
                raise NodeError(
                    f"{self._name}: step returns {topic.key} as {type(message).__name__}; it must "
                    f"be {topic.type.__name__} of mecazen.messages"
                )
            if topic not in self._topics:
                raise NodeError(f"{self._name} gives {topic.key}, which is not in its row")
            self._refuse_implausible(topic, message)
            size = len(encode(message))
            if size > topic.max_bytes:
                raise NodeError(
                    f"{self._name} gives {topic.key} of {size} bytes, at most {topic.max_bytes}"
                )
        return outputs
