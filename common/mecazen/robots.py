"""What tells several robots apart: the names before their keys, and their seeds."""

from __future__ import annotations

import zlib
from collections.abc import Container


def join_key(part: str, robot: str) -> str:
    """Return what a part of the robot `robot` is called beside those of others.

    >>> join_key("odom", "two"), join_key("odom", "")
    ('two/odom', 'odom')
    """
    return f"{robot}/{part}" if robot else part


def split_key(key: str, robots: Container[str]) -> tuple[str, str]:
    """Return whose a key is, of the robots of these names, and what it is within its namespace.

    >>> split_key("two/odom", {"one", "two"})
    ('two', 'odom')
    """
    robot, _, rest = key.partition("/")
    return (robot, rest) if robot in robots else ("", key)


def seed_of(seed: int, name: str) -> int:
    """Return the seed of the robot `name` in a run of `seed`: another for each robot."""
    return zlib.crc32(f"{seed}/{name}".encode()) if name else seed
