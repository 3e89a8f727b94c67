"""The services of a process as ROS 2 nodes, in rmw_zenoh's protocol.

They have a Zenoh session without a namespace, which would hide them from ROS. The session is a
client, of mecazen's router or of `rmw_zenohd`. A ROS topic is published only while it has a
subscriber. Messages from ROS are published on the plain key.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from typing import Any

import msgspec
import zenoh
import zenoh.ext
from mecazen import keys
from mecazen.bridges import Put
from mecazen.bus.base import Reply
from mecazen.bus.inbox import Inbox, Queue, Refusals
from mecazen.bus.receiving import direct
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, Scenario
from mecazen.description import ask_description
from mecazen.errors import RefusedError
from mecazen.graph import SHARED, Graph
from mecazen.keys import Call, Topic, call_of_robot, of_robot
from mecazen.limits import refuse_implausible
from mecazen.messages import Message, String
from mecazen.robots import join_key
from mecazen.row import Row
from mecazen.wire import Stamp

from mecazen_ros import cdr
from mecazen_ros.description import fixed_frames, portable
from mecazen_ros.parameters import PARAMETER_SERVICES, NodeParameters
from mecazen_ros.protocol import (
    LATCHED,
    NO_HASH,
    PARAMETERS,
    Node,
    Qos,
    data_key,
    dds_type,
    gid_of,
)
from mecazen_ros.queries import Respond, attached, attachment_of, by_parameters, by_query, serve
from mecazen_ros.services import SERVICES, Service
from mecazen_ros.topics import (
    DESCRIBED,
    Namespace,
    RosTopic,
    name_of,
    publications,
    ros_name,
    subscriptions,
)
from mecazen_ros.types import RosTypeError, service_hash, type_hash

logger = logging.getLogger(__name__)

Send = Callable[[Message, Stamp | None], None]
DESCRIPTION_TIMEOUT_S = 10.0
MISSES = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5)
"""Interval at which subscribers learn of a latched sample that they missed, as in rmw_zenoh [s]."""


class RosSide:
    """The session of a process's ROS nodes.

    Args:
        config: Endpoints, domain and distribution of ROS.
        name: Name of the certificate that the session shows, if certificates are used.

    Raises:
        BusError: See `open_session`.
    """

    def __init__(self, config: BusConfig, name: str) -> None:
        self.domain = config.ros_domain_id
        self._has_hashes = config.ros_distro != "humble"
        self.session = open_session(of_ros(config), "client", name, timestamps=True)
        self.id = str(self.session.info.zid())
        self.numbers = count()
        """Numbers for nodes and their endpoints."""
        self._kept: list[object] = []

    def show(
        self, name: str, robot: str, bus: ZenohBus, put: Put, scenario: Scenario, graph: Graph
    ) -> None:
        """Show a service as a ROS node."""
        RosNode(self, name, robot, bus, put, scenario, graph)

    def keep(self, *declared: object) -> None:
        """Keep references to declared objects, since Zenoh undeclares objects without reference."""
        self._kept += declared

    def shown(self, hashed: str) -> str:
        """Return a type's hash as used in keys and tokens."""
        return hashed if self._has_hashes else NO_HASH

    def key(self, name: str, dds: str, hashed: str) -> str:
        """Return the key of a topic or a service by its whole name and its type."""
        return data_key(self.domain, name, dds, self.shown(hashed))

    def declare_token(self, token: str) -> None:
        """Declare the liveliness token by which ROS sees a node or an endpoint."""
        self.keep(self.session.liveliness().declare_token(token))

    def close(self) -> None:
        """Close the session, and with it all its declarations."""
        self.session.close()  # type: ignore[no-untyped-call]


def of_ros(config: BusConfig) -> BusConfig:
    """Return the settings of a session for ROS: a client without a namespace."""
    endpoints = config.ros_connect or config.connect
    return msgspec.structs.replace(config, mode="client", namespace=None, connect=endpoints)


