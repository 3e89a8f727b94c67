"""Draws episodes like those of Follow-Bench.

The original generator is not published. The distributions here are derived from the published
files; tests compare both. Numbers without another source are the limits observed in the files.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
from mecazen.arrays import between, to_rectangle
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D

from mecazen_experiments.followbench.episodes import (
    SAMPLE,
    Box,
    Density,
    Episode,
    Manners,
    Walk,
    class_and_density,
    episode_lengths,
    read,
)
from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.pedestrians.grid import CELL_M
from mecazen_experiments.followbench.view import Place

CLEAR_M = 1.5
"""Minimum distance of people from target and robot at the start [m]."""
TRIES = 1000
"""Maximum number of draws for one person or box, before all are drawn again."""

Point = tuple[float, float]
Ways = list[tuple[Point, ...]]
"""Start and goals of each person [m]."""


class Scenario(NamedTuple):
    """A cell of the benchmark: 24 crowds, 28 layouts, or a track."""

    name: str
    cls: str
    density: Density


class _Setting(NamedTuple):
    """The values that all episodes of a class share, and the start of the robot."""

    size: tuple[float, float]
    inflation_cells: int
    safe_dist: float
    goal_threshold: float
    robot: dict[Place, Point]
    """Position of the robot in the target's frame [m]."""


class _Drawn(NamedTuple):
    """A drawn scene: pose and goal of the target, the paths of the others, and boxes."""

    target: Pose2D
    goal: Point
    ways: Ways
    boxes: tuple[Box, ...] = ()


class _Jammed(Exception):  # noqa: N818  # a reason to draw again, not an error
    """No room is left for a person or a box."""


OPEN = _Setting((30.0, 30.0), 10, 0.5, 2.0, {"back": (-1.5, 0.0), "left_side": (0.0, 1.5)})
BESIDE: dict[Place, Point] = {"back": (-1.3, 0.0), "left_side": (0.0, 1.3)}
SETTINGS = {
    "Circular": OPEN,
    "Crowd": OPEN,
    "Parallel": OPEN,
    "Perpendicular": OPEN,
    "Corridor": _Setting((40.0, 10.0), 8, 0.5, 2.0, BESIDE),
    "Intersection": _Setting((40.0, 40.0), 10, 0.4, 2.0, BESIDE),
    "Doorway": _Setting(
        (40.0, 20.0), 12, 0.4, 1.0, {"back": (-1.3, 0.0), "left_side": (-1.5, -1.3)}
    ),
    "Clutter": _Setting((30.0, 30.0), 8, 0.5, 1.0, {"back": (-2.3, 0.0), "left_side": (-1.0, 1.3)}),
}


PEOPLE_OF_LAYOUTS: dict[str, tuple[tuple[float | None, int | None], tuple[int, ...]]] = {
    "Corridor": ((5.6, None), (4, 12, 20, 28)),
    "Intersection": ((4.8, None), (2, 10, 18, 26)),
    "Doorway": ((2.8, None), (2, 6, 10, 14)),
    "Clutter": ((None, 30), (10, 20, 30, 40)),
}
"""Width and number of boxes of the layouts with four published levels of people, and these
levels."""


def scenarios(manners: Manners = "orca") -> list[Scenario]:
    """Return the scenarios with people; layouts exist only with `orca`."""
    return [
        Scenario(name, *class_and_density(name, int(name.rpartition("H")[2].partition("W")[0])))
        for name in episode_lengths()
        if manners.capitalize() in name
    ]


def tracks() -> list[Scenario]:
    """Return the scenarios in which the target walks alone."""
    return [
        Scenario(name, name, Density(0))
        for name in episode_lengths()
        if class_and_density(name, 0)[0] == name
    ]


