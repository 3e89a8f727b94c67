"""The robot from its URDF: shapes, and their poses from joint states.

Equal shapes, such as the rollers, are instances of one entity.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter

import numpy as np
import rerun as rr
from mecazen.arrays import chain, quaternions_about, quaternions_of_rpy, turn
from mecazen.errors import RefusedError
from mecazen.messages import JointState
from mecazen.urdf import Joint, Origin, Urdf, Visual

from mecazen_viewer import layout
from mecazen_viewer.layout import Entity


class RobotModel:
    """The robot as entities below `world/robot`, which is the frame of the root link.

    Raises:
        RefusedError: The joints form a cycle, or a mesh is missing.
    """

    def __init__(self, urdf: Urdf, meshes: Mapping[str, bytes]) -> None:
        """Take the URDF and its mesh files by their names in the URDF."""
        joints = {joint.child: joint for joint in urdf.joints}
        above: dict[str, tuple[str, ...]] = dict.fromkeys(urdf.visuals, ())
        above |= {child: (joint.parent,) for child, joint in joints.items()}
        try:
            links = list(TopologicalSorter(above).static_order())
        except CycleError as error:
            raise RefusedError(f"the joints form a cycle: {error.args[1]}") from None
        number = {link: index for index, link in enumerate(links)}
        root = Joint("", "fixed", "", "", Origin(), None)
        rows = [joints.get(link, root) for link in links]
        self._joints = [joint.name if joint.axis else "" for joint in rows]
        """The joint above each link; empty for a fixed one."""
        self._parents = [number.get(joint.parent, index) for index, joint in enumerate(rows)]
        self._positions = np.array([joint.origin.xyz for joint in rows])
        self._rotations = quaternions_of_rpy([joint.origin.rpy for joint in rows])
        self._axes = np.array([joint.axis or (0.0, 0.0, 0.0) for joint in rows])
        instances = defaultdict(list)
        for link, visual in urdf.visuals.items():
            instances[visual].append(number[link])
        self._instances = {
            f"{layout.ROBOT}/{links[indices[0]]}": (visual, indices)
            for visual, indices in instances.items()
        }
        self.shapes = [
            (path, _shape(visual, meshes)) for path, (visual, _) in self._instances.items()
        ]
        """The shapes, which stay the same."""

    def pose(self, states: JointState) -> Iterator[Entity]:
        """Return the poses of all shapes; the angle of a joint that is not among `states` is 0."""
        angles = dict(zip(states.name, states.position, strict=False))
        turned = quaternions_about(self._axes, [angles.get(name, 0.0) for name in self._joints])
        rotations, positions = chain(self._rotations, turned), self._positions.copy()
        for link, parent in enumerate(self._parents):
            if link != parent:
                positions[link] = positions[parent] + turn(rotations[parent], positions[link])
                rotations[link] = chain(rotations[parent], rotations[link])
        for path, (visual, links) in self._instances.items():
            places, origin = positions[links], visual.origin
            places += turn(rotations[links], np.broadcast_to(origin.xyz, places.shape))
            turned = chain(rotations[links], quaternions_of_rpy(origin.rpy))
            yield path, rr.InstancePoses3D(translations=places, quaternions=turned)


def _shape(visual: Visual, meshes: Mapping[str, bytes]) -> rr.AsComponents:
    colours = [visual.rgba]
    if visual.kind == "mesh":
        if visual.mesh not in meshes:
            raise RefusedError(f"no file for the mesh {visual.mesh!r}")
        stl = rr.components.MediaType.STL
        return rr.Asset3D(contents=meshes[visual.mesh], media_type=stl, albedo_factor=visual.rgba)
    if visual.kind == "box":
        return rr.Boxes3D(sizes=[visual.size], colors=colours, fill_mode="solid")
    radius, length = visual.size
    return rr.Cylinders3D(radii=[radius], lengths=[length], colors=colours, fill_mode="solid")