class RosNode:
    """A service as a ROS node, with its publishers, subscriptions and services.

    Args:
        side: Session of the process's ROS nodes.
        name: Name of the service.
        robot: Name of the service's robot, if there are several robots.
        bus: Bus of the service's process.
        put: Publishes a message without a stamp, in this process and elsewhere.
        scenario: Configuration for the service's robot.
        graph: Nodes of the scenario.
    """

    def __init__(
        self,
        side: RosSide,
        name: str,
        robot: str,
        bus: ZenohBus,
        put: Put,
        scenario: Scenario,
        graph: Graph,
    ) -> None:
        here = Namespace(scenario.bus.namespace or "")
        self._side = side
        self._node = Node(side.domain, side.id, next(side.numbers), here.name, ros_name(name))
        self._robot, self._bus, self._put = robot, bus, put
        side.declare_token(self._node.token)
        for row in graph.services.get(name, ()):
            for one in scenario.names:
                self._add(row, graph, one or robot, here.within(one))
            for topic in row.outputs:
                if _is_common(row, topic):
                    self._publish(topic, robot, name_of(row, topic), topic, here)
            for service in SERVICES:
                if service.call in row.calls:
                    whole, kind = here.whole(service.name), _service_type(service)
                    respond = by_query(service, self._ask)
                    self._serve(self._side.key(whole, *kind), service.name, respond)
                    self._declare("SS", whole, kind)
            if keys.SET_PARAMETERS in row.calls:
                for other in scenario.services:
                    for one in ("",) if other in SHARED else scenario.names:
                        self._serve_parameters(other, one, here.within(one))
        if name in scenario.services:
            for parameter_service in PARAMETER_SERVICES:
                whole = here.whole(f"{ros_name(name)}/{parameter_service.name}")
                self._declare("SS", whole, _service_type(parameter_service), PARAMETERS)
        health = keys.diagnostics(name)
        self._publish(health, robot, health.key, health, here)

    def _add(self, row: Row, graph: Graph, robot: str, where: Namespace) -> None:
        """Declare the publishers and subscriptions of a row for one robot."""
        if keys.ROBOT_DESCRIPTION in row.calls:
            described = ask_description(self._bus, robot, DESCRIPTION_TIMEOUT_S)
            where = where._replace(urdf=described.urdf)
            self._describe(where, described.meshes)
        for topic in row.outputs:
            if not _is_common(row, topic):
                name = name_of(row, topic, self._key_of(topic, robot))
                self._publish(topic, robot, name, topic, where)
        for given in row.inputs:
            if _taker(graph, given.topic) is row:
                key, is_given = self._key_of(given.topic, robot), graph.giver(given.topic.key)
                for one in subscriptions(given.topic, key, is_given=is_given is not None):
                    self._take(given.topic, robot, one, where)

    def _key_of(self, topic: Topic[Any], robot: str) -> str:
        """Return the key of a robot's topic within the robot's namespace."""
        key = self._bus.key_of(of_robot(topic, robot))
        return key.removeprefix(f"{robot}/") if robot else key

    def _describe(self, where: Namespace, meshes: Mapping[str, bytes]) -> None:
        """Publish the robot's shapes and fixed frames, also for late subscribers."""
        messages: tuple[Message, ...] = (
            String(data=portable(where.urdf, meshes)),
            fixed_frames(where.urdf, where.prefix),
        )
        for (name, kind), message in zip(DESCRIBED.items(), messages, strict=True):
            key, gid = self._declare("MP", where.whole(name), _type(kind), LATCHED)
            publisher = zenoh.ext.declare_advanced_publisher(
                self._side.session,
                key,
                cache=zenoh.ext.CacheConfig(LATCHED.depth),
                sample_miss_detection=MISSES,
                publisher_detection=True,
            )
            publisher.put(cdr.encode(message), attachment=attachment_of(1, gid))
            self._side.keep(publisher)

    def _publish(
        self, heard: Topic[Any], robot: str, name: str, topic: Topic[Any], where: Namespace
    ) -> None:
        """Publish messages of the topic `heard` in ROS while it has subscribers there."""
        listeners = self._bus.listeners(of_robot(heard, robot))
        for one in publications(topic, name, where):
            try:
                kind = _type(one.kind)
            except RosTypeError as error:
                logger.warning("msg=%r", f"not to be seen in ROS: {error}")
                continue
            key, gid = self._declare("MP", where.whole(one.name), kind, one.qos)
            publisher = self._side.session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP
            )
            match = partial(_match, self._bus.queue, listeners, _sender(publisher, gid, one))
            self._side.keep(publisher, publisher.declare_matching_listener(direct(match)))

    def _take(self, topic: Topic[Any], robot: str, one: RosTopic, where: Namespace) -> None:
        """Publish samples from ROS on the plain key, without a stamp."""
        name, kind = where.whole(one.name), _type(one.kind)
        key = self._side.key(name, *kind)
        refusals = Refusals(self._bus.queue, self._bus.refuse)
        source, on_bus = join_key(_source(one.name), robot), of_robot(topic, robot)

        def message_of(sample: zenoh.Sample) -> Message:
            if len(sample.payload) > topic.max_bytes:
                raise RefusedError(f"payload of more than {topic.max_bytes} bytes")
            if str(sample.key_expr) != key:
                raise RefusedError("put on another key expression")
            attached(sample)  # no ROS node sends or accepts a sample without an attachment
            message: Message = one.convert(cdr.decode(sample.payload.to_bytes(), one.kind))
            refuse_implausible(topic.key, message)
            return message

        def receive(sample: zenoh.Sample) -> None:
            try:
                inbox.receive(message_of(sample))
            except RefusedError as refusal:
                refusals.add(source, str(refusal))

        def take(message: Message) -> bool:
            self._put(on_bus, message)
            return True

        inbox: Inbox[Message] = Inbox(self._bus.queue, take, lambda _: True)
        subscriber = self._side.session.declare_subscriber(
            key, direct(receive), allowed_origin=zenoh.Locality.REMOTE
        )
        self._side.keep(subscriber)
        self._declare("MS", name, kind)

    def _serve_parameters(self, service: str, robot: str, where: Namespace) -> None:
        """Answer the services for the parameters of a node, whichever process it is in."""

        def ask(call: Call[Any, Any], request: Message) -> Any:
            return self._bus.call(call_of_robot(call, self._robot), request)

        parameters = NodeParameters(service, robot, ask)
        for one in PARAMETER_SERVICES:
            name = f"{ros_name(service)}/{one.name}"
            key = self._side.key(where.whole(name), *_service_type(one))
            self._serve(key, name, by_parameters(one, parameters))

    def _serve(self, key: str, name: str, respond: Respond) -> None:
        source = join_key(_source(name), self._robot)
        self._side.keep(serve(self._side.session, self._bus, key, source, respond))

    def _ask(self, call: Call[Any, Any], request: Message, reply: Reply[Any]) -> None:
        """Pass a query to its server in this process, which answers now or later."""
        self._bus.server(call_of_robot(call, self._robot))(request, reply)

    def _declare(
        self,
        kind: str,
        name: str,
        of: tuple[str, str],
        qos: Qos = Qos(),  # noqa: B008
    ) -> tuple[str, bytes]:
        """Let ROS see an endpoint; return its key and its identity.

        A client may use a subscription or a service as soon as ROS sees it. So declare it first.
        """
        dds, hashed = of
        token = self._node.endpoint(
            next(self._side.numbers), kind, name, dds, self._side.shown(hashed), qos
        )
        self._side.declare_token(token)
        return self._side.key(name, dds, hashed), gid_of(token)