def generate(
    cls: str,
    place: Place,
    density: Density,
    seed: int,
    distance: float = 1.5,
    manners: Manners = "orca",
) -> Episode:
    """Return an episode of a class; the same arguments give the same episode.

    Tracks have no random part. The distance [m] to keep does not change the start: as in the
    published files, the robot starts at the position for 1.5 m.

    Raises:
        ConfigError: The benchmark has no such scenario.
    """
    for one in [*scenarios(manners), *tracks()]:
        if (one.cls, one.density) == (cls, density):
            break
    else:
        raise ConfigError(f"Follow-Bench has no scenario {cls!r} of {density} with {manners}")
    name = f"{one.name}_{place}_{seed}"
    if cls not in SETTINGS:
        return _track(one.name, name, place, distance)
    setting = SETTINGS[cls]
    number = zlib.crc32(f"{one.name}_{place}".encode())
    drawn = _draw(cls, place, density, np.random.Generator(np.random.PCG64([number, seed])))
    length = episode_lengths()[one.name]

    def walk(way: tuple[Point, ...]) -> Walk:
        return Walk(
            Pose2D(*way[0], _heading(*way[:2])),
            way[1:],
            True,
            setting.goal_threshold,
            setting.safe_dist,
        )

    return Episode(
        name=name,
        cls=cls,
        manners=manners,
        place=place,
        density=density,
        robot=drawn.target.compose(Pose2D(*setting.robot[place])),
        target=walk((drawn.target[:2], drawn.goal))._replace(start=drawn.target),
        humans=tuple(walk(way) for way in drawn.ways),
        boxes=drawn.boxes,
        size=setting.size,
        step_s=STEP_S,
        inflation_cells=setting.inflation_cells,
        max_steps=length.max_steps,
        max_search_steps=length.max_search_steps,
        distance=distance,
    )


def _heading(start: Point, goal: Point) -> float:
    """Return the direction from start to goal [rad], rounded as in the published files."""
    return round(math.atan2(goal[1] - start[1], goal[0] - start[0]), 3)


def _track(track: str, name: str, place: Place, distance: float) -> Episode:
    """Return the episode of a track, from the sample's episode for any place."""
    path = next((SAMPLE / "target_trajectory").glob(f"{track}_*.yaml"))
    episode = read(path)
    x, y, _ = episode.target.start
    robot = Pose2D(x - 2.0, y) if place == "back" else Pose2D(x, y + 2.0)
    return msgspec.structs.replace(episode, name=name, place=place, robot=robot, distance=distance)


