"""Occupancy maps, as ROS's map_server has them: a YAML file and a picture become boxes.

https://docs.nav2.org/configuration/packages/map_server has the keys and the modes.
"""

from __future__ import annotations

import math
import warnings
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from mecazen.errors import ConfigError
from mecazen.explain import explain
from mecazen.files import read_bytes
from mecazen.geometry import Pose2D
from mecazen.schema import Probability, Section
from mecazen.text import printable

HEIGHT_M = 2.0
"""Height of the boxes [m]."""
MAX_PIXELS = 4096 * 4096
MAX_BOXES = 5_000
"""Maximum number of boxes, with which a run is still faster than real time on one core; Nav2's
warehouse needs 2,172."""


class _Settings(Section, frozen=True, forbid_unknown_fields=False):
    """The keys of map_server's YAML file that boxes depend on; `free_thresh` is not one."""

    image: str
    resolution: Annotated[float, msgspec.Meta(ge=0.001, le=10.0)]
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """Pose of the lower left corner [m, m, rad]."""
    occupied_thresh: Probability
    negate: bool = False
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_map(path: Path) -> list[dict[str, Any]]:
    """Return the occupied cells of an occupancy map, as tables of boxes for `[world]`.

    Cells are occupied from `occupied_thresh` on, of 100 in the mode `raw`; unknown cells are free.

    Raises:
        ConfigError: One line with the file and what is wrong with it, or the missing libraries.
    """
    content = read_bytes(path)
    try:
        raw = msgspec.yaml.decode(content)
        settings = msgspec.convert(raw, _Settings, strict=False)
    except ImportError:
        raise ConfigError(_MISSING) from None
    except msgspec.ValidationError as error:
        parts = (str(path), *explain(error, raw, _Settings))
        raise ConfigError(printable(": ".join(filter(None, parts)))) from None
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise ConfigError(printable(f"{path}: {error}")) from None
    if not all(map(math.isfinite, settings.origin)):
        raise ConfigError(f"{path}: origin: got {settings.origin}; allowed: finite numbers")
    image = path.parent / settings.image
    cells = _occupied(image, settings)
    if cells.all():
        raise ConfigError(f"{image}: no cell is free; check negate and occupied_thresh in {path}")
    try:
        rectangles = _rectangles(cells)
    except OverflowError:
        raise ConfigError(
            f"{image}: its {int(cells.sum()):,} occupied cells need more than {MAX_BOXES:,} boxes; "
            "remove single cells (noise) in an image editor, or save it at a coarser resolution"
        ) from None
    resolution, origin = settings.resolution, Pose2D(*settings.origin)
    boxes = []
    for top, bottom, left, right in rectangles:
        up = len(cells) - (top + bottom) / 2
        at = origin.compose(Pose2D((left + right) / 2 * resolution, up * resolution))
        size = [(right - left) * resolution, (bottom - top) * resolution, HEIGHT_M]
        box = {"kind": "box", "size_m": size, "position_m": [at.x, at.y]}
        boxes.append({**box, "yaw_deg": math.degrees(origin.yaw)})
    return boxes


_MISSING = "a map needs the libraries Pillow and PyYAML: pip install 'mecazen[maps]'"


def _occupied(path: Path, settings: _Settings) -> Any:
    """Return which cells of a picture are occupied, the top row first (rows, columns)."""
    content = read_bytes(path)
    try:
        import numpy as np  # noqa: PLC0415  # an extra
        from PIL import Image  # noqa: PLC0415  # an extra
    except ImportError:
        raise ConfigError(_MISSING) from None
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # of Pillow, on large pictures
            Image.open(BytesIO(content), formats=("BMP", "PNG", "PPM")) as picture,
        ):
            width, height = picture.size
            if width * height > MAX_PIXELS:
                raise ConfigError(
                    f"{path}: has {width} x {height} pixels; at most {MAX_PIXELS:,} are allowed: "
                    "crop it, or save it at a coarser resolution"
                )
            wide = picture.mode.startswith("I")  # 16 bits
            alpha = None if wide else np.asarray(picture.convert("RGBA"))[..., 3]
            grey = np.asarray(picture if wide else picture.convert("L")) / (257 if wide else 1)
    except (Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise ConfigError(printable(f"{path}: no whole PGM, PNG or BMP picture: {error}")) from None
    threshold = settings.occupied_thresh
    if settings.mode == "raw":
        return (grey >= 100.0 * threshold) & (grey <= 100.0)
    level = grey / 255.0 if settings.negate else 1.0 - grey / 255.0
    return (level >= threshold) & (True if alpha is None else alpha == 255)


def _rectangles(cells: Any) -> list[tuple[int, int, int, int]]:
    """Return rectangles (top, bottom, left, right; ends excluded) that cover the occupied cells.

    The first cell that is not covered yet grows to a rectangle, along its row first or along its
    column first, whichever covers more cells. Rectangles may overlap, so fewer are needed.

    Raises:
        OverflowError: More than `MAX_BOXES` are needed.
    """
    rectangles: list[tuple[int, int, int, int]] = []
    uncovered = cells.copy()
    for row in cells.any(axis=1).nonzero()[0].tolist():
        for column in uncovered[row].nonzero()[0].tolist():
            if not uncovered[row, column]:
                continue  # the rectangle of a cell to the left covers it
            if len(rectangles) == MAX_BOXES:
                raise OverflowError
            wide = _grown(cells, row, column)
            left, right, top, bottom = _grown(cells.T, column, row)
            top, bottom, left, right = max(
                wide,
                (top, bottom, left, right),
                key=lambda r: uncovered[r[0] : r[1], r[2] : r[3]].sum(),
            )
            uncovered[top:bottom, left:right] = False
            rectangles.append((top, bottom, left, right))
    return rectangles


def _grown(cells: Any, row: int, column: int) -> tuple[int, int, int, int]:
    """Return the rectangle of the rows that are occupied along the run of a cell in its row."""
    free = (~cells[row]).nonzero()[0]
    after = int(free.searchsorted(column))
    left = int(free[after - 1]) + 1 if after else 0
    right = int(free[after]) if after < len(free) else cells.shape[1]
    top, bottom = row, row + 1
    while top > 0 and cells[top - 1, left:right].all():
        top -= 1
    while bottom < len(cells) and cells[bottom, left:right].all():
        bottom += 1
    return top, bottom, left, right