def _sender(publisher: zenoh.Publisher, gid: bytes, one: RosTopic) -> Send:
    """Return a function that publishes messages in ROS, except those from outside (no stamp)."""
    sequence = count(1)

    def send(message: Message, stamp: Stamp | None) -> None:
        seen = None if stamp is None else one.convert(message)
        if seen is not None:
            publisher.put(cdr.encode(seen), attachment=attachment_of(next(sequence), gid))

    return send


def _match(queue: Queue, listeners: list[Send], send: Send, status: zenoh.MatchingStatus) -> None:
    """Keep `send` among the listeners, on the process's thread, while the topic has subscribers."""

    def change() -> None:
        if status.matching != (send in listeners):
            (listeners.append if status.matching else listeners.remove)(send)

    queue.put(change)


def _type(kind: type[Message]) -> tuple[str, str]:
    """Return a message's type in DDS's spelling, and its hash."""
    return dds_type(kind.ROS_TYPE), type_hash(kind)


def _service_type(service: Service) -> tuple[str, str]:
    """Return a service's type in DDS's spelling, and its hash."""
    return dds_type(service.kind), service_hash(service.kind, *service.interface)


def _source(name: str) -> str:
    """Return the name under which refused samples and requests from ROS are counted."""
    return f"ros2/{name}"


def _is_common(row: Row, topic: Topic[Any]) -> bool:
    """Return whether a row publishes a topic for all robots together."""
    return row.owns_time or topic.shared


def _taker(graph: Graph, topic: Topic[Any]) -> Row | None:
    """Return the only node that receives a topic from ROS; others receive it on the plain key."""
    takers = (
        row
        for row in graph.rows
        if topic in [given.topic for given in row.inputs] and not row.observes and not row.shared
    )
    return next(takers, None)
