"""Paths: the person's motion at any simulated time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter

import numpy as np
import scipy  # its parts are loaded when they are used
from mecazen.config import WorldConfig
from mecazen.config import people as config
from mecazen.config.world import Box
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, rotate

from mecazen_people import wander
from mecazen_people.body.files import READERS
from mecazen_people.body.recording import read_pelvis
from mecazen_people.curves import Curve, arcs, lemniscate, smooth_curve
from mecazen_people.dataset import read_track
from mecazen_people.forces import nearest, shapes_of
from mecazen_people.motion import PersonMotion, PersonPath
from mecazen_people.recorded import recorded_walk

SCRIPT_YAW_ACCELERATION_DEG_S2 = 720.0
STEP_M, LONGEST_STEP_S = 0.02, 0.1
"""Distance between checked positions of a path, and the longest time between them [s]."""
TURN_S = 2.0
"""Time of a turn on the spot by 180°, between the ways of who walks back and forth."""
TRACK_SMOOTHING_S, MOTION_SMOOTHING_S = 0.8, 0.3
"""Window of the moving average of tracked people, and of the pelvis in a motion file [s]."""
CELL_S = 0.005
"""Within a cell of a script the velocity is that of its middle: a stop from 1.8 m/s is 2 mm off at
most."""


def along(curve: Curve, speed: float) -> PersonPath:
    """Return a curve walked at constant `speed` [m/s] from time 0; the person stands at its end."""
    duration = curve.length / speed

    def at(t: float) -> PersonMotion:
        s = min(max(t, 0.0) * speed, curve.length)
        pose, curvature = curve.at(s)
        if not 0.0 <= t < duration:
            return PersonMotion(pose, Twist2D(), s)
        return PersonMotion(pose, Twist2D(speed, 0.0, speed * curvature), s)

    return PersonPath(duration, at)


def by_twists(twists: Iterable[Twist2D]) -> PersonPath:
    """Return a walk with a velocity in the person's frame for each cell of `CELL_S`."""
    cells: list[PersonMotion] = []
    pose, walked = Pose2D(), 0.0
    for twist in twists:
        cells.append(PersonMotion(pose, twist, walked))
        pose = pose.integrate(twist, CELL_S)
        walked += math.hypot(twist.x, twist.y) * CELL_S
    last = PersonMotion(pose, Twist2D(), walked)

    def at(t: float) -> PersonMotion:
        if t < 0.0:
            return PersonMotion(Pose2D())
        number = math.floor(t / CELL_S + 1e-9)
        if number >= len(cells):
            return last
        pose, twist, walked = cells[number]
        since = max(t - number * CELL_S, 0.0)
        walked += math.hypot(twist.x, twist.y) * since
        return PersonMotion(pose.integrate(twist, since), twist, walked)

    return PersonPath(len(cells) * CELL_S, at)


def scripted(
    steps: Sequence[tuple[float, Twist2D]], acceleration: float, yaw_acceleration: float
) -> Iterator[Twist2D]:
    """Yield the velocity of each cell, for steps of a duration [s] and a velocity; then comes rest.

    It changes by at most `acceleration` [m/s²] and `yaw_acceleration` [rad/s²].
    """
    change = acceleration * CELL_S, yaw_acceleration * CELL_S
    twist, cells, end = Twist2D(), 0, 0.0
    for duration, goal in (*steps, (math.inf, Twist2D())):
        end += duration
        while cells * CELL_S < end - 1e-9 and not (twist == goal and math.isinf(end)):
            before, twist, cells = twist, _towards(twist, goal, *change), cells + 1
            yield Twist2D(*((a + b) / 2 for a, b in zip(before, twist, strict=True)))


def back_and_forth(path: PersonPath) -> PersonPath:
    """Return a path walked to its end, and back on the same line, again and again.

    At both ends the person turns to the left, on the spot. An endless path has no end to turn at.
    """
    duration = path.duration
    length = 0.0 if math.isinf(duration) else path.at(duration).distance

    def at(t: float) -> PersonMotion:
        ways, since = divmod(max(t, 0.0), duration + TURN_S)
        returns = ways % 2.0 == 1.0
        pose, twist, distance = path.at(duration - since if returns else min(t, since))
        yaw, turned = pose.yaw, since - duration
        if returns:
            # the velocity is reversed, and so are the axes in which it is given
            yaw, twist = yaw + math.pi, twist._replace(yaw=-twist.yaw)
            distance = length - distance
        if turned > 0.0:
            yaw, twist = yaw + math.pi * turned / TURN_S, Twist2D(yaw=math.pi / TURN_S)
        return PersonMotion(pose._replace(yaw=yaw), twist, ways * length + distance)

    return PersonPath(math.inf, at)


