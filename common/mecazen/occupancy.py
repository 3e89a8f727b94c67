"""Occupancy images, as ROS's map_server has them: a YAML file and a PGM picture become boxes.

Only a part of YAML is supported: `key: value` lines, with numbers, words and lists of
numbers. https://docs.nav2.org/configuration/packages/map_server has the keys.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from pathlib import Path
from sys import byteorder
from typing import Any

from mecazen.errors import ConfigError
from mecazen.files import read_bytes
from mecazen.geometry import Pose2D

HEIGHT_M = 2.0
"""Height of the boxes [m]."""
MAX_SETTINGS_BYTES = 1 << 20
MAX_PIXELS = 4096 * 4096
MAX_SIDE = 1 << 16
"""Maximum width and height [pixels]."""
MAX_BOXES = 2000
"""Maximum number of boxes, since each costs time in every scan and in every step near it."""


def take_map(world: dict[str, Any], locate: Callable[[str], Path]) -> None:
    """Add the boxes of the occupancy image that a world names to the world's obstacles.

    Args:
        world: Table of the world; wrong types are refused later, when the table is converted.
        locate: Returns the file that a path in the table names.

    Raises:
        ConfigError: See `read_map`.
    """
    name, others = world.get("map"), world.get("obstacles", [])
    if isinstance(name, str) and isinstance(others, list):
        del world["map"]
        world["obstacles"] = [*others, *read_map(locate(name))]


def read_map(path: Path) -> list[dict[str, Any]]:
    """Return the occupied cells of an occupancy image, as tables of boxes for `[world]`.

    Cells above `occupied_thresh` are occupied; unknown cells are free.

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
    if not all(map(math.isfinite, (x, y, yaw, threshold))):
        raise ConfigError(f"{path}: origin and occupied_thresh must be finite")
    width, rows, white, pixels = _read_pgm(image)
    shown = [level if negate in ("1", "true") else white - level for level in range(white + 1)]
    is_occupied = [level > threshold * white for level in shown]
    cells = bytes([is_occupied[level] for level in pixels])
    across = _rectangles(cells[row * width : (row + 1) * width] for row in range(rows))
    rectangles = min(
        across, _turned(_rectangles(cells[column::width] for column in range(width))), key=len
    )
    if len(rectangles) > MAX_BOXES:
        raise ConfigError(f"{image}: at most {MAX_BOXES} boxes can be simulated, it needs more")
    origin = Pose2D(x, y, yaw)
    boxes = []
    for top, bottom, left, right in rectangles:
        middle = Pose2D((left + right) / 2 * resolution, (rows - (top + bottom) / 2) * resolution)
        at = origin.compose(middle)
        size = [(right - left) * resolution, (bottom - top) * resolution, HEIGHT_M]
        box = {"kind": "box", "size_m": size, "position_m": [at.x, at.y]}
        boxes.append({**box, "yaw_deg": math.degrees(yaw)})
    return boxes


def _read_settings(path: Path) -> dict[str, str]:
    text = read_bytes(path, MAX_SETTINGS_BYTES).decode(errors="replace")
    lines = (line.partition("#")[0].partition(":") for line in text.splitlines())
    return {key.strip(): value.strip().strip("'\"") for key, colon, value in lines if colon}


def _read_pgm(path: Path) -> tuple[int, int, int, Sequence[int]]:
    """Return a grey picture, P2 or P5: width, height, white and the pixels, the top row first."""
    data = read_bytes(path)
    gap = rb"(?:\s|#[^\n]*\n)+"
    header = re.match(rb"(P[25])" + gap + gap.join([rb"(\d{1,9})"] * 3) + rb"\s", data)
    if header is None:
        raise ConfigError(f"{path}: not a PGM picture (P2 or P5)")
    width, height, most = (int(number) for number in header.groups()[1:])
    count = width * height
    if not 0 < count <= MAX_PIXELS or max(width, height) > MAX_SIDE or not 0 < most < 65536:
        raise ConfigError(
            f"{path}: {width} x {height} pixels up to {most}; allowed: at most {MAX_PIXELS} "
            f"pixels, {MAX_SIDE} along each side, up to 65535"
        )
    pixels: Sequence[int]
    if header[1] == b"P2":
        body = re.sub(rb"#[^\n]*", b"", data[header.end() :])
        words = islice(re.finditer(rb"(?<!\S)\d{1,9}(?!\S)", body), count)
        pixels = array("L", (int(word[0]) for word in words))
    elif most > 255:
        body = data[header.end() :][: 2 * count]
        pixels = array("H", body[: len(body) // 2 * 2])
        if byteorder == "little":  # PGM is big-endian
            pixels.byteswap()
    else:
        pixels = data[header.end() :][:count]
    if len(pixels) < count:
        raise ConfigError(f"{path}: {len(pixels)} pixels of {width} x {height}")
    if (brightest := max(pixels)) > most:
        raise ConfigError(f"{path}: a pixel of {brightest}, where {most} is white")
    return width, height, most, pixels


def _rectangles(lines: Iterable[bytes]) -> list[tuple[int, int, int, int]]:
    """Return rectangles (top, bottom, left, right; ends excluded) that cover the cells of 1.

    Runs of cells in a line grow downwards as long as the next line has the same run. The search
    ends early if more than `MAX_BOXES` are found.
    """
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    row = -1
    for row, line in enumerate(lines):
        runs = dict.fromkeys(run.span() for run in re.finditer(rb"\x01+", line))
        found += [(top, row, *run) for run, top in growing.items() if run not in runs]
        growing = {run: growing.get(run, row) for run in runs}
        if len(found) > MAX_BOXES:
            break
    return found + [(top, row + 1, *run) for run, top in growing.items()]


def _turned(rectangles: list[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    return [(left, right, top, bottom) for top, bottom, left, right in rectangles]
