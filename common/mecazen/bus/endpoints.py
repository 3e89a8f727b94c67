"""Which endpoints only this machine reaches, and which are guarded by certificates."""

from __future__ import annotations

import ipaddress
import re

WITHIN_THE_MACHINE = ("unixsock-stream", "unixpipe")
"""Links through the file system, whose permissions guard them."""


def is_open(endpoint: str, *, mutual_tls: bool) -> bool:
    """Return whether strangers may be at the other end of a Zenoh endpoint.

    They are not on loopback, nor where each end has to show a certificate.

    Args:
        endpoint: `protocol/address`, and perhaps `?metadata` and `#configuration`.
        mutual_tls: Whether TLS demands a certificate of both ends, unless the endpoint says
            otherwise.
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
