"""The same robot in MuJoCo, from the same links: rollers as capsules, or as convex meshes."""

from __future__ import annotations

import time
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence

import mujoco
from mecazen.links import base_link, lump, robot_links
from mecazen.robot import WHEEL_JOINTS, Robot
from mecazen.rollers import Roller
from mecazen_physics.world import GRAVITY

from mecazen_bench.engine import Engine, Sample
from mecazen_bench.gazebo_peer import Shape

INTEGRATOR = "implicitfast"
OPTIONS: Mapping[str, Mapping[str, str]] = {
    "default": {},
    "elliptic": {"cone": "elliptic", "impratio": "10"},
    "elliptic, noslip": {"cone": "elliptic", "impratio": "10", "noslip_iterations": "3"},
}
"""MuJoCo's options in addition to the integrator: its defaults, and those that its documentation
advises against slip of wheels."""
CONTACT_TIME_CONSTANT_STEPS = 2.0
"""Time constant of contacts in steps; the shortest that MuJoCo allows, for maximum stiffness."""
SERVO_GAIN = 10.0
"""Gain of the wheels' velocity actuators [N·m·s/rad], integrated implicitly."""
MESH_RINGS, MESH_SEGMENTS = 33, 48


class MujocoEngine(Engine):
    """A robot in MuJoCo."""

    def __init__(self, robot: Robot, dt_s: float, shape: Shape, settings: str = "default") -> None:
        name = f"MuJoCo, {shape}" + (f", {settings}" if settings != "default" else "")
        super().__init__(name, robot, dt_s)
        self._model = mujoco.MjModel.from_xml_string(mjcf(robot, dt_s, shape, settings))
        self._data = mujoco.MjData(self._model)
        self._wheels = [int(self._model.joint(name).qposadr[0]) for name in WHEEL_JOINTS]

    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        off = mujoco.mjtDisableBit.mjDSBL_ACTUATION if speeds is None else 0
        self._model.opt.disableflags = off
        begin = time.thread_time()
        self._data.ctrl[:] = 0.0 if speeds is None else speeds
        mujoco.mj_step(self._model, self._data, nstep=steps)
        position = self._data.qpos.tolist()
        self.spent_s += time.thread_time() - begin
        w, *xyz = position[3:7]
        return Sample.from_pose(
            position[:3], (*xyz, w), [position[index] for index in self._wheels]
        )


def mjcf(robot: Robot, dt_s: float, shape: Shape, settings: str = "default") -> str:
    """Return the robot on flat ground as MJCF."""
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = _text([0.0, 0.0, -GRAVITY])
    common = {"timestep": str(dt_s), "gravity": gravity, "integrator": INTEGRATOR}
    ET.SubElement(root, "option", {**common, **OPTIONS[settings]})
    contact = ET.SubElement(ET.SubElement(root, "default"), "geom")
    contact.set("solref", f"{CONTACT_TIME_CONSTANT_STEPS * dt_s} 1")
    contact.set("friction", _text([robot.rollers.contact_friction, 0.0, 0.0]))
    if shape == "mesh":
        vertices, _ = Roller.from_robot(robot).mesh(MESH_RINGS, MESH_SEGMENTS)
        asset = ET.SubElement(root, "asset")
        ET.SubElement(asset, "mesh", name="roller", vertex=_text(vertices.ravel().tolist()))
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "geom", type="plane", size="0 0 1", conaffinity="0")
    _add_robot(world, robot, shape)
    actuators = ET.SubElement(root, "actuator")
    limits = _text([-robot.wheels.max_torque_nm, robot.wheels.max_torque_nm])
    for joint in WHEEL_JOINTS:
        ET.SubElement(actuators, "velocity", joint=joint, kv=str(SERVO_GAIN), forcerange=limits)
    return ET.tostring(root, encoding="unicode")


def _add_robot(world: ET.Element, robot: Robot, shape: Shape) -> None:
    """Add the links as bodies; camera and lidar are part of the base, as in our world."""
    links, roller = robot_links(robot), Roller.from_robot(robot)
    mass, centre, inertia = lump([base_link(robot), *(link for link in links if link.axis is None)])
    base = ET.SubElement(world, "body", name="base_link")
    ET.SubElement(base, "freejoint")
    full = _text(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist())
    ET.SubElement(base, "inertial", pos=_text(centre.tolist()), mass=str(mass), fullinertia=full)
    bodies = {"base_link": base}
    for link in links:
        if link.axis is None:
            continue
        axes = _text(link.rotation[:, :2].T.ravel().tolist())
        place = _text(link.translation)
        body = ET.SubElement(bodies[link.parent], "body", name=link.name, pos=place, xyaxes=axes)
        bodies[link.name] = body
        joint = ET.SubElement(body, "joint", name=link.joint, axis=_text(link.axis))
        centre_of_mass, moments = _text(link.centre), {"diaginertia": _text(link.moments)}
        ET.SubElement(body, "inertial", moments, pos=centre_of_mass, mass=str(link.mass))
        if link.parent != "base_link":
            joint.set("damping", str(robot.rollers.bearing_friction_nms))
            # a roller collides only with the ground
            geom = ET.SubElement(body, "geom", type=shape, contype="0")
            if shape == "mesh":
                geom.set("mesh", "roller")
            else:
                geom.set("size", _text([roller.max_radius, roller.length / 2 - roller.max_radius]))


def _text(values: Iterable[float]) -> str:
    return " ".join(map(repr, map(float, values)))
