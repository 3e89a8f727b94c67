"""The animation at the top of the README: a robot follows a person among other people."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from mecazen.config import Scenario
from PIL import Image

from docs.pictures import oblique
from docs.pictures.oblique import Array, Camera, Stage, at, beams
from docs.pictures.runs import FOLLOWED, Moment, joints, record

FROM_S, FOR_S, PER_S = 3.0, 8.0, 10
"""The part of the run that is shown, and frames per second."""
SIZE_PX, VIEW_DEG = (600, 338), 44.0
EYE_M, AT_M = (-2.6, -4.5, 2.3), (0.1, 0.0, 0.68)
"""Place of the camera and the point it looks at, from the middle between robot and person."""
SHADOW_M = 0.22
QUALITY = 80
"""Of the compression: lines stay sharp, and the file has a third of the size of a GIF."""
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
    """Return the middle between robot and person (2,) [m]."""
    person = moment.people[FOLLOWED][0, :2]
    halves: Array = 0.5 * np.array((person, moment.robot[:2]))
    both: Array = halves[0] + halves[1]
    return both


def frame(scenario: Scenario, moment: Moment, place: Array) -> Image.Image:
    """Draw a moment, seen from beside a place (2,) [m]."""
    base = np.append(place, 0.0)
    stage = Stage(Camera(base + EYE_M, base + AT_M, SIZE_PX, VIEW_DEG))
    scene(stage, scenario, moment, base)
    stage.legend(LEGEND)
    return stage.picture()


def scene(stage: Stage, scenario: Scenario, moment: Moment, base: Array) -> None:
    """Draw ground, robot and people of a moment, and what the sensors see."""
    robot = scenario.robot
    hits, ends = beams(moment.latest["scan"], robot.lidar.position_m, moment.robot)
    stage.fill(ends[stage.camera.depth(ends) > 0.3], oblique.SEEN)
    stage.ground(base.tolist())
    places = [body[0, :2].tolist() for body in moment.people.values()]
    for x, y in (*places, moment.robot[:2]):
        stage.disc(x, y, SHADOW_M, oblique.SHADE, alpha=0.6)
    for goal in moment.follower.goal:
        stage.outline(goal.to_planar(), robot.footprint, oblique.GREEN, 1.6)
    things = []
    for name, body in moment.people.items():
        look = oblique.FOLLOWED_LOOK if name == FOLLOWED else oblique.OTHER_LOOK
        things.append((body, partial(stage.body, body, look)))
    turned = moment.latest["joint_states"].position[:4]
    robot_at = at(moment.robot, 0.0, 0.0, 0.1)
    things.append((robot_at, partial(stage.robot, robot, moment.robot, turned)))
    stage.far_to_near(things)
    stage.dots(hits, oblique.BLUE, 5.0)
    for seen in moment.bones:
        x, y, z = joints(seen.joints).T
        known = seen.confidence or (2,) * len(x)
        stage.bones(at(moment.bones_from, x, y, z), [sure > 0 for sure in known])


def _smooth(places: Array) -> Array:
    """Return places (n, 2) without the sway of single steps."""
    count = 2 * PER_S + 1
    padded = np.pad(places, ((PER_S, PER_S), (0, 0)), mode="reflect", reflect_type="odd")
    mean = np.full(count, 1.0 / count)
    return np.column_stack([np.convolve(axis, mean, mode="valid") for axis in padded.T])
