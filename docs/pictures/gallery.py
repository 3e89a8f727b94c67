"""Single pictures: sensors side by side, the planner's paths, several robots, and worlds."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from mecazen import Simulation
from mecazen import messages as m
from mecazen.geometry import Pose2D
from mecazen.keys import FOLLOWER_STATE, JOINT_STATES, PEOPLE, of_robot
from mecazen.loading import load_scenario, scenario_path
from PIL import Image, ImageDraw

from docs.pictures import oblique, planning, scene
from docs.pictures.oblique import Array, Camera, Stage, at, beams
from docs.pictures.runs import FOLLOWED, joints, newest, record

SIZE_PX = 480, 320
CHOSEN, CONSIDERED = "#7b3fa0", "#b9a3cf"
PANEL_PX = 180, 372
SENSES_S, PLANNED_S, CONVOY_S = 7.0, 5.8, 6.0
FARTHEST_MM = 5000.0


def sensors(file: Path) -> None:
    """Draw the data of lidar, body tracker and depth camera at one moment."""
    settings: dict[str, Any] = {"sensor.also": ["depth"]}
    scenario, (moment,) = record("senses", [SENSES_S], settings)
    robot, camera = scenario.robot, scenario.robot.camera
    assert camera is not None
    assert robot.lidar is not None
    x, y, _ = moment.robot
    above = scene.from_above(x + 1.0, y, PANEL_PX, 3.4)
    hits, ends = beams(moment.latest["scan"], robot.lidar.position_m, moment.robot)
    above.seen(ends)
    above.ground((x, y))
    turned = moment.latest["joint_states"].position[:4]
    above.robot(robot, moment.robot, turned)
    above.dots(hits, oblique.BLUE, 6.0)
    eye = at(moment.robot, *camera.position_m)
    ahead = np.array(camera.axes[0])
    look = at(moment.robot, *(camera.position_m + ahead))
    tracker = scenario.sensors.tracker
    view_deg = math.degrees(
        2.0
        * math.atan(
            math.tan(math.radians(tracker.vertical_fov_deg) / 2.0) * PANEL_PX[0] / PANEL_PX[1]
        )
    )
    seen = Stage(Camera(eye, look, PANEL_PX, view_deg))
    seen.ground((x, y))
    things = [*scene.solids(seen, scenario.world, math.inf)]
    things += scene.bodies(seen, moment.people, (FOLLOWED,))
    seen.far_to_near(things)
    scene.bones(seen, moment)
    pictures = {
        "lidar": above.picture(),
        "body tracker": seen.picture(),
        "depth": _depth(moment.latest["camera/depth"]),
    }
    for name, picture in pictures.items():
        ImageDraw.Draw(picture).text((10, 6), name, fill=oblique.INK, font_size=15)
    oblique.sheet([*pictures.values()]).save(file, optimize=True)


def _depth(image: m.Image) -> Image.Image:
    """Return the middle of a depth picture: near is dark, white is unknown."""
    pixels = np.frombuffer(image.data, "<u2").reshape(image.height, image.width)
    paint = colormaps["viridis"](np.clip(pixels / FARTHEST_MM, 0.0, 1.0))[..., :3]
    paint[pixels == 0] = 1.0
    whole = Image.fromarray((255.0 * paint).astype(np.uint8))
    width = round(whole.height * PANEL_PX[0] / PANEL_PX[1])
    left = (whole.width - width) // 2
    return whole.crop((left, 0, left + width, whole.height)).resize(PANEL_PX)


def planner(file: Path) -> None:
    """Draw the paths from which the planner chooses, among people."""
    settings: dict[str, Any] = {"follower.planner": {}, "programs.follower": planning.PROGRAM}
    scenario, (moment,) = record("crowd", [PLANNED_S], settings)
    stage = scene.from_above(moment.robot.x + 0.6, moment.robot.y + 0.7, SIZE_PX, 5.6)
    scene.draw(stage, scenario, moment, moment.robot[:2])
    found = moment.latest[planning.WAYS.key]
    ways = np.stack((found.x, found.y), axis=-1).reshape(found.count, -1, 2)
    for k, way in enumerate(ways):
        if k != found.chosen:
            _way(stage, moment.robot, way, CONSIDERED, 1.4)
    _way(stage, moment.robot, ways[found.chosen], CHOSEN, 3.0)
    stage.legend((("the plan", CHOSEN), ("other ways", CONSIDERED), ("goal", oblique.GREEN)))
    stage.picture().save(file, optimize=True)


def _way(stage: Stage, robot: Pose2D, way: Array, color: str, width_px: float) -> None:
    points = np.vstack(((0.0, 0.0), way)) + robot[:2]  # arrays
    stage.line(np.column_stack((points, np.full(len(points), 0.02))), color, width_px)


def convoy(file: Path) -> None:
    """Draw two robots, each behind a person."""
    with Simulation("convoy", {"sensor.kind": "fused"}) as sim:
        sim.run(CONVOY_S)
        names = sim.scenario.names
        robot = sim.scenario.of(names[0]).robot
        poses = {name: sim.state_of(name).robot for name in names}
        people = newest(sim, PEOPLE.key)
        turned = {name: newest(sim, of_robot(JOINT_STATES, name).key) for name in names}
        states = {name: newest(sim, of_robot(FOLLOWER_STATE, name).key) for name in names}
    assert isinstance(people, m.People)
    bodies = {one.id: joints(one.joints) for one in people.persons}
    middle = np.mean([pose[:2] for pose in poses.values()], axis=0)
    base = np.append(middle, 0.0)
    eye, look = base + (-2.6, -3.6, 2.3), base + (0.7, 0.1, 0.6)  # noqa: RUF005  # arrays
    stage = Stage(Camera(eye, look, SIZE_PX, 46.0))
    stage.ground(middle.tolist())
    scene.shadows(stage, [*bodies.values()], [*poses.values()])
    things = scene.bodies(stage, bodies, [*bodies])
    for name, pose in poses.items():
        state, wheels = states[name], turned[name]
        assert isinstance(state, m.FollowerState)
        assert isinstance(wheels, m.JointState)
        for goal in state.goal:
            stage.outline(goal.to_planar(), robot.footprint, oblique.GREEN, 1.6)
        drawn = partial(stage.robot, robot, pose, wheels.position[:4])
        things.append((at(pose, 0.0, 0.0, 0.1), drawn))
    stage.far_to_near(things)
    stage.picture().save(file, optimize=True)


def places(file: Path) -> None:
    """Draw the worlds of configs/worlds, with their walls cut off."""
    folder = scenario_path("back").parents[1] / "worlds"
    files = sorted(folder.glob("*.toml"))
    pictures = []
    for world in files:
        config = load_scenario(scenario_path("back"), {"world": world}).world
        corners = np.array([solid.position_m for solid in config.solids])
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle, size = 0.5 * (low + high), high - low
        width = max(size[0], 1.3 * size[1]) + 1.5
        stage = scene.from_above(middle[0], middle[1], (300, 230), width)
        for patch in config.patches:
            pose = Pose2D(*patch.position_m, math.radians(patch.yaw_deg))
            half = 0.5 * np.array(patch.size_m)
            xy = half * ((1, 1), (-1, 1), (-1, -1), (1, -1))
            stage.fill(at(pose, xy[:, 0], xy[:, 1], 0.0), "#dfe6dc")
        stage.ground(middle.tolist())
        for ridge in config.ridges:
            edge, side = ridge.top / 2.0 + ridge.run, ridge.width / 2.0
            xy = np.array(((edge, side), (-edge, side), (-edge, -side), (edge, -side)))
            stage.fill(at(ridge.middle, xy[:, 0], xy[:, 1], 0.0), "#e7c98f")
        stage.far_to_near(scene.solids(stage, config, 0.8))
        picture = stage.picture()
        ImageDraw.Draw(picture).text((8, 4), world.stem, fill=oblique.INK, font_size=14)
        pictures.append(picture)
    oblique.sheet(pictures).save(file, optimize=True)
