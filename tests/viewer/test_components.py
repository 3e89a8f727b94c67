"""What is logged straight from arrays is to the bit what Rerun's own archetypes make of them."""

import numpy as np
import pytest
import rerun as rr
from mecazen_viewer import components

NUMBERS = np.random.default_rng(1)
PLACE, TURN, MATRIX = NUMBERS.random(3), NUMBERS.random(4), NUMBERS.random((3, 3))
PLACES, TURNS = NUMBERS.random((9, 3)), NUMBERS.random((9, 4))
FRAME = rr.Transform3D(translation=PLACE, quaternion=rr.Quaternion(xyzw=TURN))


@pytest.mark.parametrize(
    ("ours", "reruns"),
    [
        (components.transform(PLACE, TURN), FRAME),
        (components.stretched(PLACE, MATRIX), rr.Transform3D(translation=PLACE, mat3x3=MATRIX)),
        (
            components.instances("mesh", PLACES, TURNS),
            rr.InstancePoses3D(translations=PLACES, quaternions=TURNS),
        ),
        (
            components.instances("box", PLACES, TURNS),
            rr.Boxes3D.from_fields(centers=PLACES, quaternions=TURNS),
        ),
        (
            components.instances("cylinder", PLACES, TURNS),
            rr.Cylinders3D.from_fields(centers=PLACES, quaternions=TURNS),
        ),
        (components.points(PLACES), rr.Points3D(PLACES)),
        (components.points(PLACES[:0]), rr.Points3D(PLACES[:0])),
        (components.line(PLACES), rr.LineStrips3D([PLACES])),
        (components.scalars([1.5, float("nan")]), rr.Scalars([1.5, float("nan")])),
    ],
)
def test_components_are_those_of_the_archetype(ours, reruns):
    wanted = {b.component_descriptor(): b.as_arrow_array() for b in reruns.as_component_batches()}
    made = {batch.component_descriptor(): batch.as_arrow_array() for batch in ours}
    assert made.keys() == wanted.keys()
    for descriptor, array in made.items():
        assert array.type == wanted[descriptor].type
        # as text, in which NaN equals NaN
        assert repr(array.to_pylist()) == repr(wanted[descriptor].to_pylist())