def placed(path: PersonPath, start: Pose2D, start_after: float = 0.0) -> PersonPath:
    """Return a path that starts at the time `start_after` [s], with its frame at `start`."""

    def at(t: float) -> PersonMotion:
        pose, twist, distance = path.at(t - start_after)
        return PersonMotion(start.compose(pose), twist, distance)

    return PersonPath(start_after + path.duration, at)


def start_pose(path: config.Walk | config.Driven | config.Goal) -> Pose2D:
    """Return the pose in the world at which a path starts."""
    return Pose2D(path.x_m, path.y_m, math.radians(path.yaw_deg))


def make_path(path: config.Walk) -> PersonPath:
    """Return the configured path, in the world."""
    start = start_pose(path)
    match path:
        case config.Standing():
            return placed(along(arcs([(0.0, 0.0)]), 1.0), start)
        case config.Recorded():
            reader, smoothing = read_track, TRACK_SMOOTHING_S
            if path.file.suffix.lower() in READERS:
                reader, smoothing = read_pelvis, MOTION_SMOOTHING_S
            walk = recorded_walk(reader(path.file), path.smoothing_s or smoothing)
            start = start.compose(walk.at(0.0).pose.between(Pose2D()))
        case config.Script():
            steps = []
            for step in path.steps:
                x, y = rotate(step.speed_m_s, 0.0, math.radians(step.direction_deg))
                twist = Twist2D(x, y, math.radians(step.yaw_rate_deg_s))
                steps.append((step.duration_s, twist))
            yaw = math.radians(SCRIPT_YAW_ACCELERATION_DEG_S2)
            walk = by_twists(scripted(steps, path.acceleration_m_s2, yaw))
        case config.Wander():
            walk = by_twists(wander.twists(path.number, path.duration_s, CELL_S))
        case _:
            walk = along(_curve(path), path.speed_m_s)
    if path.back_and_forth:
        walk = back_and_forth(walk)
    return placed(walk, start, path.start_after_s)


def check_path(path: PersonPath, world: WorldConfig, height: float, until: float) -> None:
    """Refuse a path that crosses an obstacle before the time `until` [s].

    The middle of a person of `height` [m] must stay outside of all obstacles.
    """
    solids = [solid for solid in world.solids if solid.bottom_m < height]
    t, end = 0.0, min(path.duration, until)
    times, places = [], []
    while solids and t <= end:
        pose, twist, _ = path.at(t)
        times.append(t)
        places.append(pose[:2])
        t += min(LONGEST_STEP_S, STEP_M / max(math.hypot(twist.x, twist.y), 1e-6))
    crossings = []
    if solids:
        xy = np.array(places)
        gaps, _ = scipy.spatial.KDTree(xy).query([solid.position_m for solid in solids])
        # a map has thousands of boxes, most of them far away
        reaches = [math.hypot(*solid.size_m[:2]) for solid in solids]
        near = [solids[row] for row in np.flatnonzero(gaps < reaches)]
        for solid, shape in zip(near, shapes_of(near), strict=True):
            _, distances = nearest(xy, shape[None])
            if (distances < 0.0).any():
                crossings.append((times[int(np.argmax(distances < 0.0))], solid))
    if crossings:
        t, solid = min(crossings, key=itemgetter(0))
        kind, (x, y) = "box" if isinstance(solid, Box) else "cylinder", solid.position_m
        raise ConfigError(f"crosses the {kind} at [{x:g}, {y:g}] after {t:.1f} s; move one of them")


def _curve(
    path: config.UTrack | config.Straight | config.Circle | config.FigureOfEight | config.Waypoints,
) -> Curve:
    match path:
        case config.UTrack():
            curvature = path.yaw_rate_rad_s / path.speed_m_s
            straight = (path.length_m, 0.0)
            arc = (math.pi / curvature, _side(path.turn) * curvature)
            return arcs([straight, arc, straight])
        case config.Straight():
            return arcs([(path.length_m, 0.0)])
        case config.Circle():
            return arcs([(math.inf, _side(path.turn) / path.radius_m)])
        case config.FigureOfEight():
            return lemniscate(path.length_m, _side(path.turn))
        case config.Waypoints():
            return smooth_curve(path.points_m)


def _side(turn: config.Turn) -> float:
    return 1.0 if turn == "left" else -1.0


def _towards(twist: Twist2D, goal: Twist2D, linear: float, yaw: float) -> Twist2D:
    """Return a twist moved towards `goal` by at most `linear` and `yaw`."""
    dx, dy, dw = goal.x - twist.x, goal.y - twist.y, goal.yaw - twist.yaw
    size = math.hypot(dx, dy)
    share = min(1.0, linear / size) if size else 0.0
    return Twist2D(
        goal.x if share == 1.0 else twist.x + share * dx,
        goal.y if share == 1.0 else twist.y + share * dy,
        goal.yaw if abs(dw) <= yaw else twist.yaw + math.copysign(yaw, dw),
    )
