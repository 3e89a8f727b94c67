"""An episode as a short film: people, the robot's outline, and the end of the episode."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib import style
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.transforms import Affine2D
from mecazen_tools.drawing import BLUE, ORANGE, STYLE

from mecazen_experiments.followbench import unicycle
from mecazen_experiments.followbench.episodes import Episode
from mecazen_experiments.followbench.play import Record

EVERY = 4
"""Steps from one picture to the next; a step is 0.1 s."""
PER_S = 10
"""Pictures per second: four times as fast as the episode."""
AROUND_M = 6.0
"""Half the width of the picture, which follows the target."""
SIZE_IN, DPI = 3.6, 75
END = 10
"""Number of pictures for which the last step is shown."""
RED = "#c0392b"


def film(episode: Episode, record: Record, title: str, file: Path) -> None:
    """Write an episode as an animated GIF."""
    with style.context(STYLE):
        figure = Figure(figsize=(SIZE_IN, SIZE_IN))
        axes = figure.subplots()
        last = len(record.robot) - 1
        steps = [*range(0, last, EVERY), *([last] * END)]
        pictures = FuncAnimation(
            figure, lambda k: _draw(axes, episode, record, title, k), frames=steps
        )
        pictures.save(file, writer=PillowWriter(fps=PER_S), dpi=DPI)


def _draw(axes: Axes, episode: Episode, record: Record, title: str, step: int) -> list[Axes]:
    axes.clear()
    axes.set_aspect("equal")
    x, y = record.target[step]
    axes.set(xlim=(x - AROUND_M, x + AROUND_M), ylim=(y - AROUND_M, y + AROUND_M))
    for box in episode.boxes:
        turn = Affine2D().rotate_around(box.x, box.y, box.yaw) + axes.transData
        corner = box.x - box.length / 2.0, box.y - box.width / 2.0
        axes.add_patch(Rectangle(corner, box.length, box.width, color="0.6", transform=turn))
    for place in record.humans[step]:
        axes.add_patch(Circle(tuple(place), unicycle.PERSON_RADIUS, color="0.45"))
    seen = bool(record.visible[step])
    target = Circle((x, y), unicycle.PERSON_RADIUS, color=ORANGE, fill=seen, linewidth=1.5)
    axes.add_patch(target)
    trail = record.robot[: step + 1]
    axes.plot(trail[:, 0], trail[:, 1], color=BLUE, linewidth=0.8)
    has_failed = record.collided and step == len(record.robot) - 1
    axes.add_patch(_robot(axes, record.robot[step], RED if has_failed else BLUE))
    says = "contact" if has_failed else "" if seen else "out of sight"
    axes.set_title(f"{title}, {step * episode.step_s:.1f} s  {says}", fontsize=7)
    axes.tick_params(labelsize=6)
    return [axes]


def _robot(axes: Axes, pose: np.ndarray[tuple[int], np.dtype[np.float64]], color: str) -> Rectangle:
    x, y, yaw = pose.tolist()
    half_length, half_width = unicycle.HALF
    turn = Affine2D().rotate_deg_around(x, y, math.degrees(yaw)) + axes.transData
    corner = x + unicycle.CENTRE - half_length, y - half_width
    return Rectangle(
        corner, 2 * half_length, 2 * half_width, color=color, alpha=0.8, transform=turn
    )
