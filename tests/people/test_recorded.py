"""Recorded tracks: read strictly, smooth, and with a heading that does not spin."""

import io
import math
import re
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from harness import error_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen.config.people import Gait, Recorded
from mecazen.errors import ConfigError
from mecazen.geometry import wrap
from mecazen_people.dataset import read_track
from mecazen_people.paths import make_path
from mecazen_people.recorded import MAX_YAW_RATE, STANDING_M_S, RecordedWalk
from people.walks import differences

SMOOTHING_S = 0.8
REPOSITORY = Path(__file__).parents[2]
WALKS = REPOSITORY / "configs" / "walks"
PEDESTRIANS = REPOSITORY.parent / "shared" / "data" / "pedestrians"
FILES = [WALKS / "synthetic.csv", *sorted(PEDESTRIANS.glob("*.csv"))[:2]]
"""The track of the project, and two of recorded pedestrians where they are present."""

# Between two knots of the heading a monotone cubic is at most 1.5 times as steep as its secant.
YAW_RATE_LIMIT = 1.5 * MAX_YAW_RATE


def line(t: float) -> tuple[float, float, float]:
    return t, 2.0 + 0.6 * t, 1.0 + 0.8 * t


def recorded(samples: list[tuple[float, float, float]]) -> RecordedWalk:
    return RecordedWalk(np.array(samples), SMOOTHING_S)


def every(track: RecordedWalk, dt: float = 0.01) -> list[float]:
    return [k * dt for k in range(1, int(track.duration / dt))]


def test_steady_walk_is_a_steady_walk():
    track = recorded([line(0.4 * k) for k in range(20)])
    for t in (0.0, 0.1, 3.3, 7.6):
        pose, twist, distance = track.at(t)
        # Differences of integrals over up to 20 s: some rounding of 100.
        assert pose == pytest.approx((*line(t)[1:], math.atan2(0.8, 0.6)), abs=1e-9)
        assert twist == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
        assert distance == pytest.approx(t, abs=1e-9)


def test_jitter_does_not_turn_a_standing_person():
    jitter = [(0.02, 0.0), (-0.02, 0.01), (0.0, -0.02), (0.01, 0.02), (-0.01, 0.0)]
    standing = [(4.0 + 0.4 * k, 4.0 + jitter[k % 5][0], jitter[k % 5][1]) for k in range(50)]
    track = recorded([*((0.4 * k, 0.4 * k, 0.0) for k in range(10)), *standing])
    headings = {track.at(5.0 + 0.1 * k).pose.yaw for k in range(180)}
    assert len(headings) == 1


@settings(max_examples=50, deadline=None)  # building a track takes milliseconds
@given(
    st.lists(
        st.tuples(st.floats(0.05, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
        min_size=1,
        max_size=15,
    )
)
def test_heading_of_any_track_is_continuous(steps):
    samples = [(0.0, 0.0, 0.0)]
    for dt, dx, dy in steps:
        t, x, y = samples[-1]
        samples.append((t + dt, x + dx, y + dy))
    track = recorded(samples)
    for t0, t1 in pairwise(every(track, 0.02)):
        before, after = track.at(t0), track.at(t1)
        turned = abs(wrap(after.pose.yaw - before.pose.yaw))
        assert turned <= YAW_RATE_LIMIT * 0.02 + 1e-9
        assert abs(after.twist.yaw) <= YAW_RATE_LIMIT + 1e-9
        assert after.distance >= before.distance - 1e-3  # cubics across a jump of speed


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_recorded_person_moves_as_people_do(file):
    samples = read_track(file)
    track = RecordedWalk(samples, SMOOTHING_S)
    first = samples[0, 0]
    off = [math.dist(track.at(t - first).pose[:2], (x, y)) for t, x, y in samples.tolist()]
    # The samples of tracked people are good to about a decimetre, and jump by five.
    assert max(off) < 0.25
    assert math.sqrt(sum(d * d for d in off) / len(off)) < 0.06
    assert max(off[0], off[-1]) < 1e-9
    sideways = 0.0
    for t in every(track):
        motion = track.at(t)
        speed = math.hypot(*motion.twist[:2])
        assert speed < 2.5  # the fastest first step in the recordings; the rest is below 2.2
        assert abs(motion.twist.yaw) <= YAW_RATE_LIMIT
        if speed < STANDING_M_S / 2:  # well away from where walking begins within a knot
            assert motion.twist.yaw == 0.0
        sideways += abs(motion.twist.y) * 0.01
    # While they turn to set off, and where they shuffle: below 0.2 m/s the heading is held.
    assert sideways < 0.1 * track.at(track.duration).distance
    path, dt = make_path(Recorded(file=file, x_m=1.0, yaw_deg=40.0, start_after_s=2.0)), 1e-5
    for k in range(300):
        t = 2.0 + (k + 0.5) / 300 * (path.duration - 2.0)
        now, measured, _ = differences(path, Gait(), t, dt)
        # Acceleration jumps at samples, yaw acceleration (up to 1000 rad/s²) at knots: at
        # worst one of them lies within dt.
        assert now.twist == pytest.approx(measured, abs=1e-2)


def test_synthetic_walk_is_what_its_readme_makes():
    program = re.search(r"```python\n(.*?)```", (WALKS / "README.md").read_text(), re.DOTALL)
    with redirect_stdout(io.StringIO()) as printed:
        exec(program[1], {})  # noqa: S102 - our own
    assert printed.getvalue() == (WALKS / "synthetic.csv").read_text()


def test_a_track_of_hours_or_of_two_people_is_refused(tmp_path):
    file = tmp_path / "walk.csv"
    for text, reason in (
        ("t_s,x_m,y_m\n0,0,0\n75600,1,0\n", "the times must span at most 14400 s, span 75600 s"),
        ("id,t_s,x,y\na,0,0,0\na,1,1,0\nb,0,0,0\nb,1,1,0\n", "has 2 people: `mecazen people"),
    ):
        file.write_text(text)
        assert reason in error_of(ConfigError, lambda: read_track(file))
