"""A ROS 2 node by hand, on Zenoh alone, as rmw_zenoh's sources have it.

It stands in where zenoh-ros2-sdk has nothing: services with empty requests, advanced
subscribers, and whatever no honest node sends.
"""

import json
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh
from ros import grammar
from zenoh.ext import HistoryConfig, RecoveryConfig, declare_advanced_subscriber

GID = bytes(range(16))
GUARD_S = 60.0
"""Far beyond what anything takes to come."""


class Received(NamedTuple):
    """A sample or a reply as it came."""

    key: str
    payload: bytes
    attachment: bytes


def received(sample: zenoh.Sample) -> Received:
    attached = (sample.attachment or b"") and sample.attachment.to_bytes()
    return Received(str(sample.key_expr), sample.payload.to_bytes(), attached)


def attachment(sequence: int = 1) -> bytes:
    """Return the attachment of a sample or a request."""
    return struct.pack("<qqB", sequence, time.time_ns(), 16) + GID


class RawNode:
    """Keeps what it receives, in the order of arrival."""

    def __init__(self, endpoint: str, **more: object) -> None:
        config = zenoh.Config()
        settings = {
            "mode": "client",
            "connect/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
            **more,
        }
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.changed = threading.Condition()
        self._sequence = 0
        self._kept: list[Any] = []
        self.live: set[str] = set()
        """The liveliness tokens of domain 0, as they come and go."""
        self.session.liveliness().declare_subscriber("@ros2_lv/0/**", self._note, history=True)

    def _note(self, token: zenoh.Sample) -> None:
        with self.changed:
            is_declared = token.kind == zenoh.SampleKind.PUT
            (self.live.add if is_declared else self.live.discard)(str(token.key_expr))
            self.changed.notify_all()

    def close(self) -> None:
        self.session.close()

    def entities(self, namespace: str, nodes: int = 1) -> list[grammar.Entity]:
        """Return the graph of a namespace, once all of a number of nodes is there.

        A node declares its health last.
        """

        def of_namespace() -> list[grammar.Entity]:
            parsed = [grammar.token(token) for token in self.live if f"/%{namespace}" in token]
            healths = [end for end in parsed if end.data and end.data.name == "/diagnostics"]
            return parsed if len(healths) == nodes else []

        return self.wait(of_namespace)

    def key_of(self, kind: str, name: str, type_name: str = "") -> str:
        """Return the key of what a token declares, once it is declared."""

        def keys() -> list[str]:
            ends = [end for token in self.live if (end := grammar.token(token)).kind == kind]
            found = [end.data for end in ends if end.data.name == name]
            return [data.key for data in found if data.type.endswith(type_name)]

        return self.wait(keys)[0]

    def subscribe(self, key: str, *, latched: bool = False) -> list[Received]:
        """Subscribe, as rmw_zenoh does; return where the samples appear."""
        samples: list[Received] = []

        def take(sample: zenoh.Sample) -> None:
            with self.changed:
                samples.append(received(sample))
                self.changed.notify_all()

        if latched:
            history = HistoryConfig(detect_late_publishers=True, max_samples=1)
            recovery = RecoveryConfig(heartbeat=True)
            subscriber = declare_advanced_subscriber(
                self.session, key, take, history=history, recovery=recovery
            )
            self._kept.append(subscriber)  # it ends with its last reference
        else:
            self.session.declare_subscriber(key, take)
        return samples

    def wait(self, condition: Callable[[], Any]) -> Any:
        """Wait until a condition is true; return its value."""
        with self.changed:
            assert self.changed.wait_for(condition, GUARD_S), "what was waited for did not come"
            return condition()

    def put(self, key: str, payload: bytes, **more: Any) -> None:
        """Publish a sample, with an attachment unless another is given."""
        self._sequence += 1
        self.session.put(key, payload, **{"attachment": attachment(self._sequence), **more})

    def call(self, key: str, payload: bytes, **more: Any) -> list[Received]:
        """Query a service, as rmw_zenoh does; return all replies. An error among them fails."""
        self._sequence += 1
        replies = self.session.get(
            key,
            payload=payload,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            **{"attachment": attachment(self._sequence), "timeout": GUARD_S, **more},
        )
        return [received(reply.ok) for reply in replies]
