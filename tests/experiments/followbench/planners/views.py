"""Views that the tests of the planners share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.sight import RANGE, scan
from mecazen_experiments.followbench.unicycle import Unicycle
from mecazen_experiments.followbench.view import Planner, Seen, View

SIZE = (100.0, 100.0)
CENTER, AHEAD = Pose2D(50.0, 50.0), Seen(52.0, 50.0, 0.0, 0.0)


def view(
    robot: Pose2D = CENTER,
    target: Seen | None = AHEAD,
    people: Sequence[Seen] = (),
    boxes: Sequence[tuple[float, ...]] = (),
    **others: Any,
) -> View:
    """Return what a robot at rest sees; each box has x, y, yaw, length and width."""
    discs = [person[:2] for person in (*people, *([target] if target else []))]
    ranges = scan(robot, np.array(discs).reshape(-1, 2), np.array(boxes).reshape(-1, 5))
    fields = {"time_s": 0.0, "v": 0.0, "w": 0.0, "place": "back", "distance": 1.5} | others
    return View(robot=robot, target=target, people=tuple(people), ranges=ranges, **fields)


def drive(planner: Planner, first: View, steps: int) -> list[Unicycle]:
    """Return the states of a robot that follows a target and meets people who keep walking."""
    planner.reset(0)
    states = [Unicycle(first.robot, first.v, first.w)]
    for k in range(steps):
        now = 0.1 * k
        target = _later(first.target, now) if first.target else None
        people = [_later(person, now) for person in first.people]
        pose, v, w = states[-1]
        seen = view(pose, target, people, time_s=now, v=v, w=w, place=first.place)
        states.append(states[-1].step(*planner.command(seen), 0.1, SIZE))
    return states


def _later(person: Seen, seconds: float) -> Seen:
    x, y, vx, vy = person
    return Seen(x + seconds * vx, y + seconds * vy, vx, vy)


def nothing() -> Any:
    """Return the ranges of a scan that meets nothing."""
    return np.full(200, RANGE)
