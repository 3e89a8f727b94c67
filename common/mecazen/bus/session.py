"""Zenoh sessions: configuration, certificates, and refusal of insecure endpoints."""

from __future__ import annotations

import ipaddress
import json
import logging
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import zenoh

from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import DIAGNOSTICS, TOPICS, Topic, diagnostics
from mecazen.robots import join_key
from mecazen.wire import MAX_PAYLOAD_BYTES

logger = logging.getLogger(__name__)

Mode = Literal["router", "peer", "client"]

THREADS = "(rx: (worker_threads: 4))"
"""Zenoh's receiving threads in a process, instead of its default of 2. One that waits for room on a
link must not keep others from reading; nor must one that closes the link to a frozen process, which
takes 10 s (eclipse-zenoh/zenoh, issue 1101)."""

QUEUED_BATCHES = 16
"""Number of batches of 64 KiB that a link queues for a slow receiver before it drops samples:
Zenoh's maximum. With Zenoh's default of 2 a recorder on a busy machine loses 0.2 s of a run."""

MAX_MESSAGE_BYTES = 2 * MAX_PAYLOAD_BYTES
"""Maximum size of a message on a link, checked before its fragments are joined [bytes]. Meshes that
are served as files may be longer than samples."""

RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}
"""Zenoh's pauses between attempts to connect: a router that restarts is found within 0.2 s."""

CONNECT_MS = 10_000
"""Time for which a service that needs the router waits for it [ms]; tools try once."""

ROUTER_ENTRIES = "@/*/router/**"
"""Keys of a router's admin space: its clients, and what they have declared; `**` lacks them."""

ONLY_ROUTER = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [
        {
            "id": "the router relays",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                *("put", "delete", "query", "reply", "liveliness_token", "liveliness_query"),
                *("declare_subscriber", "declare_queryable", "declare_liveliness_subscriber"),
            ],
            "key_exprs": ["**", ROUTER_ENTRIES],
        }
    ],
    "subjects": [{"id": "router", "cert_common_names": ["router"]}],
    "policies": [{"subjects": ["router"], "rules": ["the router relays"]}],
}
"""Access control of a tool, which accepts messages only from the router. Otherwise any admitted
program could listen in place of a router that has exited."""

WITHIN_THE_MACHINE = ("unixsock-stream", "unixpipe")
"""Protocols of links through the file system, which its permissions protect."""

AUTHORITY = "ca"
"""Name of the certificate authority's certificate in a folder of keys."""
OPERATOR = "operator"
"""Name of the certificate that tools show."""


def session_config(
    config: BusConfig,
    mode: Mode,
    name: str = OPERATOR,
    *,
    most_hz: float | None = None,
    robots: Sequence[str] = ("",),
    renamed: Mapping[str, str] = MappingProxyType({}),
    timestamps: bool = False,
) -> zenoh.Config:
    """Return Zenoh's configuration: loopback without multicast, unless `config` sets other values.

    A router listens at the endpoints that the others connect to. A peer listens on a free port
    of loopback, and others find it by gossip through the router. A client only connects.

    Args:
        config: Endpoints, namespace, keys, and optionally a Zenoh configuration to start from.
        mode: Mode of the session.
        name: Name of the certificate that the session shows, if `config.keys` is set.
        most_hz: Maximum rate at which a router accepts samples of a topic from a link [1/s].
        robots: Names of the robots; each has its own topics.
        renamed: Keys that differ from those of their topics, by topic key.
        timestamps: Whether samples carry Zenoh's timestamps.

    Raises:
        BusError: A file can't be read, or unknown programs could connect.
    """
    listen = config.listen
    if config.zenoh_config is None:
        base = zenoh.Config()
        listen = listen or ("tls/127.0.0.1:0" if config.keys else "tcp/127.0.0.1:0",)
    else:
        try:
            base = zenoh.Config.from_file(str(config.zenoh_config))
        except zenoh.ZError as error:
            problem = f"not a Zenoh configuration: {reason_of(error)}"
            raise BusError(f"{config.zenoh_config}: {problem}") from None
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": config.multicast_scouting,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,  # only payloads over 1 MB would gain
        "transport/link/tx/queue/size/data": QUEUED_BATCHES,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "timestamping/enabled": timestamps or None,
    }
    if mode == "router":
        settings["listen/endpoints"] = config.router_endpoints
        settings["adminspace/enabled"] = True  # read-only: it names who publishes
        settings |= _filters(config, most_hz, robots, renamed)
    else:
        settings["connect/endpoints"] = config.router_endpoints
        settings["connect/retry"] = RETRY
        settings["listen/endpoints"] = listen if mode == "peer" else ()
        settings["namespace"] = config.namespace
        if config.mode == "client" and name != OPERATOR:
            settings["connect/timeout_ms"] = CONNECT_MS
    if config.keys is not None:
        settings["transport/link/protocols"] = ["tls"]
        settings["transport/link/tls"] = _certificates(config.keys, name)
        if mode == "client" and name == OPERATOR and config.zenoh_config is None:
            settings["access_control"] = ONLY_ROUTER
    for key, value in settings.items():
        if value is not None:
            base.insert_json5(key, json.dumps(value))
    if mode != "client":
        _refuse_strangers(base, mode, insecure=config.insecure)
    return base


