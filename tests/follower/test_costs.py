"""The cost of a path, by hand."""

import math

import numpy as np
import pytest
from follower.rooms import BODY, CAMERA, scene, still
from mecazen.config.follower import PRIORITIES
from mecazen_follower.planner.costs import DISTANCE_M, JERKY, NEAR, Costs, Sight
from mecazen_follower.planner.field import CELL_M


def test_a_way_costs_what_it_gives_up_by_the_priorities():
    costs = Costs(PRIORITIES, 1.2, 0.12, BODY, CAMERA)
    assert costs.weights == pytest.approx(
        {"distance": 27.0, "visibility": 9.0, "bearing": 3.0, "heading": 1.0}
    )
    assert costs.of(still(-1.2, 0.0), scene()) == pytest.approx(0.0, abs=1e-9)
    # 0.25 m too far: (0.25/0.5)² of 27
    assert costs.of(still(-1.45, 0.0), scene()) == pytest.approx(27.0 * (0.25 / DISTANCE_M) ** 2)
    # beyond 0.5 m in proportion: 2·(1.5/0.5) - 1
    assert costs.of(still(-2.7, 0.0), scene()) == pytest.approx(27.0 * 5.0)
    # at the side, facing them: 2(1 - cos 90°) of bearing and of heading
    assert costs.of(still(0.0, 1.2, -math.pi / 2), scene()) == pytest.approx(2.0 * (3.0 + 1.0))
    # turned away by 60°, out of view, heading 2(1 - cos 60°)
    assert costs.of(still(-1.2, 0.0, math.pi / 3), scene()) == pytest.approx(9.0 + 1.0)
    # hidden by a pillar half way; it is 0.6 m away, nothing near
    pillar = np.array([[-0.6, 0.0]])
    assert costs.of(still(-1.2, 0.0), scene(pillar)) == pytest.approx(9.0)
    commands = np.zeros((3, 3, 1))
    commands[1:, 0] = 2.0
    jumping = still(-1.2, 0.0)._replace(commands=commands)
    assert costs.of(jumping, scene()) == pytest.approx(JERKY * 2.0**2)


def test_half_the_clearance_costs_a_quarter_of_contact_and_touching_more_than_all_else():
    costs = Costs(PRIORITIES, 1.2, 0.12, BODY, Sight())
    beside = BODY.width / 2 + BODY.disc  # as far as a quarter's disc reaches
    at = {gap: scene(np.array([[-1.2 - BODY.length / 2, beside + gap]])) for gap in (-0.06, 0.06)}
    near = costs.of(still(-1.2, 0.0), at[0.06])[0]
    # the field is exact to half a cell's diagonal
    off = CELL_M / math.sqrt(2.0)
    low, high = (NEAR * (1.0 - (0.06 + e) / 0.12) ** 2 for e in (off, -off))
    assert low <= near <= high
    assert costs.of(still(-1.2, 0.0), at[-0.06])[0] > 1e4
