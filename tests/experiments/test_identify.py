"""Kinematics and motors of a robot come out of recordings; an invalid file is one line."""

import cmath
import gzip
import math
import os
from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from experiments.conftest import run_command
from harness import ROOT
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_scenario, load_table, scenario_path
from mecazen.robot import WHEELS, RealMotors, Robot
from mecazen_experiments.identify import data
from mecazen_experiments.identify.data import MotorLog, Run, checked
from mecazen_experiments.identify.identification import (
    clock_offset,
    identify,
    independent_units,
    run_units,
)
from mecazen_experiments.identify.models import Model, ambiguities, covariance, estimates, fit
from mecazen_experiments.identify.motors import NAMES, identify_motors, response
from mecazen_experiments.identify.windows import (
    check_wheels,
    drifts,
    ideal_matrix,
    integrated,
    moments,
    mounted,
    odometry,
    shifted,
)
from mecazen_physics.motors import MotorModel
from mecazen_tools.simulation import Simulation

SAMPLE = ROOT / "examples" / "optiodom"
"""16 runs of the OptiOdom data."""
OMNI4 = load_table(ROOT / "configs" / "robots" / "omni4.toml", Robot)
FREE = Model("lateral gain free", OMNI4)
RADIUS, LEVER, GAIN = 0.031, 0.22, 0.96
MOUNTED = 0.01, 0.02, -0.03
"""Misalignment [rad] and offset [m] of the reference."""
SEEDS = range(1, 1 + int(os.environ.get("MECAZEN_SEEDS", "1")))
"""Seeds of recordings with motors; MECAZEN_SEEDS sets their number."""
TICK_S = 0.01
STEPS = np.loadtxt(ROOT / "examples" / "excitation.csv", delimiter=",", skiprows=1).tolist()
"""A minute of commands that makes all parameters observable: time [s] and twist."""


def driven(seed=1, noise_m=0.0, seconds=60.0):
    """Return a run of a robot that moves along all axes at random, with a reference on it."""
    random, step_s = np.random.default_rng(seed), 0.01
    count = round(seconds / step_s)
    knots = random.normal(0.0, (0.1, 0.1, 0.5), (round(seconds), 3))
    twists = np.stack(
        [np.interp(np.linspace(0, len(knots) - 1, count), range(len(knots)), k) for k in knots.T], 1
    )
    j = ideal_matrix(OMNI4, RADIUS, LEVER, GAIN)
    steps = twists * step_s
    wheels = np.concatenate([np.zeros((1, 4)), np.cumsum(steps @ np.linalg.pinv(j).T, axis=0)])
    turn, x, y = MOUNTED
    c, s = math.cos(turn), math.sin(turn)
    in_reference = steps @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T
    poses = shifted(integrated(in_reference), np.array([x, y]))
    poses = poses + random.normal(0.0, noise_m, poses.shape)
    return checked(Run("made.csv", "made", step_s * np.arange(count + 1), poses, wheels))


@pytest.fixture(scope="module")
def sample():
    return data.optiodom(SAMPLE)


# ---- kinematics of made runs


def test_planted_values_are_within_their_intervals_in_18_of_20_seeds():
    planted = {"radius_m": RADIUS, "lever_m": LEVER, "lateral_gain": GAIN}
    held, seeds = dict.fromkeys(planted, 0), 20
    for seed in range(seeds):
        runs = [driven(100 * seed + run, noise_m=0.0003, seconds=40.0) for run in range(2)]
        units = run_units(runs, 0.0)
        values = estimates(fit(FREE, units), independent_units(runs, units, 0.0))
        for name, true in planted.items():
            estimate = values[name]
            assert estimate.mean == pytest.approx(true, rel=0.003)
            held[name] += estimate.low < true < estimate.high  # over eight blocks of 10 s
    assert min(held.values()) >= 18


