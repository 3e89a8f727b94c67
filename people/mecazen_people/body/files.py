"""Motion files: joint centres or angles of a recorded walk over time."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mecazen.errors import ConfigError
from mecazen.files import read_bytes, read_text
from numpy.typing import NDArray

from mecazen_people.body.c3d import read_points

Array = NDArray[np.float64]

_Joint = tuple[str, int, list[float], list[str]]
"""Name, index of the parent, offset and channels."""
KINDS = (".bvh", ".c3d", ".mot", ".trc")
MAX_JOINTS = 1000
MAX_PLACES = 1 << 21
"""Maximum number of joints times frames in BVH: 7 minutes of 40 joints at 120 Hz."""
FARTHEST = 1e9
"""Largest magnitude of a number, in the unit of the file."""


class MotionFile(NamedTuple):
    """A recording: positions (n, 3) in any unit, or OpenSim's coordinates (n), by their names."""

    rate_hz: float
    values: dict[str, Array]


def read(file: Path) -> MotionFile:
    """Read a motion file in the format of its suffix."""
    readers = dict(zip(KINDS, (_read_bvh, _read_c3d, _read_mot, _read_trc), strict=True))
    if (reader := readers.get(file.suffix.lower())) is None:
        raise ConfigError(f"{file}: must end in one of {', '.join(KINDS)}")
    with np.errstate(all="ignore"):  # numbers that are not finite are refused below
        track = reader(file)
    if not 10.0 <= track.rate_hz <= 10_000.0:
        rate = f"{track.rate_hz:g}"
        raise ConfigError(f"{file}: must have 10 to 10000 frames per second, has {rate}")
    if any((np.abs(values) > FARTHEST).any() for values in track.values.values()):
        raise ConfigError(f"{file}: each number must be from {-FARTHEST:g} to {FARTHEST:g}")
    return track


@contextmanager
def _parsed(file: Path) -> Iterator[None]:
    """Report what is wrong with a file while its text becomes numbers."""
    try:
        yield
    except (ValueError, IndexError, KeyError, StopIteration, ArithmeticError) as error:
        why = "it ends early" if isinstance(error, IndexError | StopIteration) else error
        raise ConfigError(f"{file}: no {file.suffix[1:].upper()} file ({why})") from None


def _table(rows: Iterable[Sequence[str]], width: int) -> Array:
    """Return rows of numbers as an array (n, width)."""
    numbers = array("d")
    for row in rows:
        if len(row) != width:
            raise ValueError(f"a row has {len(row)} instead of {width} numbers")
        numbers.extend(map(float, row))
    return np.array(numbers).reshape(-1, width)


def _rate(times: Array) -> float:
    """Return the frames per second of frames at these times [s]."""
    span = float(times[-1] - times[0])
    if not span > 0.0:
        raise ValueError("its times must increase")
    return (len(times) - 1) / span


def _read_mot(file: Path) -> MotionFile:
    """Read OpenSim's coordinates over time; angles in degrees become radians."""
    text = read_text(file)
    with _parsed(file):
        head, table = text.split("endheader", 1)
        rows = (line.split() for line in StringIO(table) if line.strip())
        names = next(rows)
        data = _table(rows, len(names))
        values = dict(zip(names, data.T, strict=True))
        rate = _rate(data[:, 0])
    if "indegrees=yes" in head.lower().replace(" ", ""):
        data[:, 1:] = np.radians(data[:, 1:])
    return MotionFile(rate, values)


def _read_trc(file: Path) -> MotionFile:
    """Read markers over time."""
    text = read_text(file)
    with _parsed(file):
        lines = StringIO(text)
        *_, heads, _ = [next(lines) for _ in range(5)]
        names = [name.strip() for name in heads.split("\t")[2:] if name.strip()]
        width = 2 + 3 * len(names)
        rows = (line.rstrip("\r\n").split("\t")[1:width] for line in lines if line.strip())
        data = _table(([cell or "nan" for cell in row] for row in rows), width - 1)
        rate = _rate(data[:, 0])
        points = data[:, 1:].reshape(len(data), len(names), 3)
    return MotionFile(rate, {name: points[:, i] for i, name in enumerate(names)})


