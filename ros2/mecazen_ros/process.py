"""The process that a ROS node is in."""

from __future__ import annotations

from typing import Any

from mecazen.bus.base import Handler, Reply
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.keys import AnswerT, Call, RequestT, Topic
from mecazen.messages import MessageT


class Process:
    """A process with nodes of mecazen, by its bus; `robot` is the name of one of several.

    All of the package uses the process through this class alone.
    """

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self.queue = bus.queue
        """Takes calls for the process's thread."""
        self._publishers: dict[tuple[Topic[Any], str], Any] = {}

    def listen(self, topic: Topic[MessageT], robot: str, handler: Handler[MessageT]) -> None:
        """Call `handler` with each message that the process publishes on a topic; once."""
        handlers = self._bus.namespaced(robot).overheard(topic)
        if handler not in handlers:
            handlers.append(handler)

    def unlisten(self, topic: Topic[MessageT], robot: str, handler: Handler[MessageT]) -> None:
        """Undo `listen`."""
        handlers = self._bus.namespaced(robot).overheard(topic)
        if handler in handlers:
            handlers.remove(handler)

    def publish(self, topic: Topic[MessageT], robot: str, message: MessageT) -> None:
        """Publish a message without a stamp, as any external publisher."""
        if (topic, robot) not in self._publishers:
            self._publishers[topic, robot] = self._bus.namespaced(robot).publisher(topic)
        self._publishers[topic, robot].put(message, None)

    def call(self, call: Call[RequestT, AnswerT], robot: str, request: RequestT) -> AnswerT:
        """Return the answer to a query; a refusal is a BusError."""
        return self._bus.namespaced(robot).call(call, request)

    def ask(self, call: Call[RequestT, AnswerT], request: RequestT, reply: Reply[AnswerT]) -> None:
        """Have a query answered that this process serves, now or later."""
        self._bus.server(call)(request, reply)

    def files(self, selector: str, robot: str) -> dict[str, bytes]:
        """Return served files."""
        return self._bus.namespaced(robot).fetch_files(selector)

    def refuse(self, source: str, robot: str, reason: str, count: int = 1) -> None:
        """Count refused samples or requests under a name."""
        self._bus.namespaced(robot).refuse(source, reason, count)
