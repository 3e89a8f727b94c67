"""A person's body walks: feet stay where they stand, angles are those of the curves."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from mecazen.config.people import (
    Body,
    Limp,
    Shuffle,
    StiffKnee,
    Straight,
    UTrack,
)
from mecazen.geometry import Pose2D, Twist2D
from mecazen.skeleton import INDEX, LIMBS, SIDES
from mecazen_people.body.gait import normal_gait
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.motion import PersonMotion
from people.walks import SETTLED_S, angles, drive, joint, slip, walk

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
    return WalkingPerson(Body())


@pytest.mark.parametrize(
    ("path", "seconds"),
    [
        (Straight(speed_m_s=0.2, length_m=100.0), 15.0),
        (Straight(speed_m_s=1.6, length_m=100.0), 15.0),
        (UTrack(length_m=1.0), 42.0),
    ],
)
def test_standing_feet_do_not_skate(walker, path, seconds):
    # 5 mm from heel strike to toe-off is what is asked for; by construction it is rounding, plus
    # what a point slides while the foot tilts by less than 5 mm at its other end: 0.1 mm
    assert slip(walk(walker, path, seconds)) < 0.0005


def test_standing_foot_touches_the_ground(walker):
    postures = drive(
        walker, (3, 1.2, 0.0, 0.3), (2, -0.4, 0.2, 0.0), (2, 0.0, 0.0, 1.0), (2, 0, 0, 0)
    )
    for posture in postures:
        assert posture.joints[:, 2].min() > -1e-9
        for side, name in enumerate(SIDES):
            if posture.standing[side]:
                ends = (posture.joints[INDEX[f"{name}_{end}"], 2] for end in ("heel", "foot"))
                assert min(ends) == pytest.approx(0.0, abs=1e-9)


def test_joints_never_jump_and_limbs_keep_their_lengths(walker):
    rng, dt = random.Random(0), 0.001
    legs = [
        (rng.uniform(0.1, 2.0), rng.uniform(-0.5, 1.4), rng.uniform(-0.4, 0.4), rng.uniform(-1, 1))
        for _ in range(8)
    ]
    postures = drive(walker, *legs, (3, 0, 0, 0), dt=dt)
    steps = np.diff([p.joints for p in postures], axis=0)
    # Twists jump here as no person's do. A swinging foot is 3.5 times as fast as the body, more
    # where it makes up for a jump; at 1 kHz a jump of 15 mm would be seen.
    assert np.linalg.norm(steps, axis=2).max() / dt < 15.0
    for limb in LIMBS:
        ends = joint(postures, limb.begin) - joint(postures, limb.end)
        # shoulders turn about the neck, and are no limb's end there
        assert np.ptp(np.linalg.norm(ends, axis=1)) < 1e-9, limb.name


def test_segments_are_shares_of_the_height():
    posture = WalkingPerson(Body(height_m=2.0)).reset(PersonMotion(Pose2D()))
    at = {name: posture.joints[i] for name, i in INDEX.items()}
    # Winter, after Drillis and Contini
    assert math.dist(at["left_hip"], at["left_knee"]) == pytest.approx(0.490)
    assert math.dist(at["right_knee"], at["right_ankle"]) == pytest.approx(0.492)
    assert math.dist(at["left_shoulder"], at["right_shoulder"]) == pytest.approx(0.518)
    assert at["left_ankle"][2] == pytest.approx(0.078)
    # the head's middle; knees of who stands are bent by 8 deg, which takes 2 mm
    assert at["head"][2] == pytest.approx(0.935 * 2.0, abs=0.004)


@pytest.mark.parametrize("speed", [0.4, 1.6])
def test_stride_length_times_cadence_is_the_speed(walker, speed):
    falls = footfalls(walk(walker, Straight(speed_m_s=speed, length_m=100.0), 14.0))
    times, _, places = zip(*(fall for fall in falls if fall[1] == 0), strict=True)
    strides = len(times) - 1
    length, period = (places[-1] - places[0]) / strides, (times[-1] - times[0]) / strides
    # strikes are seen to 10 ms of 4 strides and more
    assert length / period == pytest.approx(speed, rel=0.005)
    # twice the step length of the walk ratio (Sekiya & Nagasaki 1998); linear between solved speeds
    assert length == pytest.approx(2 * math.sqrt(0.0064 * 60 * speed), rel=0.005)


def test_pelvis_oscillates_about_the_path(walker):
    path = Straight(speed_m_s=1.3, length_m=100.0)
    postures = walk(walker, path, 6.0 + 4 * 1.0870)[600:]  # whole strides
    pelvis = joint(postures, "pelvis")
    ahead = pelvis[:, 0] - 1.3 * 0.01 * np.arange(600, 600 + len(pelvis))
    assert abs(ahead.mean()) < 0.002
    assert np.ptp(ahead) < 0.05  # 20 to 40 mm in adults
    assert np.ptp(pelvis[:, 1]) == pytest.approx(0.05, abs=0.002)  # the table's amplitude, twice
    assert 0.02 < np.ptp(pelvis[:, 2]) < 0.05  # the centre of mass of adults: about 40 mm


def test_person_who_stops_stands_on_both_feet(walker):
    for twist in ((1.3, 0, 0), (-0.4, 0, 0), (0, 0.4, 0), (0, 0, 1.5), (0.8, 0, 0.4)):
        *_, before, last = drive(walker, (3.3, *twist), (4, 0, 0, 0))
        assert last.standing == (True, True)
        assert np.abs(last.joints - before.joints).max() < 1e-7
        feet = (last.joints[INDEX["left_ankle"]] + last.joints[INDEX["right_ankle"]]) / 2
        assert math.dist(feet[:2], last.joints[INDEX["pelvis"]][:2]) < 0.03  # counts as home


def test_person_who_turns_on_the_spot_steps_around(walker):
    postures = drive(walker, (math.pi, 0, 0, 1.0), (3, 0, 0, 0))
    last = postures[-1]
    across = last.joints[INDEX["left_foot"]] - last.joints[INDEX["right_foot"]]
    assert across[1] < -0.09  # the left foot is now on the right side
    assert abs(across[0]) < 0.02
    assert slip(postures) < 0.0005


def test_varied_strides_have_their_deviation_without_skating():
    path = Straight(speed_m_s=1.2, length_m=1000.0)
    varied, plain = WalkingPerson(Body(stride_cv=0.02)), WalkingPerson(Body())
    postures = walk(varied, path, 120.0)
    phases = np.array([posture.phases[0] for posture in postures[600:]])
    (strikes,) = np.nonzero(np.diff(phases) < 0.0)
    times = 0.01 * np.diff(strikes)
    assert len(times) > 95
    # over 100 strides a standard deviation errs by 7 %; ticks of 10 ms add 0.3 % of a stride
    assert times.std() / times.mean() == pytest.approx(0.02, rel=0.25)
    assert slip(postures) < 0.0005
    regular = [posture.joints for posture in walk(plain, path, 12.0)]
    # varied strides leave the pelvis where the path takes it, within what a step adds
    assert abs(np.array(regular)[:, 0] - joint(postures[: len(regular)], "pelvis")).max() < 0.05


def test_varied_strides_repeat_with_their_seed():
    def bits(cv, seed):
        walker = WalkingPerson(Body(stride_cv=cv))
        walker.reset(PersonMotion(Pose2D()), seed)
        path = [PersonMotion(Pose2D(x=0.012 * k), Twist2D(x=1.2)) for k in range(1, 250)]
        return b"".join(walker.step(motion, 0.01).joints.tobytes() for motion in path)

    first = bits(0.02, 1)
    assert first == bits(0.02, 1) != bits(0.02, 2)


def test_angles_are_those_taken_from_the_joint_centres(walker):
    for posture in drive(walker, (2, 1.2, 0, 0.5), (1, -0.4, 0.3, 0), (1, 0, 0, 1.5))[::7]:
        # the arc cosine of a nearly straight knee loses half the digits
        assert np.array(posture.angles) == pytest.approx(angles(posture), abs=1e-7)


@pytest.mark.parametrize("speed", [0.5, 1.3])  # solved: 0.2, 0.4, ...
def test_angles_are_within_two_degrees_of_the_curves(walker, speed):
    postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 16.0)[600:]
    wanted = [
        [angle for side in (0, 1) for angle in walker.style.angles(side, speed, p.phases[side])]
        for p in postures
    ]
    errors = np.degrees(np.array([p.angles for p in postures]) - wanted)
    rms = np.sqrt((errors**2).mean(axis=0))
    # 2 deg are asked for; reached are up to 0.8 at the hip, 1.65 at the knee, 1.1 at the ankle
    assert (rms < np.tile([1.0, 1.8, 1.3], 2)).all(), rms


def test_curves_lie_within_the_spread_of_healthy_adults():
    for name, curve in zip(PUBLISHED, normal_gait().curves[0], strict=True):
        for percent, published in PUBLISHED[name]:
            # the spread is one standard deviation; 8 harmonics of the splines add half a degree
            angle = math.degrees(curve.at(percent / 100))
            assert angle == pytest.approx(published, abs=1.25 * SPREAD[name] + 0.5), percent


def footfalls(postures):
    """Return time, side and place of the heel strikes of a settled walk."""
    return [
        (0.01 * k, side, postures[k].joints[INDEX[f"{name}_heel"], 0])
        for k in range(round(SETTLED_S / 0.01), len(postures))
        for side, name in enumerate(SIDES)
        if postures[k].standing[side] and not postures[k - 1].standing[side]
    ]


def step_lengths(falls):
    """Return the mean step length of the left foot and of the right one."""
    steps = [(b[1], b[2] - a[2]) for a, b in pairwise(falls)]
    return [np.mean([length for side, length in steps if side == s]) for s in (0, 1)]


@pytest.mark.parametrize("side", ["left", "right"])
def test_limp_spares_a_leg_and_lengthens_its_step(side):
    walker = WalkingPerson(Body(limp=Limp(side=side, stance_asymmetry=0.08, step_asymmetry=0.2)))
    postures = walk(walker, Straight(speed_m_s=0.8, length_m=100.0), 30.0)
    affected = SIDES.index(side)
    lengths = step_lengths(footfalls(postures))
    difference = (lengths[affected] - lengths[1 - affected]) / np.mean(lengths)
    assert difference == pytest.approx(0.2, abs=0.02)
    period = 2 * math.sqrt(0.0064 * 60 / 0.8)
    whole = postures[600 : 600 + round(16 * period / 0.01)]
    shares = np.mean([p.standing for p in whole], axis=0)
    assert shares[1 - affected] - shares[affected] == pytest.approx(0.08, abs=0.01)
    assert slip(postures) < 0.0005


def test_stiff_knee_flexes_less():
    normal, stiff = (
        np.degrees(
            np.max([p.angles for p in walk(WalkingPerson(b), Straight(), 12.0)[600:]], axis=0)
        )
        for b in (Body(), Body(stiff_knee=StiffKnee(side="right", flexion=0.4)))
    )
    assert stiff[1] == pytest.approx(normal[1], abs=3.0)
    # a foot that clears the ground leaves it more flexed than 15 deg + 0.4 of the rest
    assert stiff[4] < normal[4] - 10.0


def test_shuffle_makes_short_steps_at_a_high_cadence():
    speed = 0.8
    normal, shuffled = (
        footfalls(walk(WalkingPerson(b), Straight(speed_m_s=speed, length_m=100.0), 20.0))
        for b in (Body(), Body(shuffle=Shuffle(step_length=0.5)))
    )
    assert np.mean(step_lengths(shuffled)) == pytest.approx(
        0.5 * np.mean(step_lengths(normal)), rel=0.02
    )
    assert len(shuffled) == pytest.approx(2 * len(normal), abs=2)
