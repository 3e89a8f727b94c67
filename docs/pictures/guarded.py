"""Strips of situations of the experiment on safety, with the guard's state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

from docs.pictures import scene
from docs.pictures.runs import FOLLOWED, Moment, record

TRAIL_S = 0.1
HEAD_M = 0.3
"""How far the middle is behind the feet, so that heads are in the picture."""
PANEL_PX, GAP_PX = (300, 260), 6


class Situation(NamedTuple):
    """A run, and what is shown of it."""

    settings: dict[str, Any]
    times_s: tuple[float, ...]
    """Times of the panels."""
    middle_m: tuple[float, float] | None
    """Middle of each panel; None: between robot and person."""
    width_m: float
    """Width of each panel."""


_BESIDE: dict[str, Any] = {
    "follower.planner": {},
    "follower.view": "side_right",
    "start": {"y_m": -1.2, "yaw_deg": 90.0},
}
SITUATIONS = {
    "hard_stop": Situation(
        {
            "target.path": {
                "kind": "script",
                "start_after_s": 1.0,
                "steps": [
                    {"duration_s": 0.4, "speed_m_s": 0.6},
                    {"duration_s": 0.4, "speed_m_s": 1.2},
                    {"duration_s": 4.0, "speed_m_s": 1.8},
                ],
            }
        },
        (4.4, 6.4, 6.8),
        None,
        3.2,
    ),
    "door": Situation(
        {
            **_BESIDE,
            "target.path": {
                "kind": "straight",
                "speed_m_s": 0.8,
                "length_m": 12.0,
                "start_after_s": 1.0,
            },
            "world.obstacles": [
                {"kind": "box", "size_m": [0.1, 4.0, 1.0], "position_m": [4.0, 2.5]},
                {"kind": "box", "size_m": [0.1, 4.0, 1.0], "position_m": [4.0, -2.5]},
            ],
        },
        (4.8, 7.2, 9.2),
        (4.2, -0.2),
        5.2,
    ),
    "corridor": Situation(
        {
            **_BESIDE,
            "target.path": {
                "kind": "straight",
                "speed_m_s": 0.8,
                "length_m": 14.0,
                "start_after_s": 1.0,
            },
            "world.obstacles": [
                {"kind": "box", "size_m": [5.0, 0.1, 1.0], "position_m": [5.5, 0.95]},
                {"kind": "box", "size_m": [5.0, 0.1, 1.0], "position_m": [5.5, -0.95]},
            ],
        },
        (2.0, 4.0, 6.0),
        (2.6, -0.2),
        4.8,
    ),
}
"""Cases of configs/experiments/safety.toml, each with one speed."""


def strip(file: Path, name: str) -> None:
    """Draw a situation as panels side by side."""
    situation = SITUATIONS[name]
    panels = draw(name, situation.times_s, PANEL_PX)
    width, height = PANEL_PX
    sheet = Image.new("RGB", (len(panels) * (width + GAP_PX) - GAP_PX, height), "white")
    for k, panel in enumerate(panels):
        sheet.paste(panel, (k * (width + GAP_PX), 0))
    sheet.save(file, optimize=True)


def one(file: Path, name: str, time_s: float, size: tuple[int, int]) -> None:
    """Draw one moment of a situation."""
    draw(name, (time_s,), size)[0].save(file, optimize=True)


def draw(name: str, times_s: Sequence[float], size: tuple[int, int]) -> list[Image.Image]:
    """Return moments of a situation, with the robot's way until then."""
    situation = SITUATIONS[name]
    ticks = range(1, round(max(times_s) / TRAIL_S) + 1)
    settings = {"follower.standoff_m": 1.2, **situation.settings}
    scenario, moments = record("safety", [k * TRAIL_S for k in ticks], **settings)
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