def test_parameters_without_influence_or_with_the_same_influence_are_named():
    straight = driven(noise_m=0.0003)
    straight = replace(
        straight,
        poses=straight.poses * [1.0, 0.0, 1e-9],
        wheels=np.outer(straight.poses[:, 0], np.ones(4)) / RADIUS,
    )
    fitted = fit(FREE, run_units([straight], 0.0))
    lines = ambiguities([*fitted.by_name], covariance(fitted.slopes))
    assert any(line.startswith("lever_m is not determined") for line in lines)
    spread = np.array([[1e-6, -1e-6, 0.0], [-1e-6, 1e-6, 0.0], [0.0, 0.0, 1.0]])
    assert ambiguities(("tyre_m", "rim_m", "lever_m"), spread) == (
        "lever_m is not determined: the motion hardly depends on it",
        "tyre_m and rim_m can't be told apart: their correlation is -1.000",
    )


def test_drift_is_that_of_odometry_that_starts_at_the_reference():
    run = driven()
    right = fit(FREE, run_units([run], 0.0)).coefficients("")
    assert np.max(drifts(run, odometry(run, right), 10.0)) < 1e-4
    longer = right.copy()
    longer[:12] *= 1.01
    error = drifts(run, odometry(run, longer), 1.0)[:, 0]
    driven_m = np.hypot(*np.diff(run.poses[::100, :2], axis=0).T)
    assert np.median(error / driven_m[: len(error)]) == pytest.approx(0.01, rel=0.5)
    # and that of a simulated robot is the drift of the reference on it
    (pose,) = mounted(np.array([[1.0, 2.0, np.pi / 2]]), np.array([0.1, 0.2, 0.0]))
    yaw = np.pi / 2 + 0.1
    assert pose == pytest.approx((1.0 + 0.2 * np.cos(yaw), 2.0 + 0.2 * np.sin(yaw), yaw))


def test_a_clock_that_is_ahead_is_estimated():
    run = driven()
    late = replace(run, poses=np.concatenate([run.poses[:1].repeat(5, axis=0), run.poses[:-5]]))
    assert clock_offset(OMNI4, [late]).mean == pytest.approx(0.05, abs=0.001)


@pytest.mark.parametrize("degrees", [-135, 40])
def test_a_reference_may_be_mounted_at_any_angle(degrees):
    run, turn = driven(noise_m=0.0003, seconds=30.0), math.radians(degrees)
    result = identify(OMNI4, [replace(run, poses=run.poses + np.array([0.0, 0.0, turn]))])
    values = result.parameters[-1]
    for name, expected in {"radius_m": RADIUS, "lever_m": LEVER, "lateral_gain": GAIN}.items():
        assert values[name].mean == pytest.approx(expected, rel=0.003)  # as without a turn
    # the noise moves it by less than 0.1°, and by some millimetres
    assert values["misalignment_rad"].mean == pytest.approx(turn + MOUNTED[0], abs=0.002)
    offset = complex(values["offset_x_m"].mean, values["offset_y_m"].mean)
    assert offset == pytest.approx(complex(*MOUNTED[1:]) * cmath.exp(-1j * turn), abs=0.005)


# ---- the recorded robot


def test_the_recorded_robot_has_the_lateral_gain_of_six_rollers(sample):
    result = identify(OMNI4, sample)
    assert result.parameters[-1]["lateral_gain"].mean == pytest.approx(0.954, abs=0.003)
    assert result.rollers == 6
    assert result.geometry.by_name["radius_m"] == pytest.approx(0.0306, abs=0.0003)


def test_one_radius_fits_circles_and_squares_with_missing_time_made_up_for(sample):
    radii = []
    for path in ("circular", "square"):
        units = run_units([run for run in sample if run.path == path], 0.0)
        radii.append(fit(FREE, units).by_name["radius_m"])
    # as logged, the radii would differ by 4 %
    assert radii[1] == pytest.approx(radii[0], rel=0.008)


