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
GUARD_S = 20.0
"""Far beyond what anything takes to come."""


class Heard(NamedTuple):
    """A sample as it came."""

    key: str
    payload: bytes
    attachment: bytes | None
    encoding: str


def attachment(sequence: int = 1, time_ns: int | None = None, gid: bytes = GID) -> bytes:
    """What goes with a sample or a request."""
    return struct.pack("<qqB", sequence, time.time_ns() if time_ns is None else time_ns, 16) + gid


def config(endpoint: str, mode: str = "client", **more: object) -> zenoh.Config:
    """Zenoh's configuration of a node, as rmw_zenoh's own has it where that matters."""
    made = zenoh.Config()
    settings = {
        "mode": mode,
        "connect/endpoints": [endpoint],
        "listen/endpoints": ["tcp/127.0.0.1:0"] if mode == "peer" else [],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        **more,
    }
    for key, value in settings.items():
        made.insert_json5(key, json.dumps(value))
    return made


class RawNode:
    """Keeps what it hears, in the order of arrival."""

    def __init__(self, endpoint: str, mode: str = "client", **more: object) -> None:
        self.session = zenoh.open(config(endpoint, mode, **more))
        self.changed = threading.Condition()
        self._sequence = 0
        self._kept: list[Any] = []

    def close(self) -> None:
        self.session.close()

    def tokens(self, domain: int = 0) -> list[str]:
        """All liveliness tokens of a domain."""
        replies = self.session.liveliness().get(f"@ros2_lv/{domain}/**", timeout=GUARD_S)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def key_of(self, kind: str, name: str, type_name: str = "") -> str:
        """Return the key of what a token declares: samples', or a service's requests'."""
        (key,) = {
            "/".join((parts[1], name[1:], *parts[10:12]))
            for token in self.tokens()
            if (data := grammar.token(token).data) is not None
            and (parts := token.split("/"))[5] == kind
            and data.name == name
            and data.type.endswith(type_name)
        }
        return key

    def hear(self, key: str, *, latched: bool = False) -> list[Heard]:
        """Subscribe, as rmw_zenoh does; return where the samples appear."""
        heard: list[Heard] = []

        def take(sample: zenoh.Sample) -> None:
            attached = None if sample.attachment is None else sample.attachment.to_bytes()
            one = Heard(
                str(sample.key_expr), sample.payload.to_bytes(), attached, str(sample.encoding)
            )
            with self.changed:
                heard.append(one)
                self.changed.notify_all()

        if latched:
            subscriber = declare_advanced_subscriber(
                self.session,
                key,
                take,
                history=HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=RecoveryConfig(heartbeat=True),
            )
            self._kept.append(subscriber)  # it ends with its last reference
        else:
            self.session.declare_subscriber(key, take)
        return heard

    def wait(self, condition: Callable[[], Any]) -> Any:
        """Wait until a condition holds; return what it is."""
        with self.changed:
            assert self.changed.wait_for(condition, GUARD_S), "what was waited for did not come"
            return condition()

    def put(self, key: str, payload: bytes, **more: Any) -> None:
        """Publish a sample, with an attachment unless another is given."""
        self._sequence += 1
        self.session.put(key, payload, **{"attachment": attachment(self._sequence), **more})

    def call(self, key: str, payload: bytes, **more: Any) -> list[Heard]:
        """Ask a service, as rmw_zenoh does; return all replies, of which none is an error."""
        self._sequence += 1
        replies = self.session.get(
            key,
            payload=payload,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            **{"attachment": attachment(self._sequence), "timeout": GUARD_S, **more},
        )
        found = []
        for reply in replies:
            assert reply.ok is not None, reply.err.payload.to_string()
            attached = reply.ok.attachment
            found.append(
                Heard(
                    str(reply.ok.key_expr),
                    reply.ok.payload.to_bytes(),
                    None if attached is None else attached.to_bytes(),
                    str(reply.ok.encoding),
                )
            )
        return found
