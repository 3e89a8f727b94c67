"""A recorded robot as programs for ROS bags draw it: its URDF, and its frames in `/tf`.

The frames are world → odom → base_link → wheels → rollers, as REP-105 has it. They follow from
samples of `ground_truth/odom`, `odom` and `joint_states`. Names have no slash in front on the bus,
so these topics repeat samples and are not samples themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from mecazen import keys
from mecazen import messages as m
from mecazen.arrays import chain, quaternions_about, quaternions_of_rpy, turn
from mecazen.config import Scenario
from mecazen.portable import Floats
from mecazen.robots import join_key
from mecazen.urdf import build_meshes, build_urdf, portable_urdf, read
from mecazen_ros.topics import (
    TF_STATIC,
    TFMessage,
    Transform,
    TransformStamped,
    child_frame,
    fixed_frames,
    prefixed,
)
from msgspec.structs import astuple

PERIOD_NS = 40_000_000
"""Interval of the frames of joints, of which a robot has about 50 [ns]."""
INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])
"""Times a quaternion: the inverse rotation."""


class RobotFrames:
    """The description of a robot, and its frames by the samples so far."""

    def __init__(self, scenario: Scenario, robot: str) -> None:
        part = scenario.of(robot)
        self._robot, self._prefix = robot, join_key("", robot)
        self._urdf = build_urdf(part.robot, part.controller.base_frame_id)
        self._meshes = build_meshes(part.robot)
        self._joints = {j.name: j for j in read(self._urdf).joints if j.axis is not None}
        self._rotations = quaternions_of_rpy([j.origin.rpy for j in self._joints.values()])
        self._axes = np.array([j.axis for j in self._joints.values()])
        self._truth: m.Odometry | None = None
        self._period = -1

    def description(self) -> Iterator[tuple[str, m.Message]]:
        """Yield topics and messages that stay the same in a run."""
        root = ET.fromstring(portable_urdf(self._urdf, self._meshes))  # noqa: S314 - built above
        root.set("name", self._robot or root.attrib["name"])
        for link in root.iterfind("link"):
            link.set("name", self._prefix + link.attrib["name"])
        for end in root.iterfind("joint/*[@link]"):
            end.set("link", self._prefix + end.attrib["link"])
        urdf = m.String(data=ET.tostring(root, encoding="unicode", xml_declaration=True))
        yield f"/{join_key(keys.ROBOT_DESCRIPTION.key, self._robot)}", urdf
        yield TF_STATIC, fixed_frames(self._urdf, self._prefix)

    def update(self, topic: str, message: m.Message, time_ns: int) -> Any:
        """Return the frames that a sample of a topic changes as a TFMessage, or None."""
        if topic == keys.GROUND_TRUTH.key and isinstance(message, m.Odometry):
            self._truth = message
        elif topic == keys.ODOM.key and isinstance(message, m.Odometry):
            return prefixed(TFMessage(tuple(self._base(message))), self._prefix)
        elif topic == keys.JOINT_STATES.key and isinstance(message, m.JointState):
            period = time_ns // PERIOD_NS
            if period != self._period:
                self._period = period
                return prefixed(TFMessage(tuple(self._moving(message))), self._prefix)
        return None

    def _base(self, odometry: m.Odometry) -> Iterator[Any]:
        """Yield the frame of the odometry in the world, if the truth is known, and the base."""
        header = odometry.header
        if self._truth is not None:
            place, rotation = _arrays(self._truth.pose.pose)
            odom_place, odom_rotation = _arrays(odometry.pose.pose)
            rotation = chain(rotation, odom_rotation * INVERSE)
            world = m.Header(header.stamp, self._truth.header.frame_id)
            yield _frame(world, header.frame_id, place - turn(rotation, odom_place), rotation)
        yield child_frame(odometry)

    def _moving(self, states: m.JointState) -> Iterator[Any]:
        """Yield the frames of the links that turn."""
        positions = dict(zip(states.name, states.position, strict=False))
        angles = np.array([positions.get(name, 0.0) for name in self._joints])
        rotations = chain(self._rotations, quaternions_about(self._axes, angles))
        for joint, rotation in zip(self._joints.values(), rotations, strict=True):
            header = m.Header(states.header.stamp, joint.parent)
            yield _frame(header, joint.child, np.array(joint.origin.xyz), rotation)


def _frame(header: m.Header, child: str, place: Floats, rotation: Floats) -> Any:
    transform = Transform(m.Vector3(*place.tolist()), m.Quaternion(*rotation.tolist()))
    return TransformStamped(header, child, transform)


def _arrays(pose: m.Pose) -> tuple[Floats, Floats]:
    """Return the position (3) [m] and the orientation (4) of a pose."""
    return np.array(astuple(pose.position)), np.array(astuple(pose.orientation))
