"""The robot from its URDF: shapes once, and the poses of what turns by the joint states.

Leaves that hang on one parent and share one mesh, as the rollers of a wheel do, are drawn as
instances of it: one entity for each wheel instead of one for each roller.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import rerun as rr
from mecazen.messages import JointState

from mecazen_viewer import entities as e
from mecazen_viewer import rotation
from mecazen_viewer.entities import Entity
from mecazen_viewer.stl import read_stl
from mecazen_viewer.urdf import Joint, Urdf, Visual


class RobotModel:
    """The robot as entities below `world/robot`, which is base_link.

    Raises:
        ValueError: The links are no tree, or a mesh is missing or no binary STL.
    """

    def __init__(self, urdf: Urdf, meshes: Mapping[str, bytes]) -> None:
        """Take the URDF and the files of its meshes by the names that it gives them."""
        self._urdf, self._meshes = urdf, meshes
        self.shapes: list[Entity] = []
        """What never changes."""
        self._turning: list[tuple[str, slice, bool]] = []
        joints: list[Joint] = []
        children = defaultdict(list)
        for joint in urdf.joints:
            children[joint.parent].append(joint)
        roots = set(children) - {joint.child for joint in urdf.joints}
        if len(roots) != 1:
            raise ValueError(f"the links are no tree with one root: {sorted(roots)}")
        self._add(roots.pop(), e.ROBOT, children, joints)
        self._joints = tuple(joint.name for joint in joints)
        self._translation = np.array([joint.origin.xyz for joint in joints], dtype=np.float32)
        self._rotation = rotation.from_rpy([joint.origin.rpy for joint in joints])
        self._axis = np.array([joint.axis for joint in joints])
        self._names: tuple[str, ...] = ()
        self._places: list[int] | None = None

    def pose(self, states: JointState) -> Iterator[Entity]:
        """Return what turns; nothing where a joint of this robot is not among the states."""
        if states.name != self._names:
            places = {name: place for place, name in enumerate(states.name)}
            self._names = states.name
            known = places.keys() >= set(self._joints)
            self._places = [places[name] for name in self._joints] if known else None
        if self._places is None or len(states.position) != len(states.name):
            return
        # whole turns show nothing, and single precision has no digits for many of them
        angles = np.remainder(np.array(states.position)[self._places], math.tau)
        turned = rotation.multiply(self._rotation, rotation.about(self._axis, angles))
        turned = turned.astype(np.float32)
        for path, part, instanced in self._turning:
            if instanced:
                yield (
                    path,
                    rr.InstancePoses3D(
                        translations=self._translation[part], quaternions=turned[part]
                    ),
                )
            else:
                first = part.start
                yield path, e.transform(self._translation[first], turned[first])

    def _add(
        self, link: str, path: str, children: Mapping[str, Sequence[Joint]], joints: list[Joint]
    ) -> None:
        """Add a link with all below it; append the joints that turn to `joints`."""
        visuals = self._urdf.visuals
        if link in visuals:
            self.shapes.append((f"{path}/shape", self._shape(visuals[link])))
        shared = defaultdict(list)
        for joint in children.get(link, ()):
            visual = visuals.get(joint.child)
            if joint.axis is not None and visual and visual.mesh and joint.child not in children:
                shared[visual].append(joint)
                continue
            below = f"{path}/{joint.child}"
            if joint.axis is None:
                turn = rotation.from_rpy(joint.origin.rpy)
                self.shapes.append((below, e.transform(np.array(joint.origin.xyz), turn)))
            else:
                self._turning.append((below, slice(len(joints), len(joints) + 1), False))
                joints.append(joint)
            self._add(joint.child, below, children, joints)
        for number, (visual, instances) in enumerate(shared.items()):
            below = f"{path}/instances_{number}"
            self.shapes.append((below, self._shape(visual)))
            self._turning.append((below, slice(len(joints), len(joints) + len(instances)), True))
            joints += instances

    def _shape(self, visual: Visual) -> rr.AsComponents:
        if visual.kind == "mesh":
            if visual.mesh not in self._meshes:
                raise ValueError(f"no file for the mesh {visual.mesh!r}")
            vertices, triangles, normals = read_stl(self._meshes[visual.mesh])
            return rr.Mesh3D(
                vertex_positions=vertices,
                triangle_indices=triangles,
                vertex_normals=normals,
                albedo_factor=visual.rgba,
            )
        centres, turns = [visual.origin.xyz], [rotation.from_rpy(visual.origin.rpy)]
        if visual.kind == "box":
            return rr.Boxes3D(
                sizes=[visual.size],
                centers=centres,
                quaternions=turns,
                colors=[visual.rgba],
                fill_mode="solid",
            )
        radius, length = visual.size
        return rr.Cylinders3D(
            radii=[radius],
            lengths=[length],
            centers=centres,
            quaternions=turns,
            colors=[visual.rgba],
            fill_mode="solid",
        )