def _draw(cls: str, place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return a scene of a class; draw again if there is no room for a person or box."""
    while True:
        try:
            return DRAW[cls](place, density, chance)
        except _Jammed:
            continue


def _apart(
    draw: Callable[[], tuple[Point, ...]],
    taken: Ways,
    gap: float,
    is_clear: Callable[[tuple[Point, ...]], bool],
) -> tuple[Point, ...]:
    """Return a clear path that starts apart from the paths in `taken`.

    Raises:
        _Jammed: No such path was found.
    """
    for _ in range(TRIES):
        way = draw()
        if _away(way[0], _starts(taken), gap) and is_clear(way):
            return way
    raise _Jammed


def _away(place: Point, others: list[Point], gap: float) -> bool:
    """Return whether the distance of a point from all others is at least `gap`."""
    return all(math.dist(place, other) >= gap for other in others)


def _starts(ways: Ways) -> list[Point]:
    return [way[0] for way in ways]


def _ends(ways: Ways) -> list[Point]:
    return [way[-1] for way in ways]


def _shares(number: int, parts: int, chance: np.random.Generator) -> list[int]:
    """Return a random number of people for each part; all distributions are equally likely."""
    bars = np.sort(chance.choice(number + parts - 1, parts - 1, replace=False))
    shares = np.diff([-1, *bars, number + parts - 1]) - 1
    return [int(share) for share in shares]


def _uniform(chance: np.random.Generator, low: float, high: float) -> float:
    """Return a number drawn from a range, rounded as in the published files."""
    return round(float(chance.uniform(low, high)), 2)


def _target(cls: str, place: Place, start: Pose2D) -> list[Point]:
    """Return the start positions of target and robot."""
    return [start[:2], start.compose(Pose2D(*SETTINGS[cls].robot[place]))[:2]]


OPEN_GAP_M = 1.2
"""Minimum distance between people at the start [m]: four radii."""


def _open(
    place: Place,
    density: Density,
    draw: Callable[[int], tuple[Point, ...]],
    goals: bool = False,
    start_x: float = 8.0,
) -> _Drawn:
    """Return a crowd in the empty world: `draw` returns a path for a person, by number."""
    target = Pose2D(start_x, 15.0, 0.0)
    clear, ways = _target("Crowd", place, target), Ways()

    def is_clear(way: tuple[Point, ...]) -> bool:
        ends = _ends(ways) if goals else []
        return _away(way[0], clear, CLEAR_M) and _away(way[-1], ends, OPEN_GAP_M)

    for number in range(density.humans):
        ways.append(_apart(partial(draw, number), ways, OPEN_GAP_M, is_clear))
    return _Drawn(target, (28.0, 15.0), ways)


def _circular(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people on a circle, who walk to the opposite point."""
    is_wide = density.humans >= 20
    radius = 8.0 if is_wide else 5.0

    def draw(_: int) -> tuple[Point, ...]:
        angle = float(chance.uniform(-math.pi, math.pi))
        dx, dy = round(radius * math.cos(angle), 2), round(radius * math.sin(angle), 2)
        return (
            (round(15.0 + dx, 2), round(15.0 + dy, 2)),
            (round(15.0 - dx, 2), round(15.0 - dy, 2)),
        )

    return _open(place, density, draw, start_x=5.0 if is_wide else 8.0)


def _crowd(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people with random starts and goals in the middle of the world."""

    def draw(_: int) -> tuple[Point, ...]:
        x, y, goal_x, goal_y = (_uniform(chance, 10.0, 20.0) for _ in range(4))
        return (x, y), (goal_x, goal_y)

    return _open(place, density, draw, goals=True)


def _perpendicular(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people who walk at right angles to the target's path, at least 0.9 m."""

    def draw(_: int) -> tuple[Point, ...]:
        x, y, goal_y = (_uniform(chance, 10.0, 20.0) for _ in range(3))
        while abs(goal_y - y) < 0.9:
            goal_y = _uniform(chance, 10.0, 20.0)
        return (x, y), (x, goal_y)

    return _open(place, density, draw)


def _parallel(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people parallel to the target's path: the first half above it, the others below."""

    def draw(number: int) -> tuple[Point, ...]:
        is_above = number < (density.humans + 1) // 2
        x = _uniform(chance, 10.0, 20.0)
        y = _uniform(chance, 15.5, 19.5) if is_above else _uniform(chance, 11.0, 14.5)
        forward = chance.random() < 0.5
        goal_x = _uniform(chance, x + 2.0, 29.5) if forward else _uniform(chance, 0.5, x - 2.0)
        return (x, y), (goal_x, y)

    return _open(place, density, draw)


def _half_way(cls: str, density: Density) -> float:
    """Return half the width [m] in which people walk: the free part after inflation."""
    assert density.width is not None  # layouts with walls have a width
    return density.width / 2.0 - SETTINGS[cls].inflation_cells * CELL_M / 2.0


def _corridor(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people in a corridor, who walk from one half to the other.

    Between a quarter and three quarters of the people walk to the right. No goal is near the start
    of a person drawn before.
    """
    target = Pose2D(8.0, 5.0, 0.0)
    clear, ways, half = _target("Corridor", place, target), Ways(), _half_way("Corridor", density)
    gap = 2.0 if density.humans <= 12 else 1.4
    fewest, most = density.humans // 4, 3 * density.humans // 4
    rightwards = int(chance.integers(fewest, most, endpoint=True))

    def draw(forward: bool) -> tuple[Point, ...]:
        left, right = (
            (_uniform(chance, low, high), _uniform(chance, 5.0 - half, 5.0 + half))
            for low, high in ((0.5, 18.5), (21.5, 37.0))
        )
        return (left, right) if forward else (right, left)

    def is_clear(way: tuple[Point, ...]) -> bool:
        return _away(way[0], clear, CLEAR_M) and _away(way[-1], _starts(ways), gap)

    for number in range(density.humans):
        forward = number < rightwards
        ways.append(_apart(partial(draw, forward), ways, gap, is_clear))
    assert density.width is not None
    wall = round(5.0 - density.width / 2.0, 6)
    boxes = (Box(20.0, wall / 2.0, 0.0, 40.0, wall), Box(20.0, 10.0 - wall / 2.0, 0.0, 40.0, wall))
    return _Drawn(target, (38.5, 5.0), ways, boxes)


def _routes() -> Iterator[tuple[int, int]]:
    """Yield the routes over the crossing, from arm to arm: straight routes first, then turns.

    Arms: top 0, bottom 1, left 2, right 3.
    """
    yield from ((0, 1), (1, 0), (2, 3), (3, 2))
    yield from ((0, 3), (0, 2), (1, 3), (1, 2), (2, 0), (2, 1), (3, 0), (3, 1))


def _intersection(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people on two crossing paths; on average three in four turn off at the crossing.

    No goal is near the start of a person drawn before; starts and goals are clear of the target's
    and the robot's start.
    """
    target = Pose2D(8.0, 20.0, 0.0)
    clear, ways = _target("Intersection", place, target), Ways()
    half = _half_way("Intersection", density)
    routes = list(_routes())

    def lateral() -> float:
        return _uniform(chance, 20.0 - half, 20.0 + half)

    def on_arm(arm: int) -> Point:
        far = _uniform(chance, 25.0, 37.5 if arm == 3 else 39.5)
        along, across = far if arm in {0, 3} else round(40.0 - far, 2), lateral()
        return (across, along) if arm in {0, 1} else (along, across)

    def draw(route: int) -> tuple[Point, ...]:
        start, goal = (on_arm(arm) for arm in routes[route])
        return (start, goal) if route < 4 else (start, (lateral(), lateral()), goal)

    def is_clear(way: tuple[Point, ...]) -> bool:
        return _away(way[-1], _starts(ways), OPEN_GAP_M) and all(
            _away(at, clear, 2.0) for at in (way[0], way[-1])
        )

    straight = int(chance.binomial(density.humans, 0.25))
    shares = _shares(straight, 4, chance) + _shares(density.humans - straight, 8, chance)
    for route in np.repeat(np.arange(len(routes)), shares):
        ways.append(_apart(partial(draw, int(route)), ways, OPEN_GAP_M, is_clear))
    assert density.width is not None
    side = round(20.0 - density.width / 2.0, 6)
    near, far = side / 2.0, 40.0 - side / 2.0
    corners = ((near, far), (near, near), (far, near), (far, far))
    return _Drawn(target, (38.5, 20.0), ways, tuple(Box(x, y, 0.0, side, side) for x, y in corners))


def _doorway(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people on both sides of a wall, who walk through its only door.

    Starts are apart from each other, as are goals, and both are apart from the target's start and
    goal.
    """
    gap = 2.0 if density.humans <= 6 else 1.5

    def draw(upwards: bool) -> tuple[Point, ...]:
        below, above = ((float(chance.uniform(8.0, 32.0)), y) for y in (5.0, 16.0))
        return (below, above) if upwards else (above, below)

    own, ways = draw(upwards=True), Ways()
    target = Pose2D(*own[0], math.pi / 2)

    def is_clear(way: tuple[Point, ...]) -> bool:
        return _away(way[-1], _ends(ways), gap) and all(_away(at, list(own), 3.0) for at in way)

    upwards = int(chance.binomial(density.humans, 0.5))
    for number in range(density.humans):
        up = number < upwards
        ways.append(_apart(partial(draw, up), ways, gap, is_clear))
    assert density.width is not None
    length = round(20.0 - density.width / 2.0, 6)
    boxes = (
        Box(length / 2.0, 10.0, 0.0, length, 0.4),
        Box(40.0 - length / 2.0, 10.0, 0.0, length, 0.4),
    )
    return _Drawn(target, own[-1], ways, boxes)


WALL_M = 0.0001
"""Thickness of the walls around the clutter [m]."""
FROM_WALL_M = math.sqrt(2.0)
"""Minimum distance of people and of boxes in the grid from the walls [m]: half the diagonal of the
largest box, 2 m x 2 m."""
NEAR_WALL_M = 0.8
"""Minimum distance of the centre of a box outside the grid from the walls [m]."""
BETWEEN_BOXES_M = 2.0
"""Minimum distance between the centres of boxes [m]."""
FROM_ENDS_M = 2.5
"""Minimum distance of a box's centre from start and goal of the target [m]."""
CLUTTER_GAP_M = 2.0
"""Minimum distance between people in the clutter at the start [m]."""


def _clutter(place: Place, density: Density, chance: np.random.Generator) -> _Drawn:
    """Return people who walk at random between boxes, with 19 way-points each."""
    target = Pose2D(2.5, 2.5, math.pi / 4)
    end = 28.5 if place == "back" else 27.0
    boxes = _boxes(density.obstacles or 0, (target[:2], (end, end)), chance)
    clear, ways = _target("Clutter", place, target), Ways()

    def is_clear(way: tuple[Point, ...]) -> bool:
        return _away(way[0], clear, CLEAR_M)

    for _ in range(density.humans):
        ways.append(_apart(lambda: (_free_point(boxes, chance),), ways, CLUTTER_GAP_M, is_clear))
    return _Drawn(target, (end, end), [_stroll(way[0], boxes, chance) for way in ways], boxes)


def _boxes(number: int, ends: tuple[Point, Point], chance: np.random.Generator) -> tuple[Box, ...]:
    """Return four walls, and boxes of 0.6 to 2 m: one in each cell of a grid, the others anywhere.

    The first 70 % are parallel to the axes, the others are turned.

    Raises:
        _Jammed: A box has no room.
    """
    half, far = WALL_M / 2.0, 30.0 - WALL_M / 2.0
    boxes = [
        Box(15.0, half, 0.0, 30.0, WALL_M),
        Box(15.0, far, 0.0, 30.0, WALL_M),
        Box(half, 15.0, 0.0, WALL_M, 30.0),
        Box(far, 15.0, 0.0, WALL_M, 30.0),
    ]
    side = math.isqrt(number)
    cell = 30.0 / side
    centres = [(cell * (i + 0.5), cell * (j + 0.5)) for i in range(side) for j in range(side)]

    def add(centre: Point, reach: float, from_wall: float) -> None:
        for _ in range(10):
            at = chance.uniform(-reach, reach, 2) + centre
            x, y = (float(v) for v in np.clip(at, from_wall, 30.0 - from_wall))
            if all(math.dist((x, y), end) >= FROM_ENDS_M for end in ends) and all(
                math.dist((x, y), box[:2]) >= BETWEEN_BOXES_M for box in boxes[4:]
            ):
                is_turned = len(boxes) - 4 >= round(0.7 * number)
                yaw = float(chance.uniform(-math.pi, math.pi)) if is_turned else 0.0
                length, width = (float(v) for v in chance.uniform(0.6, 2.0, 2))
                boxes.append(Box(x, y, yaw, length, width))
                return

    for x, y in centres:
        is_end = any(abs(x - ex) < cell / 2.0 and abs(y - ey) < cell / 2.0 for ex, ey in ends)
        if not is_end or side < 4:
            add((x, y), cell / 4.0, FROM_WALL_M)
    for _ in range(TRIES):
        if len(boxes) == number + 4:
            return tuple(boxes)
        add((15.0, 15.0), 15.0, NEAR_WALL_M)
    raise _Jammed


def _is_free(x: float, y: float, boxes: tuple[Box, ...]) -> bool:
    """Return whether a point is clear of boxes and walls."""
    if not all(FROM_WALL_M <= v <= 30.0 - FROM_WALL_M for v in (x, y)):
        return False
    point = np.array([[x, y]])
    for box in boxes[4:]:
        if math.dist((x, y), box[:2]) < 2.0 * FROM_WALL_M:  # otherwise no corner is near
            ahead, beside = between(Pose2D(*box[:3]), point).T
            half = (box.length / 2.0, box.width / 2.0)
            if to_rectangle(ahead, beside, half)[0] < FROM_WALL_M:
                return False
    return True


def _free_point(boxes: tuple[Box, ...], chance: np.random.Generator) -> Point:
    """Return a random point that is clear of boxes and walls."""
    while True:
        x, y = (float(v) for v in chance.uniform(0.0, 30.0, 2))
        if _is_free(x, y, boxes):
            return x, y


def _stroll(start: Point, boxes: tuple[Box, ...], chance: np.random.Generator) -> tuple[Point, ...]:
    """Return a start and 19 points, each 2 to 4 m from the previous point.

    Raises:
        _Jammed: No free point was found around a point.
    """
    way = [start]
    tries = 0
    while len(way) < 20:
        tries += 1
        if tries > TRIES:
            raise _Jammed
        x, y = way[-1]
        step, angle = float(chance.uniform(2.0, 4.0)), float(chance.uniform(-math.pi, math.pi))
        x, y = x + step * math.cos(angle), y + step * math.sin(angle)
        if _is_free(x, y, boxes):
            way.append((x, y))
    return tuple(way)


DRAW: dict[str, Callable[[Place, Density, np.random.Generator], _Drawn]] = {
    "Circular": _circular,
    "Crowd": _crowd,
    "Parallel": _parallel,
    "Perpendicular": _perpendicular,
    "Corridor": _corridor,
    "Intersection": _intersection,
    "Doorway": _doorway,
    "Clutter": _clutter,
}
