"""What is logged many times a second, as Rerun's components straight from arrays.

Rerun's own archetypes take any kind of sequence, and spend more time on finding out which one
it is than all the rest takes.
"""

from __future__ import annotations

from collections.abc import Iterable
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
    """An array as Rerun asks for it."""

    def __init__(self, array: pa.Array) -> None:
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        return self._array


def transform(translation: Array, quaternion: Array) -> Components:
    """Return a frame in its parent's: translation (3,) [m], rotation (4,) as x, y, z, w."""
    # both at once, always: what is left out would fall back to no translation, or no rotation
    return [_vectors(_TRANSLATION, translation, 3), _vectors(_QUATERNION, quaternion, 4)]


def stretched(translation: Array, matrix: Array) -> Components:
    """Return a frame at translation (3,) [m] whose axes are the columns of matrix (3, 3)."""
    return [_vectors(_TRANSLATION, translation, 3), _vectors(_MATRIX, matrix.T, 9)]


def instances(kind: str, translations: Array, quaternions: Array) -> Components:
    """Return the places (N, 3) [m] and rotations (N, 4) of N alike of a mesh, box or cylinder."""
    places, turns = _INSTANCES[kind]
    return [_vectors(places, translations, 3), _vectors(turns, quaternions, 4)]


def points(positions: Array) -> Components:
    """Return points (N, 3) [m]."""
    return [_vectors(_POSITIONS, positions, 3)]


def line(places: Array) -> Components:
    """Return a line through places (N, 3) [m]."""
    whole = pa.array([0, len(places)], type=pa.int32())
    strips = pa.ListArray.from_arrays(whole, _vector_array(places, 3), type=_STRIPS)
    return [rr.DescribedComponentBatch(_Batch(strips), _LINES)]


def scalars(values: Iterable[float]) -> Components:
    """Return a value for each line of a plot."""
    numbers = pa.array(np.fromiter(values, dtype=np.float64))
    return [rr.DescribedComponentBatch(_Batch(numbers), _SCALARS)]


def _vectors(
    descriptor: rr.ComponentDescriptor, values: Array, width: int
) -> rr.DescribedComponentBatch:
    return rr.DescribedComponentBatch(_Batch(_vector_array(values, width)), descriptor)


def _vector_array(values: Array, width: int) -> pa.FixedSizeListArray:
    flat = pa.array(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, type=_VECTORS[width])
