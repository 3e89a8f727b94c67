"""Points over time from C3D files (https://www.c3d.org) of Intel's processor type."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512
_INTEL = 84
_TYPES = {-1: "S1", 1: "u1", 2: "<u2", 4: "<f4"}
"""Types of the values of a parameter by its code; numbers of frames are unsigned."""


def read_points(data: bytes) -> tuple[float, dict[str, NDArray[np.float64]]]:
    """Return the frames per second, and points (n, 3) by their labels; NaN if hidden."""
    try:
        first, magic, used, analog = struct.unpack_from("<BBHH", data)
        section = data[max(first - 1, 0) * _BLOCK :][: 256 * _BLOCK]
        if magic != 0x50 or section[3] != _INTEL:
            raise ValueError("it must begin as C3D of Intel's processor type")
        places = _parameters(section)
        names = "RATE", "SCALE", "FRAMES", "DATA_START"
        rate, scale, frames, start = (float(_values(section, places[name])[0]) for name in names)
        labels = _values(section, places["LABELS"])
    except (struct.error, IndexError):
        raise ValueError("it ends early") from None
    except KeyError as error:
        raise ValueError(f"it has no POINT:{error.args[0]}") from None
    kind = np.dtype("<f4" if scale < 0.0 else "<i2")
    n, width, begin = int(frames), 4 * used + analog, int(start - 1) * _BLOCK
    end = begin + n * width * kind.itemsize
    if not 0 < begin <= end <= len(data):
        raise ValueError(f"{n} frames of {used} points do not fit into {len(data)} bytes")
    values = np.frombuffer(data[begin:end], kind).reshape(n, width)[:, : 4 * used]
    points = values.reshape(n, used, 4).astype(float)
    points[points[..., 3] < 0.0] = np.nan  # the fourth is the residual
    points *= 1.0 if scale < 0.0 else scale
    return rate, {label: points[:, i, :3] for i, label in enumerate(labels[:used])}


def _parameters(section: bytes) -> dict[str, int]:
    """Return the places of the parameters of the group POINT, by name."""
    point, places, at = 0, {}, 4
    while length := section[at]:
        # a negative length marks a locked name; a negative number, a group
        length, number = min(length, 256 - length), section[at + 1]
        after = at + 2 + length
        name = section[at + 2 : after].decode("latin-1").upper()
        if number > 127 and name == "POINT":
            point = 256 - number
        places[number, name] = after + 2
        (offset,) = struct.unpack_from("<H", section, after)
        if not offset:
            break
        at = after + offset
    return {name: place for (number, name), place in places.items() if number == point}


def _values(section: bytes, at: int) -> Any:
    """Return the values of a parameter: numbers, or texts."""
    code, count = struct.unpack_from("<bB", section, at)
    sizes = section[at + 2 : at + 2 + count]
    kind = np.dtype(_TYPES.get(code, "u1"))
    size = kind.itemsize * math.prod(sizes)
    content = section[at + 2 + count :][:size]
    if code != -1:
        return np.frombuffer(content[: len(content) // kind.itemsize * kind.itemsize], kind)
    width = max(sizes[0], 1) if sizes else 1
    return [content[i : i + width].decode("latin-1").strip() for i in range(0, len(content), width)]
