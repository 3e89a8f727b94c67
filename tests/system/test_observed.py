"""A run as columns and samples, tick by tick, and poses of many ticks at once."""

import numpy as np
import pytest
from harness import SCENARIOS
from hypothesis import given
from hypothesis import strategies as st
from mecazen import geometry
from mecazen.keys import CLOCK, ODOM
from mecazen.loading import load_scenario
from mecazen_tools.observe import observe
from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Poses, deviations, first_motion
from planar import poses

BACK = SCENARIOS / "back.toml"
pairs = st.lists(st.tuples(poses, poses), min_size=1, max_size=5)


def test_a_run_has_all_ticks_and_samples_and_the_scores_of_its_deviations():
    scenario = load_scenario(BACK, {"sim.duration_s": 1.5})
    with Simulation(scenario) as sim:
        sim.run()
        scores, sha256 = sim.trajectory.scores(), sim.trajectory.sha256()
    run = observe(scenario, CLOCK, ODOM)
    assert run.trajectory_sha256 == sha256
    assert (len(run.table), run.table.tick_s) == (150, pytest.approx(0.01))
    assert [len(samples) for samples in run.samples.values()] == [150, 150]
    odom = run.samples[ODOM.key][99].pose.pose.to_planar()
    assert run.table.poses("odom").at(99) == odom
    assert run.table.tracking[-1] == "following"
    late = run.table.where(slice(100, None))
    assert late["t_s"][0] == run.table["t_s"][100]
    assert late.ticks(np.array([1.2])) == [20]
    distance, _, yaw = deviations(run.table, scenario.follower.standoff)[
        :, first_motion(run.table) :
    ]
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
