"""Rerun's components from arrays, for data that is logged many times per second.

Rerun's archetypes accept any kind of sequence, and detecting the kind takes most of their time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

Array = npt.NDArray[np.floating[Any]]
Components = list[rr.DescribedComponentBatch]

_NUMBER = pa.field("item", pa.float32(), nullable=False)
_VECTORS = {width: pa.list_(_NUMBER, width) for width in (3, 4, 9)}
_STRIPS = pa.list_(pa.field("item", _VECTORS[3], nullable=False))

_TRANSLATION = rr.Transform3D.descriptor_translation()
_QUATERNION = rr.Transform3D.descriptor_quaternion()
_MATRIX = rr.Transform3D.descriptor_mat3x3()
_INSTANCES = {
    "mesh": (
        rr.InstancePoses3D.descriptor_translations(),
        rr.InstancePoses3D.descriptor_quaternions(),
    ),
    "box": (rr.Boxes3D.descriptor_centers(), rr.Boxes3D.descriptor_quaternions()),
    "cylinder": (rr.Cylinders3D.descriptor_centers(), rr.Cylinders3D.descriptor_quaternions()),
}
_POSITIONS = rr.Points3D.descriptor_positions()
_LINES = rr.LineStrips3D.descriptor_strips()
_SCALARS = rr.Scalars.descriptor_scalars()


class _Batch:
    """An array with the interface that Rerun expects."""

    def __init__(self, array: pa.Array) -> None:
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        return self._array


def transform(translation: Array, quaternion: Array) -> Components:
    """Return a frame in its parent frame: translation (3,) [m], rotation (4,) as x, y, z, w."""
    # always both: a component left out would be reset to zero
    return [_vectors(_TRANSLATION, translation, 3), _vectors(_QUATERNION, quaternion, 4)]


def stretched(translation: Array, matrix: Array) -> Components:
    """Return a frame at translation (3,) [m] whose axes are the columns of matrix (3, 3)."""
    return [_vectors(_TRANSLATION, translation, 3), _vectors(_MATRIX, matrix.T, 9)]


def instances(kind: str, translations: Array, quaternions: Array) -> Components:
    """Return the poses of N instances of a mesh, box or cylinder: (N, 3) [m] and (N, 4)."""
    positions, rotations = _INSTANCES[kind]
    return [_vectors(positions, translations, 3), _vectors(rotations, quaternions, 4)]


def points(positions: Array) -> Components:
    """Return points (N, 3) [m]."""
    return [_vectors(_POSITIONS, positions, 3)]


def line(positions: Array) -> Components:
    """Return a line through positions (N, 3) [m]."""
    return lines([positions])


def lines(strips: Sequence[Array]) -> Components:
    """Return several lines, each through positions (N, 3) [m]."""
    offsets = pa.array(np.cumsum([0, *map(len, strips)]), type=pa.int32())
    flat = np.concatenate(strips) if strips else np.empty((0, 3))
    array = pa.ListArray.from_arrays(offsets, _vector_array(flat, 3), type=_STRIPS)
    return [rr.DescribedComponentBatch(_Batch(array), _LINES)]


def scalars(values: Iterable[float]) -> Components:
    """Return a value for each line of a plot."""
    numbers = pa.array(np.fromiter(values, dtype=np.float64))
    return [rr.DescribedComponentBatch(_Batch(numbers), _SCALARS)]


def _vectors(what: rr.ComponentDescriptor, values: Array, width: int) -> rr.DescribedComponentBatch:
    return rr.DescribedComponentBatch(_Batch(_vector_array(values, width)), what)


def _vector_array(values: Array, width: int) -> pa.FixedSizeListArray:
    flat = pa.array(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, type=_VECTORS[width])
