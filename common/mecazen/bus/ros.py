"""The ROS 2 side of a process: its services as ROS nodes, in rmw_zenoh's protocol.

A Zenoh session of its own, since a namespace would hide it from ROS, and a client, so that it can
be one of `rmw_zenohd` as well as of mecazen's router. It hears what the services of the process
publish as another of them would, but only while somebody in ROS subscribes; else it costs
nothing. What it takes from ROS it publishes on the plain key, as any external publisher would.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any

import zenoh
import zenoh.ext

from mecazen import keys
from mecazen.bus.base import Handler
from mecazen.bus.inbox import Inbox, Queue, Refusals
from mecazen.bus.receiving import direct
from mecazen.bus.ros_queries import Respond, attached, attachment_of, by_parameters, by_query, serve
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig, Scenario
from mecazen.description import RobotDescription, ask_description
from mecazen.graph import Graph
from mecazen.keys import Topic
from mecazen.limits import refuse_implausible
from mecazen.messages import Message, String
from mecazen.ros import cdr
from mecazen.ros.description import fixed_frames, portable
from mecazen.ros.fields import RosTypeError
from mecazen.ros.parameters import PARAMETER_SERVICES, NodeParameters, ParameterService
from mecazen.ros.protocol import (
    LATCHED,
    NO_HASH,
    PARAMETERS,
    Node,
    Qos,
    data_key,
    gid_of,
)
from mecazen.ros.services import SERVICES, Service
from mecazen.ros.types import dds_type, service_hash, type_hash
from mecazen.ros.view import DESCRIBED, Entry, Place, entries, name_of, ros_name, views
from mecazen.row import Row
from mecazen.wire import RefusedError, Stamp

logger = logging.getLogger(__name__)

DESCRIPTION_S = 10.0
"""How long the description of a robot may take."""
MISSES = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5)
"""How soon those who missed a latched sample learn of it, as in rmw_zenoh [s]."""


class RosSide:
    """The session of a process's ROS nodes.

    Args:
        config: Where to meet, and how ROS is spoken.
        name: Whose certificate the session shows, where there are certificates.

    Raises:
        BusError: See `open_session`.
    """

    def __init__(self, config: BusConfig, name: str) -> None:
        self.domain = config.ros_domain_id
        self._has_hashes = config.ros_distro != "humble"
        self.session = open_session(config.of_ros, "client", name, timestamps=True)
        self.id = str(self.session.info.zid())
        self.numbers = count()
        """Of nodes and their endpoints."""
        self._kept: list[object] = []

    def keep(self, *declared: object) -> None:
        """Keep what Zenoh undeclares when nobody has it any more."""
        self._kept += declared

    def shown(self, hashed: str) -> str:
        """Return what keys and tokens have of a type's hash."""
        return hashed if self._has_hashes else NO_HASH

    def key(self, name: str, dds: str, hashed: str) -> str:
        """Return the key of a topic or a service by its whole name and its type."""
        return data_key(self.domain, name, dds, self.shown(hashed))

    def declare_token(self, token: str) -> None:
        """Let ROS see a node or one of its endpoints."""
        self.keep(self.session.liveliness().declare_token(token))

    def close(self) -> None:
        """Leave ROS; what was declared goes with the session."""
        self.session.close()  # type: ignore[no-untyped-call]


