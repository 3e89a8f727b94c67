"""The animation at the top of the README: a robot follows a person among other people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mecazen.config import Scenario
from PIL import Image

from docs.pictures import oblique, scene
from docs.pictures.oblique import Array, Camera, Stage
from docs.pictures.runs import FOLLOWED, Moment, record

FROM_S, FOR_S, PER_S = 3.0, 8.0, 10
"""The part of the run that is shown, and frames per second."""
SIZE_PX, VIEW_DEG = (600, 338), 44.0
EYE_M, AT_M = (-2.6, -4.5, 2.3), (0.1, 0.0, 0.68)
"""Position of the camera and the point it looks at, relative to the middle of robot and person."""
QUALITY = 80
"""Quality of the compression: lines stay sharp, and the file is smaller than a GIF."""
LEGEND = (
    ("lidar", oblique.BLUE),
    ("body tracker", oblique.ORANGE),
    ("the robot's goal", oblique.GREEN),
)


def draw(file: Path) -> None:
    """Draw the animation."""
    times = [FROM_S + k / PER_S for k in range(round(FOR_S * PER_S))]
    scenario, moments = record("crowd", times)
    middles = _smooth(np.array([middle(moment) for moment in moments]))
    pairs = zip(moments, middles, strict=True)
    frames = [frame(scenario, moment, place) for moment, place in pairs]
    first, *rest = frames
    first.save(
        file,
        save_all=True,
        append_images=rest,
        duration=1000 // PER_S,
        loop=0,
        quality=QUALITY,
        minimize_size=True,
    )


def middle(moment: Moment) -> Array:
    """Return the point midway between robot and person (2,) [m]."""
    person = moment.people[FOLLOWED][0, :2]
    halves: Array = 0.5 * np.array((person, moment.robot[:2]))
    both: Array = halves[0] + halves[1]
    return both


def frame(scenario: Scenario, moment: Moment, place: Array) -> Image.Image:
    """Draw a moment, seen from beside a place (2,) [m]."""
    base = np.append(place, 0.0)
    stage = Stage(Camera(base + EYE_M, base + AT_M, SIZE_PX, VIEW_DEG))
    scene.draw(stage, scenario, moment, place.tolist())
    scene.bones(stage, moment)
    stage.legend(LEGEND)
    return stage.picture()


def _smooth(places: Array) -> Array:
    """Return places (n, 2) without the sway of single steps."""
    count = 2 * PER_S + 1
    padded = np.pad(places, ((PER_S, PER_S), (0, 0)), mode="reflect", reflect_type="odd")
    mean = np.full(count, 1.0 / count)
    return np.column_stack([np.convolve(axis, mean, mode="valid") for axis in padded.T])
