"""A run as columns, its samples, and where people were, tick by tick."""

import math

import numpy as np
import pytest
from harness import SCENARIOS, error_of
from hypothesis import given
from hypothesis import strategies as st
from mecazen import geometry
from mecazen import messages as m
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.keys import CLOCK, ODOM, PEOPLE, SKELETONS, TARGET_SKELETON
from mecazen.loading import load_scenario
from mecazen.skeleton import JOINTS
from mecazen_tools import observe as module
from mecazen_tools.observe import PELVIS, SAME_M, Observed, observe, watch
from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Poses, Table, deviations, first_motion, wrap
from mecazen_tools.trajectory import COLUMNS
from planar import poses

BACK = SCENARIOS / "back.toml"
pairs = st.lists(st.tuples(poses, poses), min_size=1, max_size=5)


def run_of(ticks, **columns):
    """Return a run with these columns alone."""
    missing = {name: np.full(ticks, np.nan) for name in COLUMNS}
    return Table(missing | {"t_s": 0.01 * np.arange(ticks)} | columns, 0.01)


@pytest.fixture(scope="module")
def short():
    """Return 1.5 s of a run: its columns and samples, its scores, and its hash."""
    scenario = load_scenario(BACK, {"sim.duration_s": 1.5})
    with Simulation(scenario) as sim:
        sim.run()
        expected = sim.trajectory.scores(), sim.trajectory.sha256()
    return observe(scenario, CLOCK, ODOM), *expected


def test_a_run_has_all_ticks_and_all_samples(short):
    run, _, sha256 = short
    assert run.trajectory_sha256 == sha256
    assert (len(run.table), run.table.tick_s) == (150, pytest.approx(0.01))
    assert [len(samples) for samples in run.samples.values()] == [150, 150]
    odom = run.samples[ODOM.key][99].pose.pose.to_planar()
    assert run.table.poses("odom").at(99) == odom
    assert run.table.tracking[-1] == "following"
    late = run.table.where(slice(100, None))
    assert late["t_s"][0] == run.table["t_s"][100]
    assert late.ticks(np.array([1.2])) == [20]


def test_the_scores_of_a_run_are_means_of_its_deviations(short):
    run, scores, _ = short
    standoff = load_scenario(BACK).follower.standoff
    distance, _, yaw = deviations(run.table, standoff)[:, first_motion(run.table) :]
    # numpy sums in another order
    assert abs(distance).mean() == pytest.approx(scores.d_err_m, rel=1e-12)
    assert np.degrees(abs(yaw).mean()) == pytest.approx(scores.theta_err_deg, rel=1e-12)


def test_a_drive_is_asked_in_every_tick_but_the_last():
    ticks = []

    def drive(tick, samples):
        ticks.append((tick, len(samples[CLOCK.key])))
        return {}

    teleop = load_scenario(SCENARIOS / "teleop.toml", {"sim.duration_s": 0.05})
    table = observe(teleop, CLOCK, drive=drive).table
    assert ticks == [(tick, tick) for tick in range(1, 5)]
    assert np.isnan(table["estimate_x_m"]).all()  # no follower takes part
    assert set(table.tracking) == {""}


def test_bodies_need_a_tracker():
    assert "sensor.kind" in error_of(ConfigError, lambda: watch(load_scenario(BACK)))


@given(pairs)
def test_poses_of_many_ticks_are_those_of_each(pairs):
    def assert_same(computed, expected):
        for tick, pose in enumerate(expected):
            # a coordinate of up to 400 has a rounding of 6e-14; some of them add up
            assert computed.at(tick)[:2] == pytest.approx(pose[:2], abs=1e-12)
            turn = geometry.wrap(computed.at(tick).yaw - pose.yaw)
            assert turn == pytest.approx(0.0, abs=1e-12)

    left, right = zip(*pairs, strict=True)
    frames, bodies = (Poses(*np.array(column).T) for column in (left, right))
    assert_same(frames.compose(bodies), [a.compose(b) for a, b in pairs])
    assert_same(frames.between(bodies), [a.between(b) for a, b in pairs])
    assert_same(frames.compose(right[0]), [pose.compose(right[0]) for pose in left])


def test_wrap_brings_angles_to_half_a_turn():
    angles = wrap(np.radians([0.0, 179.0, 181.0, -181.0, 360.0, 730.0]))
    assert np.degrees(angles) == pytest.approx([0.0, 179.0, -179.0, 179.0, 0.0, 10.0], abs=1e-12)


# --- people --------------------------------------------------------------------------------------


def header(t_s):
    return m.Header(m.Time.from_ns(round(t_s * 1e9)))


def body_at(x):
    return (m.Point(x, 0.0, 1.0),) * len(JOINTS)


def frame(t_s, *places, confidence=()):
    bodies = tuple(m.Skeleton(joints=body_at(x), confidence=confidence) for x in places)
    return m.Skeletons(header(t_s), bodies)


@pytest.fixture
def watched(monkeypatch):
    """A robot stands 1 m before the origin of the world; its person is at 3 m, then at 4 m."""
    far, hidden = 3.0 + SAME_M + 0.01, (0,) * len(JOINTS)
    samples = {
        TARGET_SKELETON.key: [
            m.Skeleton(header(t), height=1.8, joints=body_at(x))
            for t, x in ((0.0, 3.0), (0.04, 4.0))
        ],
        PEOPLE.key: [
            m.People(header(0.0), (m.Person("target", joints=body_at(3.0)),)),
            m.People(header(0.04), (m.Person("anna", height=1.6, joints=body_at(7.0)),)),
            m.People(header(9.0), (m.Person("late", joints=body_at(7.0)),)),
        ],
        SKELETONS.key: [
            m.Skeletons(),  # taken before the start
            frame(0.01, far, 3.1),
            frame(0.02, far),
            frame(0.03, 3.0, confidence=hidden),
            frame(0.04),
        ],
    }
    robot = {
        f"robot_{name}": np.full(10, x) for name, x in (("x_m", 1), ("y_m", 0), ("yaw_rad", 0))
    }
    run = Observed(run_of(10, **robot), "sha", samples)
    monkeypatch.setattr(module, "observe_bodies", lambda *_: run)
    return watch(None)


def test_people_are_only_where_they_are_reported(watched):
    assert watched.t.tolist() == [0.0, 0.04]
    assert watched.person.joints[:, PELVIS, 0].tolist() == [3.0, 4.0]
    (anna,) = watched.pedestrians
    assert (anna.height, watched.person.height) == (1.6, 1.8)
    assert np.isnan(anna.joints[0]).all()
    assert anna.joints[1, PELVIS].tolist() == [7.0, 0.0, 1.0]
    assert watched.robot.at(1) == Pose2D(1.0, 0.0, 0.0)


def test_a_frame_shows_the_person_if_a_body_is_there(watched):
    # at 0.01 s the person is at the next known place, 4 m: 3 m ahead of the robot
    times, shown = watched.sight
    assert times.tolist() == [0.01, 0.02, 0.03, 0.04]
    assert shown.tolist() == [True, False, False, False]
    (_, body), *_ = watched.frames
    assert math.isclose(body.joints[PELVIS].x, 3.1)