class RosNode:
    """A service as a ROS node, with all that it publishes, takes and answers.

    Args:
        side: Of the service's process.
        name: The service's.
        robot: Its robot, if there are several and it belongs to one.
        bus: What it publishes on.
        scenario: As its robot sees it.
        graph: The nodes of the scenario.
        put: Publishes a message without a stamp, here and elsewhere.
    """

    def __init__(
        self,
        side: RosSide,
        name: str,
        robot: str,
        bus: ZenohBus,
        scenario: Scenario,
        graph: Graph,
        put: Callable[[Topic[Any], Message], None],
    ) -> None:
        self._put = put
        namespace = scenario.bus.namespace or ""
        self._side = side
        self._node = Node(side.domain, side.id, next(side.numbers), namespace, ros_name(name))
        self._bus = bus
        side.declare_token(self._node.token)
        here = Place(namespace)
        for row in graph.services.get(name, ()):
            for other in scenario.names:
                self._add(row, graph, robot or other, here.within(other))
            for topic in row.outputs:
                if _is_common(row, topic):
                    self._publish(bus.listeners(topic), topic, name_of(row, topic), here)
            for service in SERVICES:
                if service.call in row.calls:
                    self._serve(service, here)
            if keys.SET_PARAMETERS in row.calls:
                for part, one in scenario.parts:
                    self._serve_parameters(part, one, here.within(one))
        if name in scenario.services:
            for service_of_parameters in PARAMETER_SERVICES:
                whole = here.whole(f"{ros_name(name)}/{service_of_parameters.name}")
                self._declare("SS", whole, *_service_type(service_of_parameters), PARAMETERS)
        health = keys.diagnostics(name)
        hearing = bus.listeners(keys.of_robot(health, robot))
        self._publish(hearing, health, health.key, here)

    def _add(self, row: Row, graph: Graph, robot: str, place: Place) -> None:
        """Declare what a row gives and takes of one robot."""
        if keys.ROBOT_DESCRIPTION in row.calls:
            description = ask_description(self._bus, robot, DESCRIPTION_S)
            place = place._replace(urdf=description.urdf)
            self._describe(description, place)
        for topic in row.outputs:
            if not _is_common(row, topic):
                hearing = self._bus.listeners(keys.of_robot(row.on_bus(topic), robot))
                self._publish(hearing, topic, name_of(row, topic), place)
        for given in row.inputs:
            if _taker(graph, given.topic) is row:
                topic = row.on_bus(given.topic)
                for entry in entries(given.topic, topic.key):
                    self._take(keys.of_robot(topic, robot), entry, place)

    def _describe(self, description: RobotDescription, place: Place) -> None:
        """Publish the robot's shapes and fixed frames, for whoever comes whenever."""
        messages: tuple[Message, ...] = (
            String(data=portable(place.urdf, description.meshes)),
            fixed_frames(place.urdf, place.prefix),
        )
        for (name, kind), message in zip(DESCRIBED.items(), messages, strict=True):
            key, gid = self._declare("MP", place.whole(name), *_type(kind), LATCHED)
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
        self, hearing: list[Handler[Any]], topic: Topic[Any], name: str, place: Place
    ) -> None:
        """Have ROS hear, while somebody subscribes, what this process publishes on a topic."""
        for view in views(topic, name, place):
            try:
                kind = _type(view.kind)
            except RosTypeError as error:
                logger.warning("msg=%r", f"not to be seen in ROS: {error}")
                continue
            ros_key, gid = self._declare("MP", place.whole(view.name), *kind, view.qos)
            publisher = self._side.session.declare_publisher(
                ros_key, congestion_control=zenoh.CongestionControl.DROP
            )
            twin = _Twin(publisher, gid, view.convert, hearing)
            listener = publisher.declare_matching_listener(
                direct(_calling(self._bus.queue, twin.match))
            )
            self._side.keep(publisher, listener)

    def _take(self, topic: Topic[Any], entry: Entry, place: Place) -> None:
        """Publish on the plain key, without a stamp, what comes from ROS."""
        bus = self._bus
        key, _ = self._declare("MS", place.whole(entry.name), *_type(entry.kind), Qos())
        source = _source(entry.name)
        refusals = Refusals(bus.queue, bus.refuse)

        def message_of(sample: zenoh.Sample) -> Message:
            if str(sample.key_expr) != key:
                raise RefusedError("put on another key expression")
            attached(sample)  # without one it is of no ROS node, and none would take it
            message = entry.convert(cdr.decode(sample.payload.to_bytes(), entry.kind))
            refuse_implausible(topic.name, message)
            return message

        def take(sample: zenoh.Sample) -> bool:
            try:
                message = message_of(sample)
            except RefusedError as refusal:
                bus.refuse(source, str(refusal))
                return False
            self._put(topic, message)
            return True

        def is_good(sample: zenoh.Sample) -> bool:
            try:
                message_of(sample)
            except RefusedError as refusal:
                refusals.add(source, str(refusal))
                return False
            return True

        def receive(sample: zenoh.Sample) -> None:
            if len(sample.payload) > topic.max_bytes:
                refusals.add(source, f"payload of more than {topic.max_bytes} bytes")
            else:
                inbox.receive(sample)

        inbox = Inbox(bus.queue, take, is_good)
        subscriber = self._side.session.declare_subscriber(
            key, direct(receive), allowed_origin=zenoh.Locality.REMOTE
        )
        self._side.keep(subscriber)

    def _serve(self, service: Service, place: Place) -> None:
        """Answer a ROS service by a query that this process answers."""
        key, _ = self._declare("SS", place.whole(service.name), *_service_type(service), Qos())
        self._answer(key, service.name, by_query(service, self._bus))

    def _serve_parameters(self, service: str, robot: str, place: Place) -> None:
        """Answer the services for the parameters of a node, whichever process it is in."""
        parameters = NodeParameters(service, robot, self._bus.call)
        for one in PARAMETER_SERVICES:
            name = f"{ros_name(service)}/{one.name}"
            key = self._side.key(place.whole(name), *_service_type(one))
            self._answer(key, name, by_parameters(one, parameters))

    def _answer(self, key: str, name: str, respond: Respond) -> None:
        self._side.keep(serve(self._side.session, self._bus, key, _source(name), respond))

    def _declare(self, kind: str, name: str, dds: str, hashed: str, qos: Qos) -> tuple[str, bytes]:
        """Let ROS see an endpoint; return its key and its identity."""
        token = self._node.endpoint(
            next(self._side.numbers), kind, name, dds, self._side.shown(hashed), qos
        )
        self._side.declare_token(token)
        return self._side.key(name, dds, hashed), gid_of(token)