def _filters(
    config: BusConfig, most_hz: float | None, robots: Sequence[str], renamed: Mapping[str, str]
) -> dict[str, Any]:
    topics = {join_key(topic.key, robot): topic for robot in robots for topic in TOPICS}
    moved = [replace(topics[name], key=key) for name, key in renamed.items()]
    at_entry = {"flows": ["ingress"], "messages": ["put"]}
    sizes = [
        {
            "id": f"size of {topic.key}",
            "key_exprs": _expressions(config, topic),
            "size_limit": topic.max_bytes,
        }
        for topic in (*TOPICS, *moved)
    ]
    settings: dict[str, Any] = {"low_pass_filter": [at_entry | rule for rule in sizes]}
    if most_hz is not None:
        from mecazen.graph import SERVICES  # noqa: PLC0415  # of a router only

        # two keys of one rule would share its rate: physics publishes for all robots at once, and
        # one process may publish both follower's and guard's cmd_vel, or all diagnostics
        single: list[Topic[Any]] = [topic for topic in TOPICS if topic is not DIAGNOSTICS]
        single += map(diagnostics, SERVICES)
        rates = [
            {"key_expr": expression, "freq": most_hz}
            for robot, topic in (*product(robots, single), *product([""], moved))
            for expression in _expressions(config, topic, robot, config.namespace or "")
        ]
        settings["downsampling"] = [at_entry | {"id": "rate of samples", "rules": rates}]
    return settings


def _expressions(
    config: BusConfig, topic: Topic[Any], robot: str = "", namespace: str | None = None
) -> list[str]:
    """Return key expressions for a topic's samples, including those that are received from ROS."""
    expressions = [f"**/{join_key(topic.key, robot)}"]
    if config.ros2:
        from mecazen_ros import protocol  # noqa: PLC0415  # an optional package

        expressions += protocol.received_keys(topic, robot, namespace)
    return expressions


def _certificates(folder: Path, name: str) -> dict[str, Any]:
    authority, certificate, key = (
        folder / file for file in (f"{AUTHORITY}.crt", f"{name}.crt", f"{name}.key")
    )
    for file in (authority, certificate, key):
        if not os.access(file, os.R_OK):
            raise BusError(f"{file}: can't be read; `mecazen keys create` makes such files")
    _refuse_expired(authority)
    return {
        "root_ca_certificate": str(authority),
        "enable_mtls": True,
        "listen_certificate": str(certificate),
        "listen_private_key": str(key),
        "connect_certificate": str(certificate),
        "connect_private_key": str(key),
    }


def _refuse_expired(authority: Path) -> None:
    """Check that an authority's certificate has not expired; Zenoh would report no reason."""
    import ssl  # noqa: PLC0415  # only links with certificates need it

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(authority)
    except ssl.SSLError:
        raise BusError(f"{authority}: not a certificate in PEM") from None
    for certificate in context.get_ca_certs():
        until = str(certificate["notAfter"])
        if ssl.cert_time_to_seconds(until) < time.time():
            raise BusError(f"{authority}: expired on {until}; `mecazen keys create` makes new ones")


