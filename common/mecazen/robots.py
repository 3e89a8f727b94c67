"""Names and seeds of several robots: a robot's name precedes its keys."""

from __future__ import annotations

import zlib
from collections.abc import Container


def join_key(part: str, robot: str) -> str:
    """Return the name of a part of a robot, preceded by the robot's name if there are several.

    >>> join_key("odom", "two"), join_key("odom", "")
    ('two/odom', 'odom')
    """
    return f"{robot}/{part}" if robot else part


def split_key(key: str, robots: Container[str]) -> tuple[str, str]:
    """Split a key into the name of its robot, if it is one of `robots`, and the rest.

    >>> split_key("two/odom", {"one", "two"})
    ('two', 'odom')
    """
    robot, _, name = key.partition("/")
    return (robot, name) if robot in robots else ("", key)


def seed_of(seed: int, name: str) -> int:
    """Return the seed of the robot `name` in a run of `seed`; it differs for each robot."""
    return zlib.crc32(f"{seed}/{name}".encode()) if name else seed