class _Twin:
    """Publishes in ROS what is published on a topic, while somebody there subscribes."""

    def __init__(
        self,
        publisher: zenoh.Publisher,
        gid: bytes,
        convert: Callable[[Any], Message | None],
        hearing: list[Handler[Any]],
    ) -> None:
        self._publisher = publisher
        self._gid = gid
        self._convert = convert
        self._hearing = hearing
        self._sent = 0

    def match(self, status: zenoh.MatchingStatus) -> None:
        """Hear what is published from when somebody subscribes until nobody does."""
        if status.matching and self.send not in self._hearing:
            self._hearing.append(self.send)
        elif not status.matching and self.send in self._hearing:
            self._hearing.remove(self.send)

    def send(self, message: Message, stamp: Stamp | None) -> None:
        """Publish a message; not what comes from outside, perhaps from ROS itself."""
        seen = None if stamp is None else self._convert(message)
        if seen is not None:
            self._sent += 1
            self._publisher.put(cdr.encode(seen), attachment=attachment_of(self._sent, self._gid))


def _type(kind: type[Message]) -> tuple[str, str]:
    """Return a message's type in DDS's spelling, and its hash."""
    return dds_type(kind.ROS_TYPE), type_hash(kind)


def _service_type(service: Service | ParameterService) -> tuple[str, str]:
    """Return the same of a service's type."""
    hashed = service_hash(service.kind, service.request, service.response)
    return dds_type(service.kind), hashed


def _calling(queue: Queue, work: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return what Zenoh's threads may call to have the service's thread do some work."""
    return lambda given: queue.put(partial(work, given))


def _source(name: str) -> str:
    """Return the name under which refusals of what comes from ROS are counted."""
    return f"ros2/{name}"


def _is_common(row: Row, topic: Topic[Any]) -> bool:
    """Return whether a row gives a topic for all robots together."""
    return row.owns_time or topic.shared


def _taker(graph: Graph, topic: Topic[Any]) -> Row | None:
    """Return the one node that takes a topic from ROS; others hear it on the plain key."""
    takers = (
        row
        for row in graph.rows
        if topic in [given.topic for given in row.inputs] and not row.observes and not row.shared
    )
    return next(takers, None)
