"""The process that a ROS node is in."""

from __future__ import annotations

from mecazen.bridges import Put
from mecazen.bus.base import Handler, Reply
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.keys import AnswerT, Call, RequestT, Topic, call_of_robot, of_robot
from mecazen.messages import MessageT
from mecazen.robots import join_key


class Process:
    """The process of a service; all of the package uses it through this class alone.

    Args:
        bus: The bus of the process.
        robot: The service's robot, if there are several and it belongs to one.
        put: Publishes a message without a stamp, here and elsewhere.
    """

    def __init__(self, bus: ZenohBus, robot: str, put: Put) -> None:
        self._bus = bus
        self._robot = robot
        self._put = put
        self.queue = bus.queue
        """Takes calls for the process's thread."""

    def listen(self, topic: Topic[MessageT], robot: str, handler: Handler[MessageT]) -> None:
        """Call `handler` with each message that the process publishes on a topic; once."""
        handlers = self._bus.listeners(of_robot(topic, robot or self._robot))
        if handler not in handlers:
            handlers.append(handler)

    def unlisten(self, topic: Topic[MessageT], robot: str, handler: Handler[MessageT]) -> None:
        """Undo `listen`."""
        handlers = self._bus.listeners(of_robot(topic, robot or self._robot))
        if handler in handlers:
            handlers.remove(handler)

    def publish(self, topic: Topic[MessageT], robot: str, message: MessageT) -> None:
        """Publish a message without a stamp, as any external publisher."""
        self._put(of_robot(topic, robot or self._robot), message)

    def call(self, call: Call[RequestT, AnswerT], robot: str, request: RequestT) -> AnswerT:
        """Return the answer to a query; a refusal is a BusError."""
        answer: AnswerT = self._bus.call(call_of_robot(call, robot or self._robot), request)
        return answer

    def ask(self, call: Call[RequestT, AnswerT], request: RequestT, reply: Reply[AnswerT]) -> None:
        """Have a query answered that this process serves, now or later."""
        self._bus.server(call_of_robot(call, self._robot))(request, reply)

    def files(self, prefix: str, robot: str) -> dict[str, bytes]:
        """Return the served files below a key, by their paths."""
        whole = join_key(prefix, robot or self._robot)
        files = self._bus.fetch_files(f"{whole}/*/**")
        return {key.removeprefix(f"{whole}/"): data for key, data in files.items()}

    def refuse(self, source: str, robot: str, reason: str, count: int = 1) -> None:
        """Count refused samples or requests under a name."""
        self._bus.refuse(join_key(source, robot or self._robot), reason, count)
