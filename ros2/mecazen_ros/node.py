"""The services of a process as ROS 2 nodes, in rmw_zenoh's protocol or behind the DDS bridge.

They have a Zenoh session without a namespace, which would hide them from ROS. The session is a
client: of mecazen's router, of `rmw_zenohd`, or of `zenoh-bridge-ros2dds`, whose keys are the names
of topics and services, and whose payloads are CDR without attachments. A ROS topic is published
only while it has a subscriber. Messages from ROS are published on the plain key.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any, cast

import msgspec
import zenoh
import zenoh.ext
from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import Queue, ZenohBus, direct
from mecazen.config import BusConfig, Scenario
from mecazen.errors import RefusedError
from mecazen.graph import SHARED, Graph
from mecazen.keys import Call, Topic, call_of_robot, of_robot
from mecazen.messages import Message, String
from mecazen.programs import graph_of
from mecazen.robots import join_key
from mecazen.row import Row
from mecazen.urdf import ask_description, portable_urdf
from mecazen.wire import Stamp

from mecazen_ros import cdr, protocol, services, topics
from mecazen_ros.services import Respond, RosService
from mecazen_ros.topics import RosTopic, full_name, ros_name
from mecazen_ros.types import RosTypeError, registered, type_hash

logger = logging.getLogger(__name__)

Put = Callable[[Topic[Any], Message], None]
Send = Callable[[Message, Stamp | None], None]
DESCRIPTION_TIMEOUT_S = 10.0
CACHED: dict[str, Any] = {
    "cache": zenoh.ext.CacheConfig(1),
    "sample_miss_detection": zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
    "publisher_detection": True,
}
"""Options of a latched topic, as in rmw_zenoh."""


def of_ros(config: BusConfig) -> BusConfig:
    """Return the settings of a session for ROS: a client without a namespace."""
    endpoints = config.ros_bridge or config.ros_connect or config.connect
    return msgspec.structs.replace(
        config, mode="client", namespace=None, connect=endpoints, ros_bridge=None
    )


class RosSession:
    """The session of a process's ROS nodes.

    Args:
        config: Endpoints, domain and distribution of ROS.
        name: Name of the certificate that the session shows, if certificates are used.
        bus: Bus of the process.
        put: Publishes a message without a stamp, in this process and elsewhere.
    """

    def __init__(self, config: BusConfig, name: str, bus: ZenohBus, put: Put) -> None:
        self.config, self.bus, self.put = config, bus, put
        self.is_bridged = bool(config.ros_bridge)
        server = "zenoh-bridge-ros2dds" if self.is_bridged else "the router"
        self.session = open_session(of_ros(config), "client", name, server=server, timestamps=True)
        self.numbers = count()
        """Numbers for nodes and their endpoints."""
        self.kept: list[object] = []
        """Declared objects, since Zenoh undeclares objects without reference."""
        self._tokens: dict[str, object] = {}

    def type(self, name: str) -> str:
        """Return a type in DDS's spelling with its hash, as in keys and tokens."""
        is_humble = self.config.ros_distro == "humble"
        return f"{protocol.dds_type(name)}/{protocol.NO_HASH if is_humble else type_hash(name)}"

    def key(self, name: str, ros_type: str) -> str:
        """Return the key of a topic's samples, or of a service's requests."""
        if self.is_bridged:
            return name
        return f"{self.config.ros_domain_id}/{name}/{self.type(ros_type)}"

    def attachment(self, sequence: int, gid: bytes) -> bytes | None:
        """Return the attachment of a sample or a reply; None if the bridge expects none."""
        return None if self.is_bridged else protocol.attachment(sequence, gid)

    def sequence_and_gid(self, received: zenoh.Sample | zenoh.Query) -> tuple[int, bytes]:
        """Return what an attachment must have; a bridge sends none, or one of its own."""
        return (0, b"") if self.is_bridged else protocol.sequence_and_gid(received)

    def declare_token(self, token: str) -> None:
        """Declare the liveliness token by which ROS sees a node or an endpoint, if not yet."""
        if token not in self._tokens:
            self._tokens[token] = self.session.liveliness().declare_token(token)

    def close(self) -> None:
        self.session.close()  # type: ignore[no-untyped-call]


