"""Binary STL files as indexed meshes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]

HEADER_BYTES = 84
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> tuple[Array, npt.NDArray[np.uint32], Array]:
    """Return vertices (V, 3) [m], triangles (T, 3), and a normal for each vertex (V, 3).

    Coinciding corners are merged, which reduces the mesh to a sixth. The normal of a vertex is
    the mean of its facets' normals, weighted by area, so that the shading is smooth.

    Raises:
        ValueError: It is not a binary STL file.
    """
    if len(data) < HEADER_BYTES or (len(data) - HEADER_BYTES) % FACET.itemsize:
        raise ValueError("not a binary STL file")
    corners = np.frombuffer(data, FACET, offset=HEADER_BYTES)["corners"]
    vertices: Array
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: Array = np.zeros_like(vertices)
    np.add.at(normals, triangles, facets[:, np.newaxis])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0.0, length, 1.0)
    return vertices, triangles.astype(np.uint32), normals
