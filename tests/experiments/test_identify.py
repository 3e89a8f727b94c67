"""A robot's kinematics come out of recordings, and an invalid file is one line."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from harness import ROOT
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario, load_table
from mecazen.robot import WHEELS, Robot
from mecazen_experiments.identify import readers
from mecazen_experiments.identify.commands import identify as identify_command
from mecazen_experiments.identify.commands import read
from mecazen_experiments.identify.drift import drifts, integrated, odometry, shifted
from mecazen_experiments.identify.fit import estimates, fit
from mecazen_experiments.identify.identification import (
    _units,
    best_geometry,
    folds,
    group,
    identify,
)
from mecazen_experiments.identify.models import (
    TURNS,
    Nominal,
    families,
    full,
    lateral,
    per_wheel,
)
from mecazen_experiments.identify.runs import Run, checked, run_lines
from mecazen_experiments.identify.simulated import identified_robot, simulated
from mecazen_experiments.identify.wheels import check_wheels, gains
from mecazen_experiments.identify.windows import Moments, cut, total

SAMPLE = ROOT / "examples" / "optiodom"
"""16 runs of the OptiOdom data."""
OMNI4 = load_table(ROOT / "configs" / "robots" / "omni4.toml", Robot)
NOMINAL = Nominal.of(OMNI4)
RADIUS, LEVER, GAIN = 0.031, 0.22, 0.96
MOUNTED = 0.01, 0.02, -0.03
"""Misalignment [rad] and offset [m] of the reference."""


def driven(seed=1, j=None, noise_m=0.0, seconds=60.0, session="made"):
    """Return a run of a robot that moves along all axes at random, with a reference on it."""
    random, step_s = np.random.default_rng(seed), 0.01
    count = round(seconds / step_s)
    knots = random.normal(0.0, (0.1, 0.1, 0.5), (round(seconds), 3))
    twists = np.stack(
        [np.interp(np.linspace(0, len(knots) - 1, count), range(len(knots)), k) for k in knots.T], 1
    )
    j = NOMINAL.matrix(RADIUS, LEVER, GAIN) if j is None else j
    steps = twists * step_s
    wheels = np.concatenate([np.zeros((1, 4)), np.cumsum(steps @ np.linalg.pinv(j).T, axis=0)])
    turn, x, y = MOUNTED
    c, s = math.cos(turn), math.sin(turn)
    in_reference = steps @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T
    poses = shifted(integrated(in_reference), np.array([x, y]))
    poses = poses + random.normal(0.0, noise_m, poses.shape)
    return checked(Run("made.csv", session, step_s * np.arange(count + 1), poses, wheels))


def moments(runs):
    return group(runs, [Moments.of(cut(run, 0.5)) for run in runs])


@pytest.fixture(scope="module")
def sample():
    return readers.optiodom(SAMPLE)


@pytest.fixture(scope="module")
def found(sample):
    return identify(OMNI4, sample)


def test_radius_lever_gain_and_mounting_come_out_of_data_without_noise():
    names = lateral(NOMINAL).names(("",))
    values = fit(lateral(NOMINAL), moments([driven()])).values
    assert dict(zip(names, values, strict=True)) == pytest.approx(
        {
            "radius_m": RADIUS,
            "lever_m": LEVER,
            "lateral_gain": GAIN,
            "misalignment_rad": MOUNTED[0],
            "offset_x_m": MOUNTED[1],
            "offset_y_m": MOUNTED[2],
        },
        rel=1e-4,  # the middle of a step stands for all of it
    )


def test_planted_values_are_within_their_intervals_in_18_of_20_seeds():
    planted = {"radius_m": RADIUS, "lever_m": LEVER, "lateral_gain": GAIN}
    inside, held, seeds = dict.fromkeys(planted, 0), dict.fromkeys(planted, 0), 20
    for seed in range(seeds):
        runs = [driven(100 * seed + run, noise_m=0.0003, seconds=40.0) for run in range(2)]
        found = fit(lateral(NOMINAL), moments(runs))
        values, ambiguities = estimates(found, _units(runs, moments(runs)[""], 0.0))
        assert ambiguities == ()
        for name, true in planted.items():
            one = values[name]
            assert one.value == pytest.approx(true, rel=0.003)
            inside[name] += abs(one.value - true) < one.curvature
            held[name] += one.low < true < one.high  # over eight blocks of 10 s
    assert min(inside.values()) >= 18
    assert min(held.values()) >= 18


def test_each_wheel_has_its_radius():
    radii = np.array([0.030, 0.031, 0.0305, 0.0295])
    j = NOMINAL.matrix(1.0, LEVER, GAIN) * radii
    values = fit(per_wheel(NOMINAL), moments([driven(j=j)])).values
    # wheels that never turn against each other leave the difference of two pairs open
    assert values[2:6].mean() == pytest.approx(radii.mean(), rel=0.002)


def test_the_full_matrix_explains_all_that_the_others_do():
    data = moments([driven(noise_m=0.0003)])
    errors = []
    for model in families(NOMINAL):
        found = fit(model, data)
        errors.append(sum(total(data[""]).errors(found.coefficients(""))))
    assert all(more >= 0.999 * less for more, less in pairwise(errors))
    assert len(full(NOMINAL).parameters) == 11


def test_parameters_that_no_motion_depends_on_are_named():
    straight = driven(noise_m=0.0003)
    straight = replace(
        straight,
        poses=straight.poses * [1.0, 0.0, 1e-9],
        wheels=np.outer(straight.poses[:, 0], np.ones(4)) / RADIUS,
    )
    data = moments([straight])
    _, ambiguities = estimates(fit(lateral(NOMINAL), data), [("", *data[""])])
    assert any(line.startswith("lever_m is not determined") for line in ambiguities)


def test_drift_is_that_of_odometry_that_starts_at_the_reference():
    run = driven()
    right = fit(lateral(NOMINAL), moments([run])).coefficients("")
    assert np.max(drifts(run, odometry(run, right), 10.0)) < 1e-4
    longer = right.copy()
    longer[:12] *= 1.01
    error = drifts(run, odometry(run, longer), 1.0)[:, 0]
    way = np.hypot(*np.diff(run.poses[::100, :2], axis=0).T)
    assert np.median(error / way[: len(error)]) == pytest.approx(0.01, rel=0.5)


def test_a_clock_that_is_ahead_is_found():
    run = driven()
    late = replace(run, poses=np.concatenate([run.poses[:1].repeat(5, axis=0), run.poses[:-5]]))
    from mecazen_experiments.identify.identification import clock_offset

    assert clock_offset(NOMINAL, [late]).value == pytest.approx(0.05, abs=0.001)


def test_windows_with_a_gap_are_left_out_and_reported():
    run = driven(seconds=30.0)
    kept = np.r_[0:1000, 1300:3001]
    cut_out = checked(Run("gap.csv", "gap", run.times[kept], run.poses[kept], run.wheels[kept]))
    assert cut_out.gaps == (999,)
    assert 999 not in cut(cut_out, 0.5).starts_s
    assert len(cut(cut_out, 0.5).moved) == 53
    assert run_lines([cut_out]) == [
        "gap.csv: 1 gaps of up to 3.01 s; windows with a gap are left out"
    ]


def csv_of(run, folder, times, name="drive.csv"):
    file = folder / name
    table = np.column_stack([run.poses, run.wheels])
    rows = (f"{t},{','.join(map(repr, row))}" for t, row in zip(times, table.tolist(), strict=True))
    file.write_text("\n".join([",".join(readers.COLUMNS), *rows]))
    return file


EPOCH = 1_700_000_000
"""A time in 2023 [s]."""


@pytest.mark.parametrize("unit", ["s", "ms", "µs", "ns"])
@pytest.mark.parametrize("begin", [0, EPOCH])
def test_times_are_read_in_each_unit_also_since_1970(unit, begin, tmp_path):
    run = driven(seconds=5.0)
    scale = {"s": 1, "ms": 10**3, "µs": 10**6, "ns": 10**9}[unit]
    # whole ticks of 10 ms; exact in text
    ticks = [begin * scale + k * scale // 100 if scale > 1 else begin + k / 100 for k in range(501)]
    (read_again,), _ = read([csv_of(run, tmp_path, ticks)], "csv")
    # 1.7e18 ns has 256 ns of resolution, 1.7e9 s has 0.24 µs
    assert read_again.times == pytest.approx(run.times, abs=1e-6)
    lines = run_lines([read_again])
    assert lines == ([f"drive.csv: time is taken as {unit}, by its interval"] if scale > 1 else [])


def test_a_single_recording_in_ms_is_identified_without_nan(tmp_path, capsys):
    run = driven(noise_m=0.0003, seconds=30.0)
    file = csv_of(run, tmp_path, [EPOCH * 1000 + 10 * k for k in range(3001)])
    identify_command([file], None, "omni4", (), tmp_path / "out")
    report = (tmp_path / "out" / "report.md").read_text()
    assert "nan" not in capsys.readouterr().out + report.lower()
    low, high = identify(OMNI4, [run]).lateral_gain.low, identify(OMNI4, [run]).lateral_gain.high
    assert low < GAIN < high
    assert high - low > 0.0


@pytest.mark.parametrize("degrees", [-135, -90, -30, 40, 90, 180])
def test_a_reference_may_be_mounted_at_any_angle(degrees):
    run, turn = driven(noise_m=0.0003, seconds=30.0), math.radians(degrees)
    found = identify(OMNI4, [replace(run, poses=run.poses + np.array([0.0, 0.0, turn]))])
    values = found.model("lateral gain free").parameters
    for name, expected in {"radius_m": RADIUS, "lever_m": LEVER, "lateral_gain": GAIN}.items():
        assert values[name].value == pytest.approx(expected, rel=0.003)  # as without a turn
    lines = [line for line in found.notes if "turned" in line]
    assert len(lines) == (abs(degrees) > 45)
    if lines:
        # the noise moves it by less than 0.1°, and the reference is mounted at MOUNTED[0]
        shown = float(lines[0].partition("turned by ")[2].partition("°")[0])
        expected = degrees + math.degrees(MOUNTED[0])
        assert (shown - expected + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.1)


def test_swapped_wheels_are_named_also_below_a_turned_reference():
    run = driven(noise_m=0.0003)
    run = replace(swapped(run, 1, 0, 2, 3), poses=run.poses + np.array([0.0, 0.0, math.pi / 2]))
    with pytest.raises(ConfigError, match="front_left and front_right are swapped: "):
        identify(OMNI4, [run])


# ---- the recorded robot


def test_the_recorded_robot_has_the_lateral_gain_of_six_rollers(found):
    # the first fit: 0.954 ± 0.002 over sessions
    assert found.lateral_gain.mean == pytest.approx(0.954, abs=0.003)
    assert found.roller_count == 6
    assert best_geometry(found).parameters["radius_m"].value == pytest.approx(0.0306, abs=0.0003)


def test_models_with_a_lateral_gain_predict_other_runs_better(found):
    scores = {model.name: model.held_out for model in found.models}
    assert scores["nominal"] < scores["ideal, calibrated"] < scores["geometry, 6 rollers"]
    assert scores["geometry, 6 rollers"] == pytest.approx(scores["lateral gain free"], abs=0.02)


def test_one_radius_fits_circles_and_squares_once_missing_time_is_made_up_for(sample):
    """Without it, the radius differs by 4 %, as do the shares of time that the log lacks."""
    shares = {
        kind: np.mean([r.missing for r in sample if r.kind == kind])
        for kind in ("circular", "square")
    }
    assert shares == pytest.approx({"circular": 0.059, "square": 0.094}, abs=0.002)

    def radius(kind, *, logged):
        runs = [run.as_logged() if logged else run for run in sample if run.kind == kind]
        return gains(total(Moments.of(cut(run, 0.5)) for run in runs))[0][0]

    assert radius("square", logged=True) / radius("circular", logged=True) > 1.035
    assert radius("square", logged=False) == pytest.approx(
        radius("circular", logged=False), rel=0.008
    )


def test_an_identified_robot_turns_in_the_simulation_as_identified(found, sample, tmp_path):
    best = best_geometry(found)
    robot = identified_robot(OMNI4, best.parameters, found.roller_count, sample[0])
    assert robot.rollers.count == 6
    run = sample[4]  # not the one by which the lever is set
    lever, radius = (best.parameters[name].value for name in ("lever_m", "radius_m"))
    expected = (run.wheels[-1] - run.wheels[0]) @ TURNS * radius / 4.0 / lever
    # the yaw gain depends on the rollers' phases: 1.5 % at most
    assert simulated(robot, run)[-1, 2] == pytest.approx(expected, rel=0.005)
    from mecazen_experiments.identify.report import robot_file

    (tmp_path / "robot.toml").write_text(robot_file(robot, found))
    (tmp_path / "scenario.toml").write_text('robot = "robot.toml"\n')
    assert load_scenario(tmp_path / "scenario.toml").robot == robot


def test_the_command_writes_report_figures_and_robot(tmp_path, capsys):
    out = tmp_path / "report"
    folders = [SAMPLE / "circular_231220200502", SAMPLE / "square_080920201205"]
    identify_command(folders, "optiodom", "omni4", (), out)
    names = {"report.md", "identification.json", "robot.toml", "lateral_gain.png", "residuals.png"}
    assert {file.name for file in out.iterdir()} == names
    assert "most likely number of rollers: 6" in capsys.readouterr().out
    assert "| geometry, 6 rollers | 2 |" in (out / "report.md").read_text()
    assert msgspec.json.decode((out / "identification.json").read_bytes())["runs"] == 8


def test_folds_alternate_over_the_sessions_of_a_group_or_else_over_its_runs(sample):
    halves = dict(zip([run.name for run in sample], folds(sample), strict=True))
    assert halves["circular_231220200502/run-01.csv.gz"] == 0
    assert halves["circular_231220200502/run-02.csv.gz"] == 0
    assert halves["circular_231220200510/run-01.csv.gz"] == 1
    one = [run for run in sample if run.session == "square_080920201715"]
    assert folds(one) == [0, 1, 0, 1]


# ---- each wrong file gives one line


def swapped(run, *order):
    return replace(run, wheels=run.wheels[:, order])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: swapped(r, 1, 0, 2, 3), "front_left and front_right are swapped: "),
        (lambda r: swapped(r, 2, 1, 0, 3), "front_left and rear_left are swapped: "),
        (lambda r: swapped(r, 0, 1, 3, 2), "rear_left and rear_right are swapped: "),
        (lambda r: replace(r, wheels=r.wheels * [1, -1, 1, 1]), "front_right turn backwards: "),
        (lambda r: replace(r, wheels=np.degrees(r.wheels)), "wheels of radius 0.00052"),
        (lambda r: replace(r, poses=r.poses * [1, 1, 57.3]), "must be in radians, not degrees"),
        (lambda r: replace(r, wheels=np.sin(r.wheels)), "do not explain the reference's motion"),
        (lambda r: replace(r, poses=0.0 * r.poses), "the reference must move and turn"),
    ],
)
def test_wrong_columns_of_wheels_are_named(change, message):
    run = driven(noise_m=0.0003)
    check_wheels("good", Moments.of(cut(run, 0.5)), NOMINAL)
    with pytest.raises(ConfigError, match=f"^bad: .*{message}"):
        check_wheels("bad", Moments.of(cut(change(run), 0.5)), NOMINAL)


def rows(count=100):
    return [[0.01 * k, 0.001 * k, 0.0, 0.0, 0.001, -0.001, 0.001, -0.001] for k in range(count)]


def made(change):
    table = rows()
    change(table)
    return "\n".join(",".join(map(str, row)) for row in table)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: [row.pop() for row in t], "has 7 columns; 8 are needed"),
        (lambda t: t[4].pop(), "line 5 has 7 columns; 8 are needed"),
        (lambda t: t[4].__setitem__(2, "x"), "line 5: 'x' is not a number"),
        (lambda t: t[4].__setitem__(2, "nan"), "pose of sample 5 is not a finite number; 1 of 100"),
        (lambda t: t[4].__setitem__(7, "inf"), "wheels of sample 5 is not a finite number; 96 of"),
        (
            lambda t: t[4].__setitem__(0, 0.0),
            "time must increase, but sample 5 is at 0 s after 0.03",
        ),
        (
            lambda t: t[50:] and [r.__setitem__(3, 179.0 - 359 * (i % 2)) for i, r in enumerate(t)],
            "yaw jumps by 360: it must be in radians, not degrees",
        ),
        (
            lambda t: [r.__setitem__(1, 1000 * r[1]) for r in t],
            "moves at 100 m/s; x and y must be in metres",
        ),
        (
            lambda t: [r.__setitem__(0, 1e3 * r[0]) for r in t],
            "has a sample every 10 s; at most 0.25 s is allowed, with time in seconds",
        ),
        (lambda t: t.__delitem__(slice(20, None)), "has 20 samples; at least 50 are needed"),
        (lambda t: t.clear(), "has 0 samples"),
    ],
)
def test_a_hostile_file_is_refused_in_one_line(tmp_path, change, message):
    session = tmp_path / "circular_1"
    session.mkdir()
    (session / "metadata.csv").write_text("type,omni4\n")
    (session / "run-01.csv.gz").write_bytes(gzip.compress(made(change).encode()))
    with pytest.raises(ConfigError, match=f"run-01.csv.gz: .*{message}") as refusal:
        readers.optiodom(tmp_path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x1f\x8b\x08garbage", "can't be read"),
        (gzip.compress(b"\xff\xfe"), "can't be read"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "metadata.csv").write_text("type,omni4\n")
    (tmp_path / "run-01.csv.gz").write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        readers.optiodom(tmp_path)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ("gt_ti,0\ngt_tf,100\nodo_ti,0\nodo_tf,10\n", "durations of run 1: .* is 10; it must be"),
        ("gt_ti,0\ngt_tf,ten\nodo_ti,0\nodo_tf,10\n", "durations of run 1"),
        ("gt_ti,0\ngt_tf,10\nodo_ti,0\nodo_tf,0\n", "durations of run 1"),
    ],
)
def test_impossible_durations_are_refused(tmp_path, metadata, message):
    (tmp_path / "metadata.csv").write_text(metadata)
    (tmp_path / "run-01.csv").write_text(made(lambda _: None))
    with pytest.raises(ConfigError, match=message):
        readers.optiodom(tmp_path)


def test_a_folder_without_sessions_or_runs_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no session"):
        readers.optiodom(tmp_path)
    (tmp_path / "metadata.csv").write_text("type,omni4\n")
    with pytest.raises(ConfigError, match=r"no run-\*\.csv"):
        readers.optiodom(tmp_path)


def test_csv_columns_are_taken_by_name_and_can_be_mapped(tmp_path):
    run = driven(seconds=5.0)
    names = ["t", *readers.COLUMNS[1:], "other"]
    table = np.column_stack([run.times, run.poses, run.wheels, run.times])
    file = tmp_path / "drive.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(names), comments="")
    (read_again,), _ = read([file], "csv", ["time_s=t"])
    assert read_again.wheels == pytest.approx(run.wheels)
    with pytest.raises(ConfigError, match=r"drive\.csv: no column 'time_s'; its columns are t"):
        read([file], "csv")
    with pytest.raises(ConfigError, match="--columns: time: unknown; allowed: time_s, x_m"):
        read([file], "csv", ["time=t"])
    with pytest.raises(ConfigError, match="--columns must be NAME=COLUMN"):
        read([file], "csv", ["time"])
    bag = tmp_path / "drive_0.db3"
    bag.write_bytes(b"SQLite format 3\0\xff")
    with pytest.raises(
        ConfigError, match=r"drive_0\.db3: a bag of ROS can't be read; export its jo"
    ):
        read([bag])
    with pytest.raises(ConfigError, match="--format bag: unknown; allowed: mcap, optiodom, csv"):
        read([file], "bag")


def test_the_columns_of_the_wheels_are_in_the_order_of_all_else():
    assert [name.removesuffix("_rad") for name in readers.COLUMNS[4:]] == list(WHEELS)
