"""Motion files: joint centres or angles of a recorded walk over time."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mecazen.errors import ConfigError
from numpy.typing import NDArray

Array = NDArray[np.float64]

_Joint = tuple[str, int, list[float], list[str]]
"""Name, index of the parent, offset and channels."""
KINDS = (".bvh", ".c3d", ".mot", ".trc")


class MotionFile(NamedTuple):
    """A recording: positions (n, 3) in any unit, or OpenSim's coordinates (n), by their names."""

    rate_hz: float
    values: dict[str, Array]
    up: int
    """Axis of the positions that points up."""


def read(file: Path) -> MotionFile:
    """Read a motion file by the ending of its name.

    Raises:
        ConfigError: It can't be read, or is not what its name says; one line.
    """
    readers = dict(zip(KINDS, (_read_bvh, _read_c3d, _read_mot, _read_trc), strict=True))
    if (reader := readers.get(file.suffix.lower())) is None:
        raise ConfigError(f"must end in one of {', '.join(KINDS)}")
    track = reader(file)
    if not 1.0 <= track.rate_hz <= 10_000.0:
        raise ConfigError(f"must have 1 to 10000 frames per second, has {track.rate_hz:g}")
    return track


@contextmanager
def _parsed(file: Path) -> Iterator[None]:
    """Report what is wrong with a file while its text becomes numbers."""
    try:
        yield
    except OSError as error:
        raise ConfigError(f"can't be read: {error.strerror or error}") from None
    except (ValueError, IndexError, KeyError, StopIteration) as error:
        why = "it ends early" if isinstance(error, IndexError | StopIteration) else error
        raise ConfigError(f"no {file.suffix[1:].upper()} file ({why})") from None


def _read_mot(file: Path) -> MotionFile:
    """Read OpenSim's coordinates over time; angles in degrees become radians."""
    with _parsed(file):
        head, table = file.read_text("utf-8").split("endheader", 1)
        names, *rows = (line.split() for line in table.splitlines() if line.strip())
        data = np.array(rows, float)
        values = dict(zip(names, data.T, strict=True))
        rate = (len(data) - 1) / (data[-1, 0] - data[0, 0])
    if "indegrees=yes" in head.lower().replace(" ", ""):
        data[:, 1:] = np.radians(data[:, 1:])
    return MotionFile(float(rate), values, 1)


def _read_trc(file: Path) -> MotionFile:
    """Read markers over time, y up as in OpenSim."""
    with _parsed(file):
        lines = file.read_text("utf-8").splitlines()
        names = [name for name in lines[3].split("\t")[2:] if name.strip()]
        rows = [line.split("\t") for line in lines[5:] if line.strip()]
        data = np.array(
            [[float(cell or "nan") for cell in row[1 : 2 + 3 * len(names)]] for row in rows]
        )
        rate = (len(data) - 1) / (data[-1, 0] - data[0, 0])
        points = data[:, 1:].reshape(len(data), len(names), 3)
    return MotionFile(float(rate), {name: points[:, i] for i, name in enumerate(names)}, 1)


def _read_c3d(file: Path) -> MotionFile:
    """Read points over time, z up, by ezc3d."""
    try:
        ezc3d = importlib.import_module("ezc3d")
    except ImportError:
        raise ConfigError("C3D needs ezc3d: pip install 'mecazen-people[c3d]'") from None
    with _parsed(file):
        content = ezc3d.c3d(str(file))
        parameters, points = content["parameters"]["POINT"], content["data"]["points"]
        rate = float(parameters["RATE"]["value"][0])
        values = {name: points[:3, i].T for i, name in enumerate(parameters["LABELS"]["value"])}
    return MotionFile(rate, values, 2)


def _read_bvh(file: Path) -> MotionFile:
    """Read a hierarchy and its channels; return the places of its joints, y up."""
    with _parsed(file):
        joints, rate, data = _parse_bvh(iter(file.read_text("utf-8").split()))
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
    return MotionFile(
        rate, {joint[0]: place for joint, (place, _) in named if joint[0] != "Site"}, 1
    )


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
    return joints, rate, np.array(list(words), float).reshape(frames, len(channels))


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
