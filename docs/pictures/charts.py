"""A chart of published results: engines by cost and error."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator
from mecazen_bench.harness import read
from mecazen_tools.drawing import BLUE, COLUMN_IN, ORANGE, PALETTE, STYLE, save

ROOT = Path(__file__).parents[2]
GREEN, GREY = PALETTE[2], "#9aa4ae"
ENGINES = {"mecazen": BLUE, "MuJoCo": ORANGE, "Gazebo": GREY}
PEERS = re.compile(r"(\d) ms (\w+)(?:, (capsule|mesh))?(?:, (.+))?")
MARKERS = {None: "o", "elliptic": "^", "elliptic, noslip": "v"}
SIZES = {"1": 3.5, "5": 6.5}
COSTS, ERRORS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2), (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
"""Ticks of the logarithmic axes."""


def engines(file: Path) -> None:
    """Draw `nexus` of results/bench-physics.csv: cost against errors of gains and energy."""
    rows: dict[str, dict[str, float]] = {}
    for cell in read(ROOT / "results" / "bench-physics.csv"):
        if cell.table.endswith("nexus"):
            rows.setdefault(cell.row, {})[cell.column] = cell.value
    labels: dict[str, dict[str, Any]] = {}
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        gains, energy = figure.subplots(1, 2, sharex=True)
        for name, values in rows.items():
            if (match := PEERS.fullmatch(name)) is None:
                continue
            step, engine, shape, settings = match.groups()
            filled = shape != "mesh"
            look: dict[str, Any] = {"color": ENGINES[engine], "linestyle": "none"}
            look |= {"marker": MARKERS[settings], "markersize": SIZES[step]}
            look |= {} if filled else {"markerfacecolor": "white"}
            cost = 1.0 / values["× real time"]
            gains.plot(cost, values["largest error %"], **look)
            energy.plot(cost, abs(values["energy %/s"]), **look)
            if settings is None and step == "1":
                labels[f"{engine}, {shape}" if shape else engine] = look
        gains.set_title("largest error of a gain [%]")
        energy.set_title("energy lost in 1 s of coasting [%]")
        for axes in (gains, energy):
            axes.set(xscale="log", yscale="log", xlabel="processor time of a simulated second [s]")
            for axis, ticks in ((axes.xaxis, COSTS), (axes.yaxis, ERRORS)):
                low, high = axis.get_view_interval()
                axis.set_major_locator(FixedLocator([tick for tick in ticks if low < tick < high]))
                axis.set_major_formatter("{x:g}")
                axis.set_minor_locator(NullLocator())
        plain: dict[str, Any] = {"color": GREY, "linestyle": "none"}
        for settings, marker in MARKERS.items():
            if settings is not None:
                labels[settings] = {**plain, "marker": marker, "markersize": SIZES["1"]}
        for step, size in SIZES.items():
            labels[f"steps of {step} ms"] = {**plain, "marker": "o", "markersize": size}
        handles = [Line2D([], [], label=label, **look) for label, look in labels.items()]
        figure.legend(handles=handles, loc="outside right center")
    save(figure, file)
