"""The angles of a walking body are those of the curves that it walks after."""

import math
from pathlib import Path

import numpy as np
import pytest
from mecazen.config.people import Body, Straight
from mecazen_people.body.norm import TABLE, read_norm
from mecazen_people.body.recording import read_recording
from mecazen_people.body.segments import Segments
from mecazen_people.body.walker import Walker
from people.walks import angles, curve_errors, drive, walk

MOCAP = Path(__file__).parents[2].parent / "shared" / "data" / "mocap"

# Means of adults at a natural speed: percent of the cycle, degrees, and standard deviation
# (Perry & Burnfield 2010, Winter 2009, Kadaba et al. 1990). At 55 % the knee's is left out: with
# 35 deg it is 4 % of the cycle ahead of 10 deg at 50 % and 40 deg at 62 %, where pre-swing ends.
PUBLISHED = {
    "hip": ((0, 30), (10, 25), (30, 10), (50, -10), (62, -5), (75, 25), (85, 32)),
    "knee": ((0, 5), (12, 18), (25, 5), (40, 3), (70, 62), (85, 25), (95, 8)),
    "ankle": ((0, 0), (8, -5), (25, 5), (40, 10), (62, -15), (70, -5), (85, 0)),
}
SPREAD = {"hip": 6.0, "knee": 7.0, "ankle": 5.0}


@pytest.fixture(scope="module")
def walker():
    return Walker(Body())


def test_angles_are_those_taken_from_the_joint_centres(walker):
    for posture in drive(walker, (2, 1.2, 0, 0.5), (1, -0.4, 0.3, 0), (1, 0, 0, 1.5))[::7]:
        # the arc cosine of a nearly straight knee loses half the digits
        assert np.array(posture.angles) == pytest.approx(angles(posture), abs=1e-7)


@pytest.mark.parametrize("speed", [0.4, 0.6, 0.8, 1.0, 1.3, 1.6])
def test_angles_are_within_two_degrees_of_the_curves(walker, speed):
    postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 16.0)[600:]
    rms = np.sqrt((curve_errors(walker, postures, speed) ** 2).mean(axis=0))
    # 2 deg are asked for; reached are up to 0.8 at the hip, 1.65 at the knee, 1.1 at the ankle
    assert (rms < np.tile([1.0, 1.8, 1.3], 2)).all(), rms


@pytest.mark.parametrize("joint", PUBLISHED)
def test_curves_lie_within_the_spread_of_healthy_adults(joint):
    curve = getattr(read_norm(TABLE), joint).curve()
    for percent, published in PUBLISHED[joint]:
        # the spread is one standard deviation; 8 harmonics of the splines add half a degree
        found = math.degrees(curve.at(percent / 100))
        assert found == pytest.approx(published, abs=1.25 * SPREAD[joint] + 0.5), percent


def test_ranges_grow_with_speed(walker):
    ranges = []
    for speed in (0.4, 0.8, 1.3, 1.6):
        postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 12.0)[600:]
        ranges.append(np.ptp([p.angles for p in postures], axis=0)[:3])
    assert (np.diff(ranges, axis=0) > 0.0).all()


@pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no recordings in {MOCAP}")
def test_curves_are_like_a_recorded_adults():
    recorded = read_recording(MOCAP / "opensim" / "subject01_walk1_ik.mot", Segments.of(1.75))
    norm = read_norm(TABLE)
    for own, published, most in zip(
        recorded.curves[0], (norm.hip, norm.knee, norm.ankle), (6.0, 13.0, 10.0), strict=True
    ):
        curve = published.curve()
        differences = [own.at(k / 100) - curve.at(k / 100) for k in range(100)]
        # one person against a mean, at 1.0 instead of 1.3 m/s: about two standard deviations
        assert np.degrees(np.sqrt(np.mean(np.square(differences)))) < most
    assert all(0.6 < share < 0.7 for share in recorded.stance_shares)


def test_two_speeds_between_solved_ones_have_no_worse_feet_or_angles(walker):
    # solved are 0.2, 0.4, ... m/s: in the middle between two, interpolation is worst
    for speed in (0.5, 1.1):
        postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 14.0)[600:]
        rms = np.sqrt((curve_errors(walker, postures, speed) ** 2).mean(axis=0))
        assert rms.max() < 2.0
