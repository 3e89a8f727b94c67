"""What ROS sees of a robot with all its senses: every token, every key, every payload."""

import json
import math
import time
from collections import defaultdict
from typing import Any

import msgspec
import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.graph import OBSERVERS
from mecazen.keys import TOPICS, of_robot
from mecazen.loading import load_scenario
from ros import grammar
from ros.node import Heard

MORE = {
    "senses": ('sensor.also=["depth"]', "sensors.depth={rate_hz=5.0, width=32, height=24}"),
    "convoy": (),
}
MOST = 30
"""So many samples of a topic are read: cyclonedds takes a while."""


class Seen:
    """A scenario, and what it says to ROS within some time, with what it says on plain keys."""

    def __init__(self, running: Any, node: Any, side: Any) -> None:
        self.side = side
        self.robots = running.scenario.names
        self.prefix = f"/{running.scenario.bus.namespace}/"
        self.plain: dict[tuple[str, int], list[Any]] = defaultdict(list)
        """By key and the stamp in the header; a tick's command may be computed again."""
        self._read: dict[str, list[dict[str, Any]]] = {}
        for robot in dict.fromkeys(("", *running.scenario.names)):
            for topic in TOPICS:
                if "*" not in topic.key and not (topic.shared and robot):
                    on_bus = of_robot(topic, robot)
                    running.bus.subscribe(on_bus, self._keep(on_bus.key), every=True)
        self.heard: list[Heard] = node.hear("0/**")
        self.tokens = node.tokens()
        self.entities = [grammar.token(token) for token in self.tokens]
        # latched samples come only to subscribers that ask for them, parameters when they change
        given = {one.data.name for one in self.of("MP") if not one.latched}
        given = {name for name in given if not name.endswith("/sim/parameters")}
        self.missing = set(given)
        seen = 0

        def has_come() -> bool:
            nonlocal seen
            for one in self.heard[seen:]:
                self.missing.discard(grammar.key(one.key).name)
                seen += 1
            return not self.missing

        running.wait(has_come)
        clocks = [one for one in self.heard if "Clock" in one.key]
        running.wait(lambda: sum("Clock" in one.key for one in self.heard) > len(clocks) + MOST)

    def _keep(self, key: str) -> Any:
        def keep(message: Any, stamp: Any) -> None:
            if stamp is not None:
                time_ns = message.header.stamp.ns if hasattr(message, "header") else stamp.time_ns
                self.plain[key, time_ns].append(message)

        return keep

    def of(self, kind: str) -> list[grammar.Entity]:
        return [one for one in self.entities if one.kind == kind]

    def read(self, name: str) -> list[dict[str, Any]]:
        """The first messages of a ROS topic, as cyclonedds reads them."""
        if name not in self._read:
            found = [one for one in self.heard if grammar.key(one.key).name == name][:MOST]
            (kind,) = {grammar.key(one.key).type for one in found}
            self._read[name] = self.side("read", kind, [one.payload.hex() for one in found])
        return self._read[name]


@pytest.fixture(scope="module", params=MORE)
def seen(request, up, raw_node, ros_side):
    path = SCENARIOS / f"{request.param}.toml"
    services = [
        one for one in load_scenario(path, MORE[request.param]).services if one not in OBSERVERS
    ]
    running = up(path, *MORE[request.param], f"processes=[{json.dumps(services)}]")
    return Seen(running, raw_node(running.endpoint), ros_side(running.endpoint, "client"))


def test_every_token_is_of_the_grammar_and_no_two_say_the_same(seen):
    assert len(seen.tokens) == len(set(seen.tokens))
    ids = [(one.zid, one.id) for one in seen.entities]
    assert len(ids) == len(set(ids))
    nodes = {(one.zid, one.node_id): (one.namespace, one.node) for one in seen.of("NN")}
    # two nodes of one name are two in `ros2 node list`, with a warning
    assert len(set(nodes.values())) == len(nodes)
    for one in seen.entities:
        assert nodes[one.zid, one.node_id] == (one.namespace, one.node)


def test_every_hash_is_what_those_say_who_know_ros(seen):
    kinds = {(one.data.type, one.data.hash) for one in seen.entities if one.data}
    assert len(kinds) > 5
    for kind, said in kinds:
        known = seen.side("hashes", kind)
        assert known == dict.fromkeys(known, said)


def test_what_is_published_has_a_token_with_its_key(seen):
    tokens = {one.data for one in seen.of("MP")}
    assert {grammar.key(one.key) for one in seen.heard} <= tokens


