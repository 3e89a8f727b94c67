"""Strips of situations of the experiment on safety, with the guard's state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mecazen.config import Scenario
from mecazen_experiments.expansion import expand
from mecazen_experiments.study import load_study
from PIL import Image

from docs.pictures import scene
from docs.pictures.oblique import sheet
from docs.pictures.runs import FOLLOWED, Moment, record

TRAIL_S = 0.1
HEAD_M = 0.3
"""Offset of the picture's middle behind the feet, so that heads are in the picture."""
PANEL_PX = 300, 260


class Situation(NamedTuple):
    """A run of the experiment, and the shown part of it."""

    case: str
    driver: str
    view: str
    times_s: tuple[float, ...]
    """Times of the panels."""
    middle_m: tuple[float, float] | None
    """Middle of each panel; None for the middle between robot and person."""
    width_m: float
    """Width of each panel."""

    def load(self) -> Scenario:
        """Return the scenario of the case's first seed."""
        names = {"case": self.case, "driver": self.driver, "view": self.view}
        only = [f"{axis}={name}" for axis, name in names.items()]
        (job,) = expand(load_study("safety"), [1], only=only)
        return job.load()


SITUATIONS = {
    "hard_stop": Situation("hard stop", "guard", "back", (4.4, 6.4, 6.8), None, 3.2),
    "door": Situation("door", "planner", "side_right", (4.8, 7.2, 9.2), (4.2, -0.2), 5.2),
    "corridor": Situation("corridor", "planner", "side_right", (2.0, 4.8, 6.8), (3.0, -0.2), 5.2),
}


def strip(file: Path, name: str) -> None:
    """Draw a situation as panels side by side."""
    situation = SITUATIONS[name]
    sheet(draw(name, situation.times_s, PANEL_PX)).save(file, optimize=True)


def one(file: Path, name: str, time_s: float, size: tuple[int, int]) -> None:
    """Draw one moment of a situation."""
    draw(name, (time_s,), size)[0].save(file, optimize=True)


def draw(name: str, times_s: Sequence[float], size: tuple[int, int]) -> list[Image.Image]:
    """Return pictures of moments of a situation, with the robot's path until then."""
    situation = SITUATIONS[name]
    ticks = range(1, round(max(times_s) / TRAIL_S) + 1)
    scenario, moments = record(situation.load(), [k * TRAIL_S for k in ticks])
    pictures = []
    for time in times_s:
        shown = moments[: round(time / TRAIL_S)]
        x, y = situation.middle_m or _between(shown[-1])
        stage = scene.from_above(x, y, size, situation.width_m)
        scene.draw(stage, scenario, shown[-1], (x, y), [moment.robot for moment in shown])
        scene.badge(stage, shown[-1])
        pictures.append(stage.picture())
    return pictures


def _between(moment: Moment) -> tuple[float, float]:
    x, y = moment.people[FOLLOWED][0, :2].tolist()
    return 0.5 * (x + moment.robot.x), 0.5 * (y + moment.robot.y) + HEAD_M
