"""The success rate over the number of people in open scenes, beside the published rates."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mecazen_tools.drawing import COLUMN_IN, DASHES, PALETTE, STYLE, save

from mecazen_experiments.followbench.episodes import SAMPLE
from mecazen_experiments.report import Row
from mecazen_experiments.statistics import Interval

PUBLISHED = {"MPC w/ Traj.": "0.3", "SFM": "0.6"}
"""The best published planner and the reference, with their grey levels."""
CONDITION = re.compile(r"H(\d+), (back|left_side), 1.5 m")


def draw(rows: Sequence[Row[Any]], folder: Path) -> list[Path]:
    """Write the figure into a folder, as PNG and SVG, and return the files.

    Args:
        rows: A row for each follower, place and number of people in open scenes.
        folder: The folder.
    """
    with style.context(STYLE):
        figure = Figure(figsize=(1.6 * COLUMN_IN, 0.8 * COLUMN_IN), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, place in zip(panels, ("back", "left_side"), strict=True):
            _panel(axes, [row for row in rows if row.labels["open, place"] == place], place)
        panels[0].set_ylabel("SR [%]")
        figure.legend(*panels[1].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    files = [folder / f"followbench.{kind}" for kind in ("png", "svg")]
    for file in files:
        save(figure, file, "--figures")
    return files


def _panel(axes: Axes, rows: Sequence[Row[Any]], place: str) -> None:
    for name, grey in PUBLISHED.items():
        points = _published(name, place)
        label = f"published: {name}"
        axes.plot(
            *zip(*points, strict=True), color=grey, linestyle=DASHES, linewidth=0.8, label=label
        )
    lines: dict[str, list[tuple[int, Interval]]] = {}
    for row in rows:
        people = int(str(row.labels["density"]).split()[0])
        lines.setdefault(str(row.labels["follower"]), []).append((people, row.means["sr"]))
    for color, (follower, values) in zip(PALETTE, lines.items(), strict=False):
        counts, means = [n for n, _ in values], [value.mean for _, value in values]
        spread = [
            [value.mean - value.low for _, value in values],
            [value.high - value.mean for _, value in values],
        ]
        look: dict[str, Any] = {"color": color, "linewidth": 0.8, "marker": "o", "markersize": 2}
        axes.errorbar(counts, means, spread, label=follower, **look)
    axes.set(title=place, xlabel="people besides the target", ylim=(0.0, 105.0))


def _published(name: str, place: str) -> list[tuple[int, float]]:
    """Return the published success rates of a planner in open scenes, by the number of people."""
    with (SAMPLE / "published.csv").open(encoding="utf-8", newline="") as file:
        rows = [
            (CONDITION.fullmatch(row["condition"]), row)
            for row in csv.DictReader(file)
            if (row["method"], row["metric"]) == (name, "SR_%")
        ]
    return sorted((int(c[1]), float(row["value"])) for c, row in rows if c and c[2] == place)