def test_a_validation_reports_the_drift_of_models_and_of_the_simulation(tmp_path):
    run_command("identify", SAMPLE, "--robot", "omni4", "--validate", "--out", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"validation.md", "robot.toml"}
    assert "from 8 runs" in (tmp_path / "robot.toml").read_text()
    rows = [
        [cell.strip() for cell in line.split("|")[1:4]]
        for line in (tmp_path / "validation.md").read_text().splitlines()
        if line.startswith("| ") and line.count("|") == 5
    ]
    for path, limit_mm in (("circular", 6.0), ("square", 20.0)):
        # of one session each; docs/validation.md has those of all data
        drift = {row[0]: float(row[2].split(",")[0]) for row in rows if row[1] == path}
        geometry = drift["geometry, 6 rollers"]
        assert geometry < limit_mm
        assert geometry < drift["ideal, calibrated"] < drift["nominal"]
        # within 1.5 mm of it or of the noise of 8 runs
        assert drift["full physics"] == pytest.approx(geometry, rel=0.2, abs=1.5)


# ---- motors


def record(seed, file):
    """Record a minute of the excitation; the robot differs from its file in motors and size."""
    hidden, random = np.random.default_rng(seed), np.random.default_rng(1000 + seed)
    gains = tuple(hidden.uniform(0.98, 1.02, 4).tolist())
    motors = RealMotors(
        delay_s=hidden.uniform(0.005, 0.06),
        time_constant_s=hidden.uniform(0.03, 0.12),
        dead_band_rad_s=hidden.uniform(0.2, 0.6),
        gains=gains,
    )
    scenario = load_scenario(
        scenario_path("teleop"),
        {
            "sensor.also": [],
            "start.x_m": -5.0,
            "physics.dt_s": 0.002,
            "sensors.encoders.counts_per_turn": 4096,
            "sim.duration_s": STEPS[-1][0],
            "seed": seed,
            "robot.wheels.radius_m": 0.05 * random.uniform(0.98, 1.02),
            "robot.wheels.track_m": 0.3 * random.uniform(0.97, 1.03),
            "robot.rollers.count": random.integers(8, 13),
        },
    )
    robot = msgspec.structs.replace(scenario.robot, motors=motors)
    scenario = msgspec.structs.replace(scenario, robot=robot)
    with Simulation(scenario, record=file) as simulation:
        for (begin_s, vx, vy, wz), after in pairwise(STEPS):
            simulation.command(vx=vx, vy=vy, wz=wz)
            simulation.run(after[0] - begin_s - (TICK_S if after is STEPS[-1] else 0.0))
    return motors


def test_the_response_of_the_fit_is_that_of_the_simulation():
    motors = RealMotors(
        delay_s=0.0234, time_constant_s=0.07, dead_band_rad_s=0.4, gains=(1, 2, 1, 1)
    )
    commands = np.random.default_rng(1).normal(0.0, 3.0, (200, 4)).cumsum(axis=0)
    model, speeds = MotorModel(motors, TICK_S), []
    for command in commands:
        model.give(command)
        speeds.append(model.step(1.0))
    values = np.array([0.0234, 0.07, 0.4, *motors.gains])
    ends, _ = response(values, MotorLog(TICK_S, commands, commands))
    assert ends == pytest.approx(np.array(speeds), abs=1e-9)


def test_parameters_that_a_single_command_leaves_open_are_named():
    command = np.full((500, 4), 3.0)
    _, lines = identify_motors([MotorLog(TICK_S, command, command)])
    assert "dead_band_rad_s" in " ".join(lines)
    _, lines = identify_motors([MotorLog(TICK_S, 0.0 * command, 0.0 * command)])
    assert len(lines) == len(NAMES)


