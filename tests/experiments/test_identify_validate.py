"""The drift of models and of the full simulation on sessions that nothing was fitted to."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from harness import ROOT
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen_experiments.identify import readers
from mecazen_experiments.identify.commands import validate as validate_command
from mecazen_experiments.identify.models import Nominal
from mecazen_experiments.identify.simulated import mounted, simulated
from mecazen_experiments.identify.validate import IDEAL, PHYSICS, load, optiodom, split

SAMPLE = ROOT / "examples" / "optiodom"
FILE = ROOT / "configs" / "experiments" / "validate.toml"


@pytest.fixture(scope="module")
def sample():
    return readers.optiodom(SAMPLE)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("validated")
    validate_command(str(FILE), SAMPLE, out)
    return out


@pytest.fixture(scope="module")
def found(written):
    return msgspec.json.decode((written / "validation.json").read_bytes())


def test_sessions_of_odd_position_in_each_kind_of_path_are_for_fitting(sample):
    config, _ = load(FILE)
    fitted, others = ({run.session for run in half} for half in split(sample, config))
    assert fitted == {"circular_231220200502", "square_080920201205"}
    assert others == {"circular_231220200510", "square_080920201715"}
    even = msgspec.structs.replace(config, fit="even")
    assert [{run.session for run in half} for half in split(sample, even)] == [others, fitted]


def test_nothing_that_validates_is_fitted(sample, found):
    config, _ = load(FILE)
    fitted, _ = split(sample, config)
    assert found["identification"]["runs"] == len(fitted)
    assert not set(found["fitted"]) & set(found["held_out"])


def drift(found, model, kind, horizon_s=10.0):
    (one,) = [
        one
        for one in found["drifts"]
        if (one["model"], one["kind"], one["horizon_s"]) == (model, kind, horizon_s)
    ]
    return one["position_median_m"]["mean"]


@pytest.mark.parametrize(("kind", "limit_m"), [("circular", 0.006), ("square", 0.02)])
def test_the_geometry_of_rollers_drifts_less_than_ideal_kinematics(found, kind, limit_m):
    geometry = drift(found, "geometry, 6 rollers", kind)
    assert geometry < limit_m  # of one session each; docs/validation.md has those of all data
    assert geometry < drift(found, IDEAL, kind) < drift(found, "nominal, as logged", kind)


@pytest.mark.parametrize("kind", ["circular", "square"])
def test_full_physics_drifts_like_the_kinematic_model(found, kind):
    # within 1.5 mm of it or of the noise of 8 runs
    kinematic = drift(found, "geometry, 6 rollers", kind)
    assert drift(found, PHYSICS, kind) == pytest.approx(kinematic, rel=0.2, abs=0.0015)


def test_squares_drift_more_if_missing_time_is_not_made_up_for(found):
    logged = drift(found, "geometry, 6 rollers, as logged", "square")
    assert logged > 1.3 * drift(found, "geometry, 6 rollers", "square")


def test_optiodoms_method_minimises_positions_at_the_ends_of_segments(sample):
    start = Nominal(0.03, 0.2, 1.0)
    matrix = optiodom(start, sample[:4], 10.0)[:12].reshape(3, 4)
    # ideal kinematics: its radius lies between those of forward and lateral motion
    assert 0.029 < matrix[0].sum() < 0.031
    assert np.abs(matrix[0]) == pytest.approx(np.abs(matrix[1]))


def test_the_reference_is_where_it_is_mounted():
    poses = np.array([[1.0, 2.0, np.pi / 2]])
    assert mounted(poses, np.array([0.1, 0.2, 0.0]))[0] == pytest.approx(
        (1.0 + 0.2 * np.cos(np.pi / 2 + 0.1), 2.0 + 0.2 * np.sin(np.pi / 2 + 0.1), np.pi / 2 + 0.1)
    )


def test_the_command_writes_tables_figures_and_the_robot(written):
    names = {"validation.md", "validation.json", "robot.toml", "lateral_gain.png", "drift.png"}
    assert {file.name for file in written.iterdir()} == names
    text = (written / "validation.md").read_text()
    assert "| full physics | circular |" in text
    assert "| geometry, 6 rollers | ideal, calibrated | all | 2 |" in text


def test_the_phases_of_the_rollers_change_how_far_a_robot_turns(sample, written):
    """A real robot's are not recorded, so the simulation of a run can't have its very drift."""
    robot = load_table(written / "robot.toml", Robot)
    run, turning = sample[0], 100
    wheels = run.wheels[500:2500] - run.wheels[500]

    def turned(phases):
        """Return the yaw of 20 s of a run, after the wheels have turned to other phases."""
        before = np.linspace(-1.0, 0.0, turning, endpoint=False)[:, None] * phases
        angles = np.concatenate([before, wheels])
        times = run.period_s * np.arange(len(angles))
        part = replace(run, times=times, poses=np.zeros((len(angles), 3)), wheels=angles)
        yaw = simulated(robot, part)[:, 2]
        return yaw[-1] - yaw[turning]

    random = np.random.default_rng(1)
    yaws = np.abs([turned(random.uniform(0.0, np.pi / 3.0, 4)) for _ in range(6)])
    print(f"yaw of 20 s with other phases: {yaws.max() / yaws.min() - 1.0:.2%}")
    assert 0.005 < yaws.max() / yaws.min() - 1.0 < 0.1
