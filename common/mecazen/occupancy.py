"""Occupancy images, as ROS's map_server has them: a YAML file and a PGM picture become boxes.

Of YAML only what such files hold is read: `key: value` lines, with numbers, words and lists of
numbers. https://docs.nav2.org/configuration/packages/map_server has the keys.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D

HEIGHT_M = 2.0
"""Of what is occupied."""
MAX_PIXELS = 4096 * 4096
MAX_BOXES = 2000
"""Each costs time in every scan and in every step near it."""

Cells = npt.NDArray[np.bool_]


def take_map(world: dict[str, Any], path: Path) -> None:
    """Add what the occupancy image shows that the table of a world names to its obstacles.

    Args:
        world: The table, of the file `path`; what is wrong with types is said when it is converted.
        path: The image's path is relative to it.

    Raises:
        ConfigError: As of `read_map`.
    """
    name, others = world.get("map"), world.get("obstacles", [])
    if isinstance(name, str) and isinstance(others, list):
        del world["map"]
        world["obstacles"] = [*others, *read_map(path.parent / name)]


def read_map(path: Path) -> list[dict[str, Any]]:
    """Return what an occupancy image shows as occupied, as tables of boxes for `[world]`.

    Occupied is what is above `occupied_thresh`; what is unknown is free.

    Args:
        path: The YAML file.

    Raises:
        ConfigError: One line with the file and what is wrong with it.
    """
    settings = _read_settings(path)
    try:
        image = path.parent / settings["image"]
        resolution = float(settings["resolution"])
        x, y, yaw = (float(number) for number in settings["origin"].strip("[] ").split(","))
        threshold, negate = float(settings["occupied_thresh"]), settings.get("negate", "0")
    except (KeyError, ValueError) as error:
        raise ConfigError(
            f"{path}: needs image, resolution, origin = [x, y, yaw] and occupied_thresh: {error}"
        ) from None
    if not 0.001 <= resolution <= 10.0:
        raise ConfigError(f"{path}: resolution: got {resolution:g}; allowed: 0.001 to 10 m")
    grey = _read_pgm(image)
    occupied = (grey if negate in ("1", "true") else 1.0 - grey) > threshold
    rectangles = min(_rectangles(occupied), _turned(_rectangles(occupied.T)), key=len)
    if len(rectangles) > MAX_BOXES:
        raise ConfigError(f"{image}: {len(rectangles)} boxes; at most {MAX_BOXES} can be simulated")
    origin, rows = Pose2D(x, y, yaw), len(grey)
    boxes = []
    for top, bottom, left, right in rectangles:
        middle = Pose2D((left + right) / 2 * resolution, (rows - (top + bottom) / 2) * resolution)
        at = origin.compose(middle)
        size = [(right - left) * resolution, (bottom - top) * resolution, HEIGHT_M]
        box = {"kind": "box", "size_m": size, "position_m": [at.x, at.y]}
        boxes.append({**box, "yaw_deg": math.degrees(yaw)})
    return boxes


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from None


def _read_settings(path: Path) -> dict[str, str]:
    text = _read(path).decode(errors="replace")
    lines = (line.partition("#")[0].partition(":") for line in text.splitlines())
    return {key.strip(): value.strip().strip("'\"") for key, colon, value in lines if colon}


def _read_pgm(path: Path) -> npt.NDArray[np.float64]:
    """Return a grey picture, P2 or P5, from 0 (black) to 1 (white), its top row first."""
    data = _read(path)
    gap = rb"(?:\s|#[^\n]*\n)+"
    header = re.match(rb"(P[25])" + gap + gap.join([rb"(\d{1,9})"] * 3) + rb"\s", data)
    if header is None:
        raise ConfigError(f"{path}: not a PGM picture (P2 or P5)")
    width, height, most = (int(number) for number in header.groups()[1:])
    if not 0 < width * height <= MAX_PIXELS or not 0 < most < 65536:
        raise ConfigError(
            f"{path}: {width} x {height} pixels up to {most}; allowed: at most {MAX_PIXELS} "
            "pixels, up to 65535"
        )
    body = data[header.end() :]
    if header[1] == b"P2":
        words = re.sub(rb"#[^\n]*", b"", body).split()
        pixels = np.array([int(word) for word in words if word.isdigit()], float)
    else:
        kind = np.dtype("u1" if most < 256 else ">u2")
        pixels = np.frombuffer(body[: len(body) // kind.itemsize * kind.itemsize], kind) / 1.0
    if len(pixels) < width * height:
        raise ConfigError(f"{path}: {len(pixels)} pixels of {width} x {height}")
    return pixels[: width * height].reshape(height, width) / most


def _rectangles(cells: Cells) -> list[tuple[int, int, int, int]]:
    """Return rectangles (top, bottom, left, right; ends excluded) that cover exactly `cells`.

    Runs of cells in a row grow downwards as long as the next row has the same run.
    """
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    edges = np.diff(np.pad(cells, ((0, 1), (1, 1))).astype(np.int8), axis=1)
    for row, steps in enumerate(edges):
        begins, ends = np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist()
        runs = dict.fromkeys(zip(begins, ends, strict=True), row)
        found += [(top, row, *run) for run, top in growing.items() if run not in runs]
        growing = {run: growing.get(run, row) for run in runs}
    return found


def _turned(rectangles: list[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    return [(left, right, top, bottom) for top, bottom, left, right in rectangles]
