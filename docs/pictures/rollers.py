"""Wheels close up, with every roller and the contact forces from the physics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.collections import PolyCollection
from mecazen.config import PhysicsConfig
from mecazen.geometry import Pose2D
from mecazen.links import hub_radius, robot_links
from mecazen.loading import load_scenario, scenario_path
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller
from mecazen.wheels import WheelCommand
from mecazen_physics.simulation import Simulation

from docs.pictures import oblique
from docs.pictures.oblique import Array, Camera, Stage, at

TORQUES_NM = -0.6, 0.6, 0.6, -0.6
"""Torques of the motors: the robot accelerates to its left."""
STEPS = 40
SIZE_PX = 640, 426
LIGHT = np.array((0.35, 0.45, 0.82))
M_PER_N = 0.0028
"""Length of an arrow per force [m/N]."""
ROLLER, HUB, BODY = (0.36, 0.42, 0.49), (0.80, 0.83, 0.87), (0.98, 0.80, 0.36)
LEGEND = (("normal force", oblique.BLUE), ("friction, along the axis of a roller", oblique.RED))


class Contact(NamedTuple):
    """A contact of a roller with the ground, in world."""

    point: Array
    normal: Array
    """The vertical part of the ground's force on the roller [N]."""
    friction: Array
    """The horizontal part of this force [N]."""


def draw(file: Path) -> None:
    """Draw a robot that accelerates to its left."""
    robot = load_scenario(scenario_path("back")).robot
    simulation = accelerated(robot)
    state = simulation.robots[0].state
    pose = Pose2D(state.position[0], state.position[1], state.yaw)
    stage = Stage(Camera(at(pose, 0.58, 0.52, 0.30), at(pose, 0.0, 0.035, 0.045), SIZE_PX, 42.0))
    _ground(stage, pose)
    angles = dict(zip(WHEELS, state.joint_position, strict=False))
    wheels = sorted(WHEELS, key=lambda name: -_depth(stage, pose, robot, name))
    forces = sorted(contacts(simulation), key=lambda one: -float(stage.camera.depth(one.point)))
    _wheel(stage, robot, pose, wheels[0], angles[wheels[0]])
    _arrows(stage, forces[:1])
    base = robot.base
    size = base.length_m, base.width_m, base.height_m
    stage.box(pose, size, base.clearance_m, BODY, alpha=0.55)
    for name in wheels[1:]:
        _wheel(stage, robot, pose, name, angles[name])
    _arrows(stage, forces[1:])
    stage.legend(LEGEND)
    stage.picture().save(file, optimize=True)


def accelerated(robot: Robot) -> Simulation:
    """Return the simulation of a robot that has accelerated to its left from rest."""
    simulation = Simulation([(robot, Pose2D(0.0, 0.0))], PhysicsConfig())
    simulation.advance([WheelCommand(TORQUES_NM, is_effort=True)], STEPS)
    return simulation


def contacts(simulation: Simulation) -> list[Contact]:
    """Return the contacts of the last step of an isolated robot."""
    world = simulation.robots[0].body.world
    c, s = math.cos(world.heading), math.sin(world.heading)
    to_world = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    found = []
    for contact in world.dart.getLastCollisionResult().getContacts():
        force = to_world @ contact.force
        force *= math.copysign(1.0, force[2])  # the force of the ground points upwards
        up = np.array((0.0, 0.0, force[2]))
        found.append(Contact(to_world @ contact.point, up, force - up))
    return found


def _depth(stage: Stage, pose: Pose2D, robot: Robot, name: str) -> float:
    return float(stage.camera.depth(at(pose, *robot.wheel_position(name))))


def _ground(stage: Stage, pose: Pose2D) -> None:
    along = np.linspace(-2.0, 0.6, 40)
    for k in np.arange(-20, 7) / 10.0:
        stage.line(at(pose, along, k, 0.0), oblique.GRID, 0.8)
        stage.line(at(pose, k, along, 0.0), oblique.GRID, 0.8)


def _wheel(stage: Stage, robot: Robot, pose: Pose2D, name: str, angle: float) -> None:
    x, y, z = robot.wheel_position(name)
    below = at(pose, x, y, 0.0)
    stage.disc(below[0], below[1], 0.045, oblique.SHADE, alpha=0.6)
    shape = Roller.from_robot(robot)
    vertices, triangles = shape.mesh(rings=17, segments=24)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
    faces, colors = [], []
    for link in robot_links(robot):
        if link.parent == f"{name}_wheel":
            local = (vertices @ link.rotation.T + link.translation) @ turn.T
            faces.append(local[triangles])
            colors.append(np.tile(ROLLER, (len(triangles), 1)))
    hub = _hub(hub_radius(robot), robot.wheels.hub_width_m / 2.0)
    faces.append(hub)
    colors.append(np.tile(HUB, (len(hub), 1)))
    corners = np.concatenate(faces) + (x, y, z)  # noqa: RUF005  # arrays
    world = at(pose, corners[..., 0], corners[..., 1], corners[..., 2])
    _surface(stage, world, np.concatenate(colors))


def _surface(stage: Stage, faces: Array, colors: Array) -> None:
    """Draw the triangles (n, 3, 3) of a surface that face the camera, shaded."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    middles = faces.mean(axis=1)
    seen = ((stage.camera.eye - middles) * normals).sum(axis=1) > 0.0

    shade = 0.55 + 0.45 * np.clip(normals @ LIGHT, 0.0, 1.0)
    order = np.argsort(-stage.camera.depth(middles[seen]))
    paint = np.clip(colors[seen] * shade[seen, None], 0.0, 1.0)[order]
    places = stage.camera.project(faces[seen][order])
    surface = PolyCollection(
        list(places), facecolors=paint, edgecolors=paint, linewidths=0.3, zorder=stage.next()
    )
    stage.axes.add_collection(surface, autolim=False)


def _hub(radius: float, half: float) -> Array:
    """Return a cylinder about y as triangles (n, 3, 3), outward."""
    turn = np.linspace(0.0, math.tau, 41)
    triangles = []
    for a, b in pairwise(turn):
        p, q = (np.array((radius * math.sin(k), 0.0, radius * math.cos(k))) for k in (a, b))
        side = np.array((0.0, half, 0.0))
        triangles += [(side, side + p, side + q), (-side, -side + q, -side + p)]
        triangles += [(p - side, q - side, q + side), (p - side, q + side, p + side)]
    return np.array(triangles)


def _arrows(stage: Stage, forces: Sequence[Contact]) -> None:
    for contact in forces:
        _arrow(stage, contact.point, contact.normal, oblique.BLUE)
        _arrow(stage, contact.point, contact.friction, oblique.RED)


def _arrow(stage: Stage, point: Array, force: Array, color: str) -> None:
    tip = point + M_PER_N * force
    tail, head = stage.camera.project(np.array((point, tip)))
    look = {"arrowstyle": "-|>,head_width=0.28,head_length=0.5", "color": color, "linewidth": 2.2}
    look |= {"shrinkA": 0.0, "shrinkB": 0.0}
    stage.axes.annotate("", head, tail, arrowprops=look, zorder=stage.next())
