"""Nodes of one's own: their mistakes end in one line, and others get only what they can take."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast

from mecazen.errors import MecazenError, NodeError, told
from mecazen.keys import Topic
from mecazen.limits import refuse_implausible
from mecazen.messages import Message
from mecazen.node import Computing
from mecazen.row import Row
from mecazen.wire import RefusedError

ComputingT = TypeVar("ComputingT", bound=Computing)


class _Guarded:
    """Has every method of a node; what a method raises becomes a line that says where."""

    def __init__(self, name: str, make: Callable[[], object]) -> None:
        self._name = name
        self._node = self._call(make)

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(self._node, attribute)
        return (lambda *given: self._call(value, *given)) if callable(value) else value

    def _call(self, work: Callable[..., object], *given: object) -> object:
        try:
            return work(*given)
        except (MecazenError, RefusedError):
            raise
        except Exception as error:
            raise NodeError(f"{self._name}: {told(error)}") from error


def guarded(name: str, make: Callable[[], ComputingT]) -> ComputingT:
    """Return the node that `make` makes, whose exceptions are each told in a `NodeError`."""
    return cast(ComputingT, _Guarded(name, make))


def check_outputs(name: str, row: Row, outputs: object) -> None:
    """Refuse what every other process would refuse from a node.

    Raises:
        NodeError: They are no messages by topics of the node's row, or a number in them is NaN
            or beyond its limit.
    """
    if not isinstance(outputs, Mapping):
        raise NodeError(f"{name}: step must return messages by their topics, not {outputs!r:.80}")
    for topic, message in outputs.items():
        if not isinstance(topic, Topic) or type(message) is not topic.type:
            raise NodeError(f"{name}: step returns {topic!r:.80} with a wrong message")
        if topic not in row.outputs:
            raise NodeError(f"{name} gives {topic.key}, which is not in its row")
        try:
            refuse_implausible(topic.key, cast(Message, message))
        except RefusedError as refusal:
            raise NodeError(f"{name} gives {topic.key} whose {refusal}") from None