def _refuse_strangers(base: zenoh.Config, mode: Mode, *, insecure: bool) -> None:
    """Check that all links of a peer or a router are on loopback or use certificates."""
    mutual_tls = base.get_json("transport/link/tls/enable_mtls") == "true"
    for role in ("listen", "connect"):
        endpoints = json.loads(base.get_json(f"{role}/endpoints"))
        if isinstance(endpoints, dict):
            endpoints = endpoints.get(mode) or ()
        for endpoint in endpoints:
            if not is_open(endpoint, mutual_tls=mutual_tls):
                continue
            problem = f"{role} endpoint {endpoint} of a {mode} is beyond loopback and without TLS"
            if not insecure:
                raise BusError(
                    f"{problem}: give bus.keys and take tls/…, or allow it by bus.insecure = true"
                )
            logger.warning("msg=%r", f"{problem}: whoever reaches it drives the robot")


def is_open(endpoint: str, *, mutual_tls: bool) -> bool:
    """Return whether a Zenoh endpoint accepts unknown programs.

    Endpoints on loopback, and those where both ends must show a certificate, do not.

    Args:
        endpoint: `protocol/address`, and perhaps `?metadata` and `#configuration`.
        mutual_tls: Whether TLS requires a certificate of both ends, unless the endpoint's own
            configuration overrides this.
    """
    location, _, configuration = endpoint.partition("#")
    protocol, _, address = location.partition("?")[0].partition("/")
    if protocol in WITHIN_THE_MACHINE or _is_loopback(address):
        return False
    options = dict(option.partition("=")[::2] for option in configuration.split(";"))
    is_mutual = options.get("enable_mtls", str(mutual_tls)).lower() == "true"
    return protocol not in {"tls", "quic"} or not is_mutual


def _is_loopback(address: str) -> bool:
    host = address.rpartition(":")[0]
    if host == "localhost":
        return True
    try:
        ip = ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    mapped = ip.ipv4_mapped if isinstance(ip, ipaddress.IPv6Address) else None
    return (mapped or ip).is_loopback


def open_session(
    config: BusConfig,
    mode: Mode,
    name: str = OPERATOR,
    *,
    server: str = "`mecazen up`",
    **options: Any,
) -> zenoh.Session:
    """Open a Zenoh session; the arguments are those of `session_config`.

    `server` is the program that a client finds at its endpoints.

    Raises:
        BusError: A port is taken, or a client finds no router.
    """
    os.environ.setdefault("ZENOH_RUNTIME", THREADS)
    try:
        return zenoh.open(session_config(config, mode, name, **options))
    except zenoh.ZError as error:
        endpoints = ", ".join(config.router_endpoints or (str(config.zenoh_config),))
        reason = reason_of(error)
        if mode == "router" and "Address already in use" in reason:
            raise BusError(
                f"can't listen on {endpoints}: the port is taken, by another `mecazen up` or "
                "router? (--set bus.connect='[\"tcp/127.0.0.1:PORT\"]' takes another; with "
                "--set bus.namespace=NAME `mecazen up` shares its router)"
            ) from None
        if mode == "client" and "Unable to connect" in reason:
            keys = "" if config.keys is None else f", with certificates of {config.keys}"
            raise BusError(f"nothing answers at {endpoints}: is {server} running{keys}?") from None
        action = f"listen on {endpoints}" if mode == "router" else "open the Zenoh session"
        raise BusError(f"can't {action}: {reason}") from None


def includes(expression: str, key: str) -> bool:
    """Return whether a key expression includes a key.

    Raises:
        BusError: The key expression is invalid.
    """
    try:
        return bool(zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key)))
    except zenoh.ZError as error:
        raise BusError(f"{expression!r} is not a key expression: {reason_of(error)}") from None


def reason_of(error: zenoh.ZError) -> str:
    """Return the message of a Zenoh error in one line, without locations in Zenoh's sources."""
    return " ".join(str(error).partition(" at /")[0].split())