class RosNode:
    """A service as a ROS node, with its publishers, subscriptions and services.

    `robot` names the service's robot, whose scenario it is, if there are several robots.
    """

    def __init__(self, ros: RosSession, name: str, robot: str, scenario: Scenario) -> None:
        self._ros, self._robot, self._bus = ros, robot, ros.bus
        graph = graph_of(scenario)
        self._name, self._number = ros_name(name), next(ros.numbers)
        self._namespace = scenario.bus.namespace or ""
        ros.declare_token(self._token(self._number, "NN"))
        for row in graph.services.get(name, ()):
            common = [topic for topic in row.outputs if row.owns_time or topic.shared]
            for topic in common:
                self._publish(row, topic, robot, self._namespace)
            for scenario_robot in scenario.names:
                namespace = self._within(scenario_robot)
                for topic in row.outputs:
                    if topic not in common:
                        self._publish(row, topic, scenario_robot or robot, namespace)
                self._add(row, graph, scenario_robot or robot, namespace)
            for service in services.OF_SIMULATION:
                if service.call in row.calls:
                    self._serve(service.name, self._namespace, service, partial(self._ask, service))
                    full = full_name(service.name, self._namespace)
                    self._declare("SS", full, service.kind)
            if keys.SET_PARAMETERS in row.calls:
                for node in scenario.services:
                    for node_robot in ("",) if node in SHARED else scenario.names:
                        self._serve_parameters(node, node_robot)
        if name in scenario.services:
            for service in services.OF_NODE:
                full = full_name(f"{self._name}/{service.name}", self._namespace)
                self._declare("SS", full, service.kind, topics.PARAMETERS)
        self._publish(Row(name), keys.diagnostics(name), robot, self._namespace)

    def _within(self, robot: str) -> str:
        return join_key(robot, self._namespace) if robot else self._namespace

    def _add(self, row: Row, graph: Graph, robot: str, namespace: str) -> None:
        if keys.ROBOT_DESCRIPTION in row.calls:
            self._describe(robot, namespace)
        for topic in (row_input.topic for row_input in row.inputs):
            if _receiver(graph, topic) is row and not topic.by_hand:
                key, has_source = self._key_of(topic, robot), graph.giver(topic.key) is not None
                received = topics.subscriptions(topic, key, has_source=has_source)
                # a bridge has one key for all types, and `decode` takes a TwistStamped for a Twist
                for ros_topic in received[:1] if self._ros.is_bridged else received:
                    self._subscribe(of_robot(topic, robot), robot, ros_topic, namespace)

    def _key_of(self, topic: Topic[Any], robot: str) -> str:
        key = self._bus.key_of(of_robot(topic, robot))
        return key.removeprefix(f"{robot}/") if robot else key

    def _describe(self, robot: str, namespace: str) -> None:
        """Publish the robot's shapes and fixed frames, also for late subscribers."""
        urdf, meshes = ask_description(self._bus, robot, DESCRIPTION_TIMEOUT_S)
        frames = topics.fixed_frames(urdf, join_key("", namespace))
        messages = String(data=portable_urdf(urdf, meshes)), frames
        for (name, kind), message in zip(topics.DESCRIBED.items(), messages, strict=True):
            full = full_name(name, namespace)
            key, gid = self._declare("MP", full, kind.ROS_TYPE, topics.LATCHED)
            publisher = zenoh.ext.declare_advanced_publisher(self._ros.session, key, **CACHED)
            publisher.put(cdr.encode(message), attachment=self._ros.attachment(1, gid))
            self._ros.kept.append(publisher)

    def _publish(self, row: Row, topic: Topic[Any], robot: str, namespace: str) -> None:
        listeners = self._bus.listeners(of_robot(topic, robot))
        name = topics.name_of(row, topic, self._key_of(topic, robot))
        odom_tf = self._ros.config.ros_odom_tf
        for ros_topic in topics.publications(topic, name, namespace, odom_tf=odom_tf):
            try:
                ros_type = registered(ros_topic.kind)
            except RosTypeError as error:
                logger.warning("msg=%r", f"not to be seen in ROS: {error}")
                continue
            full = full_name(ros_topic.name, namespace)
            key, gid = self._declare("MP", full, ros_type, ros_topic.qos)
            publisher = self._ros.session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP
            )
            send = _sender(publisher, partial(self._ros.attachment, gid=gid), ros_topic)
            match = partial(_match, self._bus.queue, listeners, send)
            self._ros.kept += publisher, publisher.declare_matching_listener(direct(match))

    def _subscribe(
        self, topic: Topic[Any], robot: str, ros_topic: RosTopic, namespace: str
    ) -> None:
        name = full_name(ros_topic.name, namespace)
        ros_type = registered(ros_topic.kind)
        key, source = self._ros.key(name, ros_type), join_key(f"ros2/{ros_topic.name}", robot)

        def read(sample: zenoh.Sample) -> Message:
            if len(sample.payload) > topic.max_bytes:
                raise RefusedError(f"payload of more than {topic.max_bytes} bytes")
            if str(sample.key_expr) != key:
                raise RefusedError("put on another key expression")
            self._ros.sequence_and_gid(sample)  # ROS sends and accepts no sample without it
            payload = sample.payload.to_bytes()
            return cast(Message, ros_topic.convert(cdr.decode(payload, ros_topic.kind)))

        def take(sample: zenoh.Sample) -> bool:
            try:
                message = read(sample)
            except RefusedError as refusal:
                self._bus.refuse(source, str(refusal))
                return False
            self._ros.put(topic, message)
            return True

        receive = direct(self._bus.keep_newest(take, source))
        subscriber = self._ros.session.declare_subscriber(
            key, receive, allowed_origin=zenoh.Locality.REMOTE
        )
        self._ros.kept.append(subscriber)
        if not self._ros.is_bridged:  # which takes any type from ROS, unless a token names one
            self._declare("MS", name, ros_type)

    def _serve_parameters(self, node: str, robot: str) -> None:
        """Answer the services for the parameters of a node, whichever process it is in."""

        def ask(call: Call[Any, Any], request: Message) -> Any:
            return self._bus.call(call_of_robot(call, self._robot), request)

        def answer(service: RosService, request: Message, respond: Respond) -> None:
            respond(service.response(**service.ask(parameters, request)))

        parameters = services.NodeParameters(node, robot, ask)
        for service in services.OF_NODE:
            name = f"{ros_name(node)}/{service.name}"
            self._serve(name, self._within(robot), service, partial(answer, service))

    def _ask(self, service: RosService, request: Message, respond: Respond) -> None:
        """Pass a request as a query to its server in this process, which answers now or later."""
        call, query = service.ask(request)
        self._bus.server(call_of_robot(call, self._robot))(query, service.reply(respond))

    def _serve(
        self,
        name: str,
        namespace: str,
        service: RosService,
        answer: Callable[[Message, Respond], None],
    ) -> None:
        """Answer requests on the bus's thread; count those without rmw_zenoh's attachment."""
        key = self._ros.key(full_name(name, namespace), service.kind)

        def take(query: zenoh.Query) -> None:
            try:
                sequence, gid = self._ros.sequence_and_gid(query)
            except RefusedError as refusal:
                self._bus.refuse(join_key(f"ros2/{name}", self._robot), str(refusal))
                query.drop()  # type: ignore[no-untyped-call]
                return

            def respond(message: Message) -> None:
                with query:
                    attachment = self._ros.attachment(sequence, gid)
                    query.reply(key, cdr.encode(message), attachment=attachment)

            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                answer(cdr.decode(payload, service.request), respond)
            except RefusedError as refusal:
                respond(service.respond(services.UNSUPPORTED, str(refusal)))

        receive = direct(self._bus.keep_every(take))
        queryable = self._ros.session.declare_queryable(key, receive, complete=True)
        self._ros.kept.append(queryable)

    def _declare(
        self, kind: str, name: str, ros_type: str, qos: str = topics.RELIABLE
    ) -> tuple[str, bytes]:
        """Let ROS see an endpoint (MP, MS or SS); return its key and its identity.

        A client may use a subscription or a service as soon as ROS sees it. So declare it first.
        """
        end = f"{protocol.mangled(name)}/{self._ros.type(ros_type)}/{qos}"
        if self._ros.is_bridged:
            end = protocol.bridge_token(kind, name, ros_type, qos)
        token = f"{self._token(next(self._ros.numbers), kind)}/{end}"
        self._ros.declare_token(token)
        return self._ros.key(name, ros_type), protocol.gid_of(token)

    def _token(self, number: int, kind: str) -> str:
        """Return the liveliness token of the node or bridge, or the beginning of an endpoint's."""
        session, namespace = self._ros.session.info.zid(), protocol.mangled(self._namespace)
        if self._ros.is_bridged:
            return f"@/{session}/{protocol.ADMIN}"
        place = f"{self._ros.config.ros_domain_id}/{session}/{self._number}/{number}"
        return f"{protocol.ADMIN}/{place}/{kind}/%/{namespace}/{self._name}"


def _sender(
    publisher: zenoh.Publisher, attach: Callable[[int], bytes | None], ros_topic: RosTopic
) -> Send:
    """Return a function that publishes messages in ROS, except those from outside (no stamp)."""
    sequence = count(1)

    def send(message: Message, stamp: Stamp | None) -> None:
        converted = None if stamp is None else ros_topic.convert(message)
        if converted is not None:
            publisher.put(cdr.encode(converted), attachment=attach(next(sequence)))

    return send


def _match(queue: Queue, listeners: list[Send], send: Send, status: zenoh.MatchingStatus) -> None:
    """Keep `send` among the listeners, on the process's thread, while the topic has subscribers."""

    def change() -> None:
        if status.matching != (send in listeners):
            (listeners.append if status.matching else listeners.remove)(send)

    queue.put(change)


def _receiver(graph: Graph, topic: Topic[Any]) -> Row | None:
    """Return the only node that receives a topic from ROS; others receive it on the plain key."""
    rows = (row for row in graph.rows if not row.observes and not row.shared)
    return next((row for row in rows if topic in [i.topic for i in row.inputs]), None)
