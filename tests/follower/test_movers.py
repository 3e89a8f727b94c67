"""Walking people, found by the places of their legs scan by scan."""

import numpy as np
import pytest
from mecazen_follower.planner.movers import Movers


def test_who_walks_is_told_from_what_stands():
    movers = Movers()
    for k in range(15):
        movers.update(0.1 * k, [(0.08 * k, 2.0), (1.0, -1.0)])
    (walker,) = (track for track in movers.tracks if track.walks)
    # after 1.4 s the filter of β = 0.15 is within a tenth of 0.8 m/s
    assert walker[2:4] == pytest.approx((0.8, 0.0), abs=0.08)
    ahead = movers.ahead(np.array([1.4, 2.4]))
    assert ahead.shape == (2, 1, 2)
    assert ahead[1, 0, 0] - ahead[0, 0, 0] == pytest.approx(walker.vx)
    movers.update(3.0, [])
    assert movers.tracks == []
