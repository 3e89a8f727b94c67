"""Checks of Zenoh endpoints: local to this machine, or protected by certificates."""

from __future__ import annotations

import ipaddress
import re

WITHIN_THE_MACHINE = ("unixsock-stream", "unixpipe")
"""Protocols of links through the file system, which its permissions protect."""


def is_open(endpoint: str, *, mutual_tls: bool) -> bool:
    """Return whether a Zenoh endpoint accepts unknown programs.

    Endpoints on loopback, and those where both ends must show a certificate, do not.

    Args:
        endpoint: `protocol/address`, and perhaps `?metadata` and `#configuration`.
        mutual_tls: Whether TLS requires a certificate of both ends, unless the endpoint's own
            configuration overrides this.
    """
    place, _, configuration = endpoint.partition("#")
    protocol, _, address = place.partition("?")[0].partition("/")
    if protocol in WITHIN_THE_MACHINE or _is_loopback(address):
        return False
    said = re.findall(r"(?:^|;)enable_mtls=([^;]*)", configuration)
    return protocol not in {"tls", "quic"} or (said[-1:] or [str(mutual_tls)])[0].lower() != "true"


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
