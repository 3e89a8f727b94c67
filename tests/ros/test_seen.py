"""What ROS sees of robots with all their senses: every token, every key, every sequence."""

import json
import time
from collections import defaultdict
from typing import Any

import pytest
from harness import SCENARIOS
from mecazen.graph import OBSERVERS
from mecazen.loading import load_scenario, parse_settings
from mecazen_ros.types import definition, message
from ros import grammar
from ros.node import Received

SETTINGS = {
    "senses": ('sensor.also=["depth"]', "sensors.depth={rate_hz=5.0, width=32, height=24}"),
    "convoy": (),
}
CLOCKS = 60
"""Number of ticks that are received."""


class Seen:
    """A scenario's endpoints in ROS, and its samples of some time."""

    def __init__(self, running: Any, node: Any, peer: Any) -> None:
        self.peer, namespace = peer, running.scenario.bus.namespace
        self.received: list[Received] = node.subscribe("0/**")
        nodes = [part for part in running.scenario.parts if part[0] not in OBSERVERS]
        self.entities: list[grammar.Entity] = node.entities(namespace, len(nodes))
        # latched samples come only to subscribers that ask for them, parameters when they change
        names = {end.data.name for end in self.of_kind("MP") if not end.latched}
        names = {name for name in names if not name.endswith("/sim/parameters")}
        running.wait(lambda: names <= {grammar.key(s.key).name for s in [*self.received]})
        running.wait(lambda: sum("Clock" in sample.key for sample in [*self.received]) > CLOCKS)

    def of_kind(self, kind: str) -> list[grammar.Entity]:
        return [end for end in self.entities if end.kind == kind]


@pytest.fixture(scope="module", params=SETTINGS)
def seen(request, up, raw_node, start_peer):
    path, settings = SCENARIOS / f"{request.param}.toml", SETTINGS[request.param]
    loaded = load_scenario(path, parse_settings(settings))
    services = [part for part in loaded.services if part not in OBSERVERS]
    running = up(path, *settings, f"processes=[{json.dumps(services)}]")
    return Seen(running, raw_node(running.endpoint), start_peer(running.endpoint, "client"))


def test_every_endpoint_has_a_number_and_a_node(seen):
    ids = [(end.zid, end.id) for end in seen.entities]
    assert len(ids) == len(set(ids))
    nodes = {(end.zid, end.node_id): (end.namespace, end.node) for end in seen.of_kind("NN")}
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
    assert {grammar.key(s.key) for s in seen.received} <= {end.data for end in seen.of_kind("MP")}
    numbers = defaultdict(list)
    for sample in seen.received:
        sequence, time_ns, gid = grammar.attachment(sample.attachment)
        assert abs(time_ns - time.time_ns()) < 60e9
        numbers[sample.key, gid].append(sequence)
    for sequence in numbers.values():  # a full link drops samples
        assert sequence == sorted(set(sequence))
        assert sequence[0] >= 1
    assert len({gid for _, gid in numbers}) == len(numbers)


def test_an_independent_decoder_reads_samples_and_one_tree_of_frames(seen):
    samples, parents = defaultdict(list), defaultdict(set)
    for sample in seen.received:
        samples[sample.key].append(sample.payload)
    for key, payloads in samples.items():
        kind = grammar.key(key).type
        for payload in payloads[:30]:
            read = grammar.message(payload, kind, definition(message(kind)))
            for frame in read.get("transforms", ()):
                parents[frame["child_frame_id"]].add(frame["header"]["frame_id"])
    assert any(child.endswith("base_link") for child in parents)
    assert all(len(frames) == 1 for frames in parents.values()), parents
