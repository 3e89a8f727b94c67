"""What ROS sees of a robot with all its senses: every token, every key, every payload."""

import json
import time
from collections import defaultdict
from typing import Any

import msgspec
import pytest
from harness import SCENARIOS
from mecazen.graph import OBSERVERS
from mecazen.keys import TOPICS, of_robot
from mecazen.loading import load_scenario, parse_settings
from mecazen_ros.types import definition, message
from ros import grammar
from ros.node import Received

MORE = {
    "senses": ('sensor.also=["depth"]', "sensors.depth={rate_hz=5.0, width=32, height=24}"),
    "convoy": (),
}
MOST = 30
"""Number of samples of a topic that are read."""


class Seen:
    """A scenario, and what it publishes in ROS within some time, and on plain keys."""

    def __init__(self, running: Any, node: Any, peer: Any) -> None:
        self.peer, self.robots = peer, running.scenario.names
        namespace = running.scenario.bus.namespace
        self.prefix = f"/{namespace}/"
        self.plain: dict[tuple[str, int], list[Any]] = defaultdict(list)
        """By key and the stamp in the header; a tick's command may be computed again."""
        for robot in dict.fromkeys(("", *self.robots)):
            for topic in TOPICS:
                if "*" not in topic.key and not (topic.shared and robot):
                    on_bus = of_robot(topic, robot)
                    running.bus.subscribe(on_bus, self._keeper(on_bus.key), every=True)
        self.received: list[Received] = node.subscribe("0/**")
        nodes = [part for part in running.scenario.parts if part[0] not in OBSERVERS]
        self.entities: list[grammar.Entity] = node.entities(namespace, len(nodes))
        # latched samples come only to subscribers that ask for them, parameters when they change
        names = {end.data.name for end in self.of("MP") if not end.latched}
        names = {name for name in names if not name.endswith("/sim/parameters")}
        running.wait(lambda: names <= {grammar.key(s.key).name for s in [*self.received]})
        running.wait(lambda: sum("Clock" in sample.key for sample in [*self.received]) > 2 * MOST)

    def _keeper(self, key: str) -> Any:
        def keep(message: Any, stamp: Any) -> None:
            if stamp is not None:
                time_ns = message.header.stamp.ns if hasattr(message, "header") else stamp.time_ns
                self.plain[key, time_ns].append(message)

        return keep

    def of(self, kind: str) -> list[grammar.Entity]:
        return [end for end in self.entities if end.kind == kind]

    def read(self, name: str) -> list[dict[str, Any]]:
        """The first messages of a ROS topic, as an independent decoder reads them."""
        samples = [s for s in self.received if grammar.key(s.key).name == name][:MOST]
        (kind,) = {grammar.key(sample.key).type for sample in samples}
        text = definition(message(kind))
        return [grammar.message(sample.payload, kind, text) for sample in samples]


@pytest.fixture(scope="module", params=MORE)
def seen(request, up, raw_node, start_peer):
    path, settings = SCENARIOS / f"{request.param}.toml", MORE[request.param]
    services = [
        part
        for part in load_scenario(path, parse_settings(settings)).services
        if part not in OBSERVERS
    ]
    running = up(path, *settings, f"processes=[{json.dumps(services)}]")
    return Seen(running, raw_node(running.endpoint), start_peer(running.endpoint, "client"))


def test_every_endpoint_has_a_number_and_a_node(seen):
    ids = [(end.zid, end.id) for end in seen.entities]
    assert len(ids) == len(set(ids))
    nodes = {(end.zid, end.node_id): (end.namespace, end.node) for end in seen.of("NN")}
    # two nodes of one name are two in `ros2 node list`, with a warning
    assert len(set(nodes.values())) == len(nodes)
    for end in seen.entities:
        assert nodes[end.zid, end.node_id] == (end.namespace, end.node)


def test_every_hash_is_that_of_the_sdk(seen):
    kinds = {(end.data.type, end.data.hash) for end in seen.entities if end.data}
    hashes = {kind: type_hash for kind, type_hash in kinds if "/msg/" in kind}
    assert len(hashes) > 5
    assert hashes == {kind: seen.peer("type_hash", kind) for kind in hashes}


def test_samples_have_a_token_and_count_up(seen):
    assert {grammar.key(s.key) for s in seen.received} <= {end.data for end in seen.of("MP")}
    numbers = defaultdict(list)
    for sample in seen.received:
        sequence, time_ns, gid = grammar.attachment(sample.attachment)
        assert abs(time_ns - time.time_ns()) < 60e9
        numbers[sample.key, gid].append(sequence)
    for sequence in numbers.values():  # a full link drops samples
        assert sequence == sorted(set(sequence))
        assert sequence[0] >= 1
    assert len({gid for _, gid in numbers}) == len(numbers)


def stamp_of(message: dict[str, Any]) -> int:
    stamp = message["header"]["stamp"]
    return int(stamp["sec"] * 10**9 + stamp["nanosec"])


def bare(value: Any, prefix: str) -> Any:
    """A message of ROS without the prefix of its frames."""
    if isinstance(value, dict):
        return {
            name: (part.removeprefix(prefix) if name.endswith("frame_id") else bare(part, prefix))
            for name, part in value.items()
        }
    return [bare(item, prefix) for item in value] if isinstance(value, list) else value


def of_plain(message: Any) -> Any:
    """A message of a plain key as the fields that ROS should have."""
    return json.loads(
        json.dumps(msgspec.to_builtins(message, builtin_types=(bytes,)), default=list)
    )


# those that are not converted for ROS
@pytest.mark.parametrize(
    "key", ["joint_states", "joint_command", "target/skeleton", "skeleton/observation",
            "legs/observation", "camera/depth", "camera/camera_info", "follower/state"],
)  # fmt: skip
def test_fields_are_those_of_the_plain_key_at_the_same_stamp(seen, key):
    compared = 0
    for robot in seen.robots:
        plain_key = f"{robot}/{key}".lstrip("/")
        if any(k == plain_key for k, _ in seen.plain):
            prefix = f"{seen.prefix}{robot}/".replace("//", "/").lstrip("/")
            for shown in seen.read(seen.prefix + plain_key):
                if plain := seen.plain.get((plain_key, stamp_of(shown))):
                    assert repr(bare(shown, prefix)) in [repr(of_plain(same)) for same in plain]
                    compared += 1
    assert compared > 0 or not any(k.endswith(f"/{key}") or k == key for k, _ in seen.plain)


def test_each_robots_base_is_in_the_tree_where_odometry_has_it(seen):
    parents, compared = defaultdict(set), 0
    for frame in [f for shown in seen.read("/tf") for f in shown["transforms"]]:
        parent, child = frame["header"]["frame_id"], frame["child_frame_id"]
        parents[child].add(parent)
        key = parent.removeprefix(seen.prefix[1:])
        odom = seen.plain.get((key, stamp_of(frame)))
        if odom and not child.endswith("person"):
            transform = frame["transform"]
            pose = {"position": transform["translation"], "orientation": transform["rotation"]}
            assert pose in [of_plain(same.pose.pose) for same in odom]
            assert child.endswith(odom[0].child_frame_id)
            compared += 1
    assert compared > 10
    assert all(len(above) == 1 for above in parents.values()), parents
