"""Motion files: joint centres or angles of a recorded walk over time."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mecazen.errors import ConfigError
from mecazen.files import open_regular, read_text
from numpy.typing import NDArray

Array = NDArray[np.float64]

FARTHEST = 1e9
"""Largest magnitude of a number, in the unit of the file."""


class MotionFile(NamedTuple):
    """A recording: positions (n, 3) in any unit, or OpenSim's coordinates (n), by their names."""

    rate_hz: float
    values: dict[str, Array]


def read(file: Path) -> MotionFile:
    """Read a motion file in the format of its suffix.

    Raises:
        ConfigError: One line with the file and what is wrong with it.
    """
    suffix = file.suffix.lower()
    if suffix not in READERS:
        raise ConfigError(f"{file}: must end in one of {', '.join(READERS)}")
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused below
            motion = READERS[suffix](file)
    except (
        ValueError,
        LookupError,
        StopIteration,
        ArithmeticError,
        OSError,
        RuntimeError,
    ) as error:
        problem = "it ends early" if isinstance(error, IndexError | StopIteration) else error
        raise ConfigError(f"{file}: no {suffix[1:].upper()} file ({problem})") from None
    if not 10.0 <= motion.rate_hz <= 10_000.0:
        rate = f"{motion.rate_hz:g}"
        raise ConfigError(f"{file}: must have 10 to 10000 frames per second, has {rate}")
    if any((np.abs(values) > FARTHEST).any() for values in motion.values.values()):
        raise ConfigError(f"{file}: each number must be from {-FARTHEST:g} to {FARTHEST:g}")
    for places in motion.values.values():
        if places.ndim == 2:
            places[~places.any(axis=1)] = np.nan  # how programs write a hidden marker
    return motion


def _read_mot(file: Path) -> MotionFile:
    """Read OpenSim's coordinates over time; angles in degrees become radians."""
    head, table = read_text(file).split("endheader", 1)
    rows = (line.split() for line in StringIO(table) if line.strip())
    names = next(rows)
    data = _table(rows, len(names))
    if "indegrees=yes" in head.lower().replace(" ", ""):
        data[:, 1:] = np.radians(data[:, 1:])
    return MotionFile(_rate(data[:, 0]), dict(zip(names, data.T, strict=True)))


def _read_trc(file: Path) -> MotionFile:
    """Read markers over time."""
    lines = StringIO(read_text(file))
    *_, heads, _ = [next(lines) for _ in range(5)]
    names = [name.strip() for name in heads.split("\t")[2:] if name.strip()]
    width = 2 + 3 * len(names)
    rows = (line.rstrip("\r\n").split("\t")[1:width] for line in lines if line.strip())
    data = _table(([cell or "nan" for cell in row] for row in rows), width - 1)
    points = data[:, 1:].reshape(len(data), len(names), 3)
    return MotionFile(_rate(data[:, 0]), {name: points[:, i] for i, name in enumerate(names)})


def _read_c3d(file: Path) -> MotionFile:
    """Read points over time; hidden ones are NaN."""
    try:
        import ezc3d  # noqa: PLC0415  # an extra
    except ImportError:
        raise ConfigError(f"{file}: C3D needs ezc3d: pip install 'mecazen[c3d]'") from None
    with open_regular(file):
        pass  # ezc3d opens the file by its name
    content = ezc3d.c3d(str(file))
    settings, points = content["parameters"]["POINT"], content["data"]["points"]
    names = settings["LABELS"]["value"]
    places = {name: points[:3, i].T for i, name in enumerate(names[: points.shape[1]])}
    return MotionFile(float(settings["RATE"]["value"][0]), places)


READERS = {".c3d": _read_c3d, ".mot": _read_mot, ".trc": _read_trc}


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
