"""Style and output of all figures. Matplotlib is imported when a figure is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mecazen.errors import ConfigError, MecazenError

from mecazen_tools.files import write_with

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE = "#0072B2", "#E69F00"
"""A dark and a light colour of Okabe and Ito's palette, which is safe for the colour-blind."""
PALETTE = (BLUE, "#D55E00", "#009E73", "#CC79A7", "#56B4E9", ORANGE)
"""Colours of the palette for more than two lines."""
DASHES = (0.0, (4.0, 1.5))

COLUMN_IN = 85.0 / 25.4
"""Width of a printed column."""

STYLE: list[Any] = [
    "default",
    {
        "font.size": 7.0,
        **dict.fromkeys(("axes.titlesize", "axes.labelsize", "legend.fontsize"), "medium"),
        **{f"{axis}tick.labelsize": "medium" for axis in "xy"},
        **{f"{axis}tick.major.width": 0.5 for axis in "xy"},
        **{f"{axis}tick.major.{key}": 2.0 for axis in "xy" for key in ("size", "pad")},
        "axes.linewidth": 0.5,
        "axes.labelpad": 2.0,
        "axes.titlepad": 3.0,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.linewidth": 0.3,
        "grid.color": "#dddddd",
        "legend.frameon": False,
        "savefig.dpi": 300,
        # keep text as text, and make the bytes reproducible
        "svg.fonttype": "none",
        "svg.hashsalt": "mecazen",
    },
]
"""Matplotlib's defaults, independent of the user's settings, adapted to print."""

METADATA = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""Metadata of each format, without the time of drawing."""


def refuse_undrawable(path: Path, option: str) -> None:
    """Check, before the work, that a figure can be drawn into a file; its suffix is the format.

    Raises:
        MecazenError: The format is unknown, or the folder or Matplotlib is missing.
    """
    if path.suffix not in METADATA:
        raise ConfigError(f"{option} {path}: a picture's name ends in one of {', '.join(METADATA)}")
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"{option} {path}: no such folder")
    if find_spec("matplotlib") is None:
        raise MecazenError(f"{option} needs Matplotlib: pip install 'mecazen[plot]'")


def save(figure: Figure, path: Path, option: str = "") -> None:
    """Write a figure, whole, in the format of the file's suffix.

    Raises:
        MecazenError: The file can't be written.
    """
    from matplotlib import style  # noqa: PLC0415  # only figures need it

    with style.context(STYLE):
        write_with(path, partial(figure.savefig, metadata=METADATA[path.suffix]), option)


def draw_arrows(axes: Axes, poses: Sequence[Any], colour: str, length: float, width: float) -> None:
    """Draw poses (arrays of x [m], y [m] and yaw [rad]) as arrows of a length and a width [m]."""
    x, y, yaw = poses
    arrows = length * np.cos(yaw), length * np.sin(yaw)
    scale: dict[str, Any] = {"angles": "xy", "units": "xy", "scale": 1.0, "width": width}
    axes.quiver(x, y, *arrows, color=colour, zorder=4.0, **scale)
