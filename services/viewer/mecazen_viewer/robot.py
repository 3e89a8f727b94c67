"""The robot from its URDF: static shapes, and poses of moving links from joint states.

Equal shapes, such as the rollers, are instances of one entity.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
from mecazen.arrays import chain, quaternions_about, quaternions_of_rpy, turn
from mecazen.errors import RefusedError
from mecazen.messages import JointState
from mecazen.portable import Floats
from mecazen.urdf import Joint, Origin, Urdf, Visual

from mecazen_viewer import layout
from mecazen_viewer.layout import Entity

Singles = npt.NDArray[np.float32]

STL_HEADER_BYTES = 84
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class RobotModel:
    """The robot as entities below `world/robot`, which is base_link.

    Raises:
        RefusedError: The links do not form a tree, or a mesh is missing or not a binary STL.
    """

    def __init__(self, urdf: Urdf, meshes: Mapping[str, bytes]) -> None:
        """Take the URDF and its mesh files by their names in the URDF."""
        root, joints = _tree(urdf)
        links = [root, *(joint.child for joint in joints)]
        number = {link: index for index, link in enumerate(links)}
        self._parents = np.array([0, *(number[joint.parent] for joint in joints)])
        # links of equal depth are placed at once
        depth, turns = [0], [False]
        for joint in joints:
            parent = number[joint.parent]
            depth.append(depth[parent] + 1)
            turns.append(turns[parent] or joint.axis is not None)
        self._levels = [np.flatnonzero(np.array(depth) == d) for d in range(1, max(depth) + 1)]
        self._positions = np.array([(0.0, 0.0, 0.0), *(joint.origin.xyz for joint in joints)])
        self._rotations = quaternions_of_rpy(
            [(0.0, 0.0, 0.0), *(joint.origin.rpy for joint in joints)]
        )
        axes = np.array([(0.0, 0.0, 0.0), *(joint.axis or (0.0, 0.0, 0.0) for joint in joints)])
        # the rotation at angle a is cos(a/2) times that at 0 plus sin(a/2) times that at pi
        self._half_turn_rotations = chain(
            self._rotations, quaternions_about(axes, np.full(len(links), math.pi))
        )
        turning = [joint for joint in joints if joint.axis is not None]
        self._turning = [number[joint.child] for joint in turning]
        self._joints = tuple(joint.name for joint in turning)
        self._names: tuple[str, ...] = ()
        self._states: list[int] | None = None

        same_shape = defaultdict(list)
        for index, link in enumerate(links):
            if link in urdf.visuals:
                same_shape[urdf.visuals[link], turns[index]].append(index)
        self.shapes: list[Entity] = []
        """The static entities."""
        self._moving: list[tuple[str, Visual, list[int]]] = []
        positions, rotations = self._frames(np.zeros(len(links)))
        names = _names([[links[index] for index in which] for which in same_shape.values()])
        for name, ((visual, moves), which) in zip(names, same_shape.items(), strict=True):
            path = f"{layout.ROBOT}/{name}"
            self.shapes.append((path, _shape(visual, meshes)))
            if moves:
                self._moving.append((path, visual, which))
            else:
                self.shapes.append((path, _placed(visual, positions[which], rotations[which])))

    def pose(self, states: JointState) -> Iterator[Entity]:
        """Return the moving shapes; nothing if a joint of this robot is not among the states."""
        if states.name != self._names:
            order = {name: place for place, name in enumerate(states.name)}
            self._names = states.name
            known = order.keys() >= set(self._joints)
            self._states = [order[name] for name in self._joints] if known else None
        if self._states is None or len(states.position) != len(states.name):
            return
        angles = np.zeros(len(self._positions))
        # wrapped, since single precision is too coarse after many turns
        angles[self._turning] = np.remainder(np.array(states.position)[self._states], math.tau)
        positions, rotations = self._frames(angles)
        for path, visual, which in self._moving:
            yield path, _placed(visual, positions[which], rotations[which])

    def _frames(self, angles: Floats) -> tuple[Floats, Floats]:
        """Return positions (N, 3) [m] and rotations (N, 4) of all links at angles (N,) [rad]."""
        half = angles[:, np.newaxis] / 2.0
        rotations = np.cos(half) * self._rotations + np.sin(half) * self._half_turn_rotations
        positions = self._positions.copy()
        for level in self._levels[1:]:
            parents = self._parents[level]
            positions[level] = positions[parents] + turn(rotations[parents], positions[level])
            rotations[level] = chain(rotations[parents], rotations[level])
        return positions, rotations


def _tree(urdf: Urdf) -> tuple[str, list[Joint]]:
    """Return the root link, and the joints with parents before children."""
    children = defaultdict(list)
    for joint in urdf.joints:
        children[joint.parent].append(joint)
    links = {joint.child for joint in urdf.joints}
    roots = set(children) - links or set(urdf.visuals) - links
    if len(roots) != 1 or len(links) < len(urdf.joints):
        raise RefusedError(f"the links are no tree with one root: {sorted(roots)}")
    root = roots.pop()
    joints = list(children.pop(root, ()))
    for joint in joints:
        joints += children.pop(joint.child, ())
    if children:
        raise RefusedError(f"the links are no tree with one root: {sorted(children)}")
    return root, joints


def _names(groups: Sequence[Sequence[str]]) -> Iterator[str]:
    """Return a unique name for each group of links: the words common to their names."""
    taken: Counter[str] = Counter()
    for links in groups:
        words = [set(link.split("_")) for link in links]
        common = [word for word in links[0].split("_") if all(word in other for other in words)]
        name = "_".join(common) or links[0]
        taken[name] += 1
        yield name if taken[name] == 1 else f"{name}_{taken[name]}"


def _placed(visual: Visual, positions: Floats, rotations: Floats) -> rr.AsComponents:
    """Return the poses of a visual on links at positions (N, 3) [m] and rotations (N, 4)."""
    if visual.origin != Origin():
        positions = positions + turn(rotations, np.broadcast_to(visual.origin.xyz, positions.shape))
        rotations = chain(rotations, quaternions_of_rpy(visual.origin.rpy))
    if visual.kind == "mesh":
        return rr.InstancePoses3D(translations=positions, quaternions=rotations)
    archetype = rr.Boxes3D if visual.kind == "box" else rr.Cylinders3D
    return archetype.from_fields(centers=positions, quaternions=rotations)


def _shape(visual: Visual, meshes: Mapping[str, bytes]) -> rr.AsComponents:
    if visual.kind == "mesh":
        if visual.mesh not in meshes:
            raise RefusedError(f"no file for the mesh {visual.mesh!r}")
        names = "vertex_positions", "triangle_indices", "vertex_normals"
        mesh: dict[str, Any] = dict(zip(names, read_stl(meshes[visual.mesh]), strict=True))
        return rr.Mesh3D(**mesh, albedo_factor=visual.rgba)
    colours = [visual.rgba]
    if visual.kind == "box":
        half = [[length / 2.0 for length in visual.size]]
        return rr.Boxes3D(half_sizes=half, colors=colours, fill_mode="solid")
    radius, length = visual.size
    return rr.Cylinders3D(radii=[radius], lengths=[length], colors=colours, fill_mode="solid")


def read_stl(data: bytes) -> tuple[Singles, npt.NDArray[np.uint32], Singles]:
    """Return vertices (V, 3) [m], triangles (T, 3), and a normal for each vertex (V, 3).

    Coinciding corners are merged, which reduces the mesh to a sixth. The normal of a vertex is
    the mean of its facets' normals, weighted by area, so that the shading is smooth.

    Raises:
        RefusedError: The data is not a binary STL file.
    """
    if len(data) < STL_HEADER_BYTES or (len(data) - STL_HEADER_BYTES) % STL_FACET.itemsize:
        raise RefusedError("not a binary STL file")
    corners = np.frombuffer(data, STL_FACET, offset=STL_HEADER_BYTES)["corners"]
    vertices: Singles
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: Singles = np.zeros_like(vertices)
    np.add.at(normals, triangles, facets[:, np.newaxis])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0.0, length, 1.0)
    return vertices, triangles.astype(np.uint32), normals