def test_attachments_count_up_and_tell_publishers_apart(seen):
    numbers = defaultdict(list)
    for one in seen.heard:
        number, time_ns, gid = grammar.attachment(one.attachment)
        assert abs(time_ns - time.time_ns()) < 60e9
        numbers[one.key, gid].append(number)
    for sequence in numbers.values():  # a full link drops samples
        assert sequence == sorted(set(sequence))
        assert sequence[0] >= 1
    assert len({gid for _, gid in numbers}) == len(numbers)


def test_every_payload_is_what_cyclonedds_writes_of_it(seen):
    payloads = defaultdict(set)
    for one in seen.heard:
        payloads[grammar.key(one.key).type].add(one.payload.hex())
    for kind, found in payloads.items():
        assert len(seen.side("read", kind, sorted(found)[:MOST])) > 0


def stamp_of(message: dict[str, Any]) -> int:
    header = message["header"]["stamp"]
    return int(header["sec"] * 10**9 + header["nanosec"])


def bare(value: Any, prefix: str) -> Any:
    """A message of ROS without the prefix of its frames."""
    if isinstance(value, dict):
        return {
            name: (part.removeprefix(prefix) if name.endswith("frame_id") else bare(part, prefix))
            for name, part in value.items()
        }
    return [bare(one, prefix) for one in value] if isinstance(value, list) else value


def of_plain(message: Any) -> Any:
    """A message of a plain key as the fields that ROS should have."""
    fields = msgspec.to_builtins(message, builtin_types=(bytes,))
    if "ranges" in fields:  # REP-117
        most = fields["range_max"]
        fields["ranges"] = [
            math.nan if r == 0.0 else math.inf if r > most else r for r in fields["ranges"]
        ]
    for part in ("pose", "twist"):
        if "covariance" in fields.get(part, {}):  # exact values have a small variance in ROS
            fields[part]["covariance"] = [
                1e-9 if value == 0.0 and index % 7 == 0 else value
                for index, value in enumerate(fields[part]["covariance"])
            ]
    return json.loads(json.dumps(fields, default=list))


@pytest.mark.parametrize(
    "key", ["joint_states", "joint_command", "odom", "ground_truth/odom", "target/odom",
            "target/skeleton", "target/observation", "skeleton/observation", "legs/observation",
            "scan", "camera/depth", "camera/camera_info", "follower/state"],
)  # fmt: skip
def test_fields_are_those_of_the_plain_key_at_the_same_stamp(seen, key):
    compared = 0
    for name in sorted({data.name for one in seen.of("MP") if (data := one.data)}):
        plain_key = name.removeprefix(seen.prefix)
        if plain_key not in {f"{robot}/{key}".lstrip("/") for robot in seen.robots}:
            continue
        prefix = f"{name.removesuffix(key)}".lstrip("/")
        for message in seen.read(name):
            if plain := seen.plain.get((plain_key, stamp_of(message))):
                assert repr(bare(message, prefix)) in [repr(of_plain(one)) for one in plain]
                compared += 1
    given = {key for key, _ in seen.plain}
    assert compared > 0 or not any(one.endswith(key) for one in given), key


def test_the_clock_is_that_of_the_plain_key(seen):
    clocks = seen.read("/clock")
    times = [one["clock"]["sec"] * 10**9 + one["clock"]["nanosec"] for one in clocks]
    assert times == sorted(set(times))
    assert len({time_ns for time_ns in times if ("clock", time_ns) in seen.plain}) > 10


def test_the_tree_of_frames_says_where_odometry_has_the_robot(seen):
    frames = [one for message in seen.read("/tf") for one in message["transforms"]]
    compared = 0
    for one in frames:
        frame = one["header"]["frame_id"]
        if not one["child_frame_id"].endswith("base_link") or not frame.endswith("odom"):
            continue
        robot = frame.removesuffix("odom").removeprefix(seen.prefix[1:])
        if odom := seen.plain.get((f"{robot}{keys.ODOM.key}", stamp_of(one))):
            pose = {
                "position": one["transform"]["translation"],
                "orientation": one["transform"]["rotation"],
            }
            assert pose in [of_plain(same.pose.pose) for same in odom]
            compared += 1
    assert compared > 10


def test_each_frame_has_one_parent_and_all_hang_together(seen):
    parents = defaultdict(set)
    for message in seen.read("/tf"):
        for one in message["transforms"]:
            parents[one["child_frame_id"]].add(one["header"]["frame_id"])
    assert all(len(above) == 1 for above in parents.values()), parents