@pytest.mark.parametrize("seed", SEEDS)
def test_planted_motors_come_out_of_a_recording_and_are_in_the_robot_file(seed, tmp_path):
    motors = record(seed, tmp_path / "drive.mcap")
    run_command("identify", tmp_path / "drive.mcap", "--out", tmp_path / "out")
    assert "## Motors" in (tmp_path / "out" / "report.md").read_text()
    (tmp_path / "scenario.toml").write_text('robot = "out/robot.toml"\n')
    fitted = load_scenario(tmp_path / "scenario.toml").robot.motors
    # DART moves a wheel by its speed at the end of a step: half a step of 2 ms early
    assert fitted.delay_s == pytest.approx(motors.delay_s, abs=0.002)
    assert fitted.time_constant_s == pytest.approx(motors.time_constant_s, rel=0.05)
    assert fitted.dead_band_rad_s == pytest.approx(motors.dead_band_rad_s, rel=0.1)
    assert fitted.gains == pytest.approx(motors.gains, rel=0.005)


# ---- files


def test_csv_columns_are_read_by_name_and_times_since_1970(tmp_path):
    run = driven(seconds=5.0)
    table = np.column_stack([run.wheels, run.poses, 1_700_000_000 + run.times, run.times])
    wheels = [f"{wheel}_rad" for wheel in WHEELS]
    names = [*wheels, "x_m", "y_m", "yaw_rad", "time_s", "also"]
    file = tmp_path / "drive.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(names), comments="")
    ((again,), _) = data.read([file])
    assert again.wheels == pytest.approx(run.wheels)
    assert again.times == pytest.approx(run.times, abs=1e-6)  # 1.7e9 s has 0.24 µs of resolution


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: {"wheels": r.wheels[:, [1, 0, 2, 3]]}, "do not explain the reference's motion"),
        (lambda r: {"wheels": np.degrees(r.wheels)}, "wheels of radius 0.00052"),
        (lambda r: {"poses": 0.0 * r.poses}, "the reference must move and turn"),
    ],
)
def test_wrong_columns_of_wheels_are_refused(change, message):
    run = driven(noise_m=0.0003)
    check_wheels("good", moments(run), OMNI4)
    with pytest.raises(ConfigError, match=f"^bad: .*{message}"):
        check_wheels("bad", moments(replace(run, **change(run))), OMNI4)


def session(*changes):
    """Return the files of a session of 100 samples, with other cells (row, column, value)."""
    table = [[0.01 * k, 0.001 * k, 0.0, 0.0, 1e-3, -1e-3, 1e-3, -1e-3] for k in range(100)]
    for row, column, value in changes:
        for number in range(100) if row is None else [row]:
            table[number][column] = value(number) if callable(value) else value
    return text([[cell for cell in row if cell is not None] for row in table])


def text(rows):
    """Return the files of a session with some rows."""
    content = "\n".join(",".join(map(str, row)) for row in rows).encode()
    return {"metadata.csv": b"type,omni4\n", "run-01.csv.gz": gzip.compress(content)}


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (session((None, 7, None)), "run-01.csv.gz: must have rows with 8 columns"),
        (session((4, 2, "x")), "could not convert string 'x' to float64 at row 4, column 3"),
        (session((4, 2, "nan")), "pose of sample 5 is not a finite number; 1 of 100"),
        (session((4, 0, 0.0)), "time must increase, but sample 5 is at 0 s after 0.03"),
        (session((None, 3, lambda k: 179 - 359 * (k % 2))), "yaw jumps by 360: it must be in rad"),
        (session((None, 0, lambda k: 10 * k)), "every 10 s; at most 0.25 s is allowed, with time"),
        (text([[0.01 * k, *[0.0] * 7] for k in range(20)]), "has 20 samples; at least 50 are"),
        ({}, "no session: a folder with metadata.csv"),
        ({"metadata.csv": b"a,b\n"}, r"no run-\*\.csv"),
        ({"metadata.csv": b"a,b\n", "run-01.csv.gz": b"\x1f\x8b\x08garbage"}, "can't be read"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, files, message):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    is_session = not files or "metadata.csv" in files
    with pytest.raises(MecazenError, match=message) as refusal:
        data.read([tmp_path if is_session else tmp_path / next(iter(files))])
    assert "\n" not in str(refusal.value)
