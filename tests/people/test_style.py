"""Pathological gait, other heights and other tables."""

import math
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mecazen.config.people import Body, Limp, Shuffle, StiffKnee, Straight
from mecazen.errors import ConfigError
from mecazen.skeleton import INDEX, SIDES
from mecazen_people.body.norm import TABLE, read_norm
from mecazen_people.body.walker import Walker
from people.walks import SETTLED_S, slip, walk


def footfalls(postures, dt=0.01):
    """Return time, side and place of the heel strikes of a settled walk."""
    return [
        (k * dt, side, postures[k].joints[INDEX[f"{name}_heel"], 0])
        for k in range(round(SETTLED_S / dt), len(postures))
        for side, name in enumerate(SIDES)
        if postures[k].standing[side] and not postures[k - 1].standing[side]
    ]


def step_lengths(falls):
    """Return the mean step length of the left foot and of the right one."""
    steps = [(b[1], b[2] - a[2]) for a, b in pairwise(falls)]
    return [np.mean([length for side, length in steps if side == s]) for s in (0, 1)]


@pytest.mark.parametrize("side", ["left", "right"])
def test_limp_spares_a_leg_and_lengthens_its_step(side):
    walker = Walker(Body(limp=Limp(side=side, stance_asymmetry=0.08, step_asymmetry=0.2)))
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
        np.degrees(np.max([p.angles for p in walk(Walker(b), Straight(), 12.0)[600:]], axis=0))
        for b in (Body(), Body(stiff_knee=StiffKnee(side="right", flexion=0.4)))
    )
    assert stiff[1] == pytest.approx(normal[1], abs=3.0)
    # a foot that clears the ground leaves it more flexed than 15 deg + 0.4 of the rest
    assert stiff[4] < normal[4] - 10.0


def test_shuffle_makes_short_steps_at_a_high_cadence():
    speed = 0.8
    normal, shuffled = (
        footfalls(walk(Walker(b), Straight(speed_m_s=speed, length_m=100.0), 20.0))
        for b in (Body(), Body(shuffle=Shuffle(step_length=0.5)))
    )
    assert np.mean(step_lengths(shuffled)) == pytest.approx(
        0.5 * np.mean(step_lengths(normal)), rel=0.02
    )
    assert len(shuffled) == pytest.approx(2 * len(normal), abs=2)


def test_small_person_makes_shorter_steps_of_the_same_shape():
    child = Walker(Body(height_m=1.2))
    # same Froude number: same angles, lengths as the heights
    slow = walk(child, Straight(speed_m_s=0.8, length_m=100.0), 14.0)
    adult = walk(
        Walker(Body()), Straight(speed_m_s=0.8 * math.sqrt(1.75 / 1.2), length_m=100.0), 14.0
    )
    ratio = np.mean(step_lengths(footfalls(slow))) / np.mean(step_lengths(footfalls(adult)))
    assert ratio == pytest.approx(1.2 / 1.75, rel=0.02)
    ranges = [np.ptp([p.angles for p in ps[600:]], axis=0) for ps in (slow, adult)]
    assert np.degrees(ranges[0]) == pytest.approx(np.degrees(ranges[1]), abs=3.0)
    assert slip(slow) < 0.0005


def test_table_of_a_file_replaces_the_norm(tmp_path: Path):
    file = tmp_path / "own.toml"
    text = TABLE.read_text().replace("walk_ratio_m_min = [0.0064,", "walk_ratio_m_min = [0.0049,")
    file.write_text(text)
    assert read_norm(file).factors.at(0.2).walk_ratio_m_min == 0.0049
    falls = footfalls(walk(Walker(Body(factors_file=file)), Straight(), 20.0))
    assert np.mean(step_lengths(falls)) == pytest.approx(math.sqrt(0.0049 * 60 * 0.2), rel=0.01)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("speed_m_s = 1.3", "speed_m_s = -1.3", r"own.toml: speed_m_s: got -1.3; allowed: "),
        ("stance_share = 0.62", "", r"own.toml: stance_share: missing"),
        (
            "[knee]\npercent = [0,",
            "[knee]\npercent = [7,",
            r"own.toml: knee: percent must increase",
        ),
        ("sway_m = [0.035,", "sway_m = [", r"own.toml: factors: sway_m must have a value for each"),
        ("[hip]", "[hop]", r"own.toml: hop: unknown key; did you mean hip\?"),
        ("[hip]", "[hip", r"own.toml: .*line"),
    ],
)
def test_bad_table_is_refused_in_one_line(tmp_path: Path, old, new, told):
    file = tmp_path / "own.toml"
    file.write_text(TABLE.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError, match=told) as error:
        read_norm(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "table", [{"height_m": 3.0}, {"rate_hz": 5.0}, {"limp": {"side": "both"}}, {"shufle": {}}]
)
def test_body_outside_of_its_ranges_is_refused(table):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(table, Body)
