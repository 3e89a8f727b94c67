"""Random walkers: repeatable, different, and within what a person can do."""

import math

import numpy as np
import pytest
from mecazen.config.people import Wander
from mecazen_people.paths import make_path
from mecazen_people.wander import LEAST_RADIUS_M, Kind, walker

WALKERS = range(20)
SECONDS = 40.0


def motions(number, start_after_s=0.0):
    path = make_path(Wander(number=number, duration_s=SECONDS, start_after_s=start_after_s))
    return [path.at(start_after_s + 0.1 * k) for k in range(round(SECONDS / 0.1))]


def test_a_number_is_a_walker():
    assert motions(3) == motions(3)
    # the start shifts the cells of 5 ms by its rounding
    assert motions(3, 1.0)[-1].pose == pytest.approx(motions(3)[-1].pose, abs=1e-3)
    ends = {motions(number)[-1].pose for number in WALKERS}
    assert len(ends) == len(WALKERS)


def test_walkers_do_all_that_people_do():
    kinds, speeds, turns = set(), [], []
    for number in WALKERS:
        character, plan = walker(number)
        for _, segment in zip(range(40), plan, strict=False):
            forward, left, turn = segment.targets
            kinds.add(segment.kind)
            assert math.hypot(forward, left) <= max(character.greatest, 0.6)
            if segment.kind in (Kind.BEND, Kind.WINDING_WAY):
                assert abs(forward / turn) >= LEAST_RADIUS_M - 1e-12
            turns.append(turn)
        speeds += [math.hypot(*motion.twist[:2]) for motion in motions(number)]
    assert kinds == set(Kind)
    assert {np.sign(turn) for turn in turns} == {-1.0, 0.0, 1.0}
    assert min(speeds) < 0.02
    assert 1.3 < max(speeds) < 2.0  # 1.6 and its ripple