def _read_c3d(file: Path) -> MotionFile:
    """Read points over time."""
    data = read_bytes(file)
    with _parsed(file):
        rate, values = read_points(data)
    return MotionFile(rate, values)


def _read_bvh(file: Path) -> MotionFile:
    """Read a hierarchy and its channels; return the places of its joints."""
    text = read_text(file)
    with _parsed(file):
        joints, rate, data = _parse_bvh(word[0] for word in re.finditer(r"\S+", text))
    places: list[tuple[Array, Array]] = []
    frames, column = len(data), 0
    for _, parent, offset, channels in joints:
        place, turn = np.tile(np.array(offset), (frames, 1)), np.tile(np.eye(3), (frames, 1, 1))
        for channel in channels:
            axis, values = "XYZ".index(channel[0]), data[:, column]
            column += 1
            if channel.endswith("position"):
                place[:, axis] = values
            else:
                turn = np.einsum("nij,njk->nik", turn, _rotations(axis, np.radians(values)))
        if parent >= 0:
            origin, frame = places[parent]
            place = origin + np.einsum("nij,nj->ni", frame, place)
            turn = np.einsum("nij,njk->nik", frame, turn)
        places.append((place, turn))
    named = zip(joints, places, strict=True)
    return MotionFile(rate, {joint[0]: place for joint, (place, _) in named if joint[0] != "Site"})


def _parse_bvh(words: Iterator[str]) -> tuple[list[_Joint], float, Array]:
    """Return the joints, the frames per second, and the values of all channels (n, channels)."""
    joints: list[_Joint] = []
    _expect(words, "HIERARCHY")
    stack, name = [-1], ""
    for word in words:
        match word:
            case "ROOT" | "JOINT" | "End":
                name = next(words)
            case "{":
                if len(joints) == MAX_JOINTS:
                    raise ValueError(f"it has more than {MAX_JOINTS} joints")
                joints.append((name, stack[-1], [], []))
                stack.append(len(joints) - 1)
            case "OFFSET":
                joints[-1][2].extend(float(next(words)) for _ in range(3))
            case "CHANNELS":
                joints[-1][3].extend([next(words) for _ in range(int(next(words)))])
            case "}":
                stack.pop()
            case "MOTION":
                break
    _expect(words, "Frames:")
    frames = int(next(words))
    _expect(words, "Frame")
    _expect(words, "Time:")
    rate = 1.0 / float(next(words))
    channels = [channel for joint in joints for channel in joint[3]]
    if any(channel[0] not in "XYZ" for channel in channels):
        raise ValueError("each channel must begin with X, Y or Z")
    if any(len(offset) != 3 for _, _, offset, _ in joints):
        raise ValueError("each joint must have one OFFSET")
    return joints, rate, _motion(words, frames, len(channels), len(joints))


def _motion(words: Iterator[str], frames: int, channels: int, joints: int) -> Array:
    """Return the values of all channels (n, channels)."""
    most = MAX_PLACES // max(joints, 1)
    if not 2 <= frames <= most:
        raise ValueError(f"it has {frames} frames; allowed with {joints} joints: 2 to {most}")
    wanted = frames * channels
    values = np.array([float(word) for word in islice(words, wanted)])
    if len(values) < wanted or next(words, None) is not None:
        given = len(values) if len(values) < wanted else "more"
        raise ValueError(
            f"{frames} frames of {channels} channels are {wanted} numbers, not {given}"
        )
    return values.reshape(frames, channels)


def _expect(words: Iterator[str], wanted: str) -> None:
    if (word := next(words)) != wanted:
        raise ValueError(f"{wanted} must come where {word!r} is")


def _rotations(axis: int, angles: Array) -> Array:
    """Return the rotations (n, 3, 3) about an axis by angles (n) [rad]."""
    turn = np.zeros((len(angles), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angles)
    turn[:, j, i] = np.sin(angles)
    turn[:, i, j] = -turn[:, j, i]
    return turn
