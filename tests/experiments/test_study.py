"""The form of a study: what it expands to, and one line for each mistake in it."""

from pathlib import Path

import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen_experiments import frame, tables
from mecazen_experiments.expansion import expand
from mecazen_experiments.study import load_study

STUDY = """
seeds = 2
set = ["sim.duration_s=2.0", "start={ x_m = $x_m, y_m = $y_m, yaw_deg = $yaw_deg }"]

[[cases]]
name = "slow"
scenario = "back"
labels = { pace = "walk" }
values = { speed = "0.4" }
set = ["target.path.speed_m_s=$speed"]
limits = { d_err_m = 0.5 }

[[cases]]
name = "drawn"
scenario = "back"
vary = { speed = [0.5, 0.9] }
set = ["target.path.speed_m_s=$speed"]
only = { view = ["left"] }

[grid.view]
back = ["follower.view=back"]
left = ["follower.view=side_left"]

[sweep]
"follower.standoff_m" = [1.0, 1.5]

[[table]]
title = "Errors"
rows = ["case", "view"]
reference = { view = "back" }
columns = [["D_err [m]", "d_err_m", 3], ["less", "d_err_m", 3, "ratio"]]

[[figure]]
name = "errors"
x = "follower.standoff_m"
y = ["d_err_m"]
"""


def load(tmp_path: Path, text: str = STUDY):
    file = tmp_path / "study.toml"
    file.write_text(text)
    return load_study(str(file))


def test_each_case_runs_with_each_choice_value_and_seed(tmp_path):
    jobs = expand(load(tmp_path))
    assert [str(job) for job in jobs][:5] == [
        "slow, back, follower.standoff_m=1.0, seed 1",
        "slow, back, follower.standoff_m=1.0, seed 2",
        "slow, back, follower.standoff_m=1.5, seed 1",
        "slow, back, follower.standoff_m=1.5, seed 2",
        "slow, left, follower.standoff_m=1.0, seed 1",
    ]
    assert [job.labels["view"] for job in jobs[8:]] == ["left"] * 4  # `only`
    assert len({job.key for job in jobs}) == len(jobs) == 12
    assert jobs[0].labels["pace"] == "walk"
    assert jobs[8].labels["pace"] == ""
    first, side = jobs[0].load(), jobs[6].load()
    assert (first.sim.duration_s, first.target.path.speed_m_s, first.seed) == (2.0, 0.4, 1)
    # beside a person at the origin, whom the robot faces from their left
    place = side.start.x_m, side.start.y_m, side.start.yaw_deg
    assert place == pytest.approx((0.0, 1.5, -90.0), abs=1e-12)
    speeds = [job.load().target.path.speed_m_s for job in jobs[8:]]
    assert speeds[:2] == speeds[2:]  # the seed draws the same for each row
    assert 0.5 <= min(speeds) < max(speeds) <= 0.9


def test_a_study_has_the_keys_of_the_study_that_it_extends(tmp_path):
    load(tmp_path)
    file = tmp_path / "mine.toml"
    file.write_text('extends = "study.toml"\nseeds = 1\n[grid.view]\nleft = []')
    study = load_study(str(file))
    assert [case.name for case in study.cases] == ["slow", "drawn"]
    assert study.seeds == 1
    assert list(study.grid["view"]) == ["left"]


WRONG = [
    ('scenario = "back"', 'scenario = "bcak"', "bcak: no such scenario; did you mean back?"),
    ("seeds = 2", "seeds = 0", "seeds: got 0; allowed: a whole number >= 1"),
    ('["sim.duration_s=2.0", ', '["short", ', "--set short: must be key.path=value"),
    ('["left"] }', '["lfet"] }', "case 'drawn': only.view: no choice 'lfet'; did you mean left?"),
    ("only = { view", "only = { veiw", "only: no axis 'veiw'; did you mean view?"),
    ('name = "drawn"', 'name = "slow"', "cases: two are named 'slow'"),
    ("[grid.view]", "[grid.seed]", "an axis can't be named 'seed'"),
    ("[1.0, 1.5]", "[[1.0], 1.5]", "sweep: got {'follower.standoff_m': [[1.0], 1.5]}; allowed:"),
    ('3, "ratio"]', '3, "raito"]', "table.0.columns.1.how: got 'raito'; allowed: 'diff"),
    ("reference = { view", "reference = { gait", "reference: gait is not one of rows"),
    ('reference = { view = "back" }', "", "table 'Errors': 'ratio' needs a reference"),
    ("seeds = 2", 'seeds = 2\nprogram = "folowing"', "program: no 'folowing'; did you mean follow"),
    ("m_s=$speed", "m_s=$sped", "case 'slow': set: no value 'sped'; known: speed, bearing_deg"),
]


@pytest.mark.parametrize(("old", "new", "line"), WRONG)
def test_a_mistake_is_one_line(tmp_path, old, new, line):
    assert line in error_of(ConfigError, lambda: expand(load(tmp_path, STUDY.replace(old, new))))


AFTER_A_RUN = [
    ('"d_err_m", 3]', '"d_er_m", 3]', "table 'Errors': columns: no column 'd_er_m'; did you mean"),
    ("d_err_m = 0.5", "d_errr_m = 0.5", "case 'slow': limits: no score 'd_errr_m'; did you mean"),
    ('y = ["d_err_m"]', 'y = ["d_err"]', "figure 'errors': y: no column 'd_err'; did you mean"),
    ("[[table]]", "[[table]]\nwhere = 'vie == 1'", "where = 'vie == 1': no column 'vie'; did you"),
    (
        "[[table]]",
        "[derive]\nd = 'd_eer_m'\n[[table]]",
        "derive.d = 'd_eer_m': no column 'd_eer_m'",
    ),
    ('"d_err_m", 3]', '"word", 3]', "columns: word is text: only how = 'value' shows it"),
    ('"d_err_m", 3]', '"{a}_m", 3]', "columns: '{a}_m': {NAME} must be one of each = []"),
]


@pytest.mark.parametrize(("old", "new", "line"), AFTER_A_RUN)
def test_a_wrong_name_is_told_after_the_first_run(tmp_path, old, new, line):
    study = load(tmp_path, STUDY.replace(old, new))
    (job, *_) = expand(study)
    text = frame.to_csv([job], {job.key: {"d_err_m": 0.1, "word": "a"}})
    assert line in error_of(ConfigError, lambda: tables.check(study, frame.read(study, text)))
