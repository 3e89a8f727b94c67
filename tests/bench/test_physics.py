"""Our physics by the measures of all engines."""

import pytest
from bench.ideal import STEP_S, Ideal
from mecazen_bench import physics
from mecazen_bench.stack import robot


@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_is_smooth_and_has_the_predicted_gains(name, figures):
    engine = physics.DartEngine(robot(name), STEP_S)
    (row,) = figures([physics.measure("Physics", [engine], blocks=2)]).values()
    accuracy = ["ripple % of R", "forward", "lateral", "lateral / predicted", "yaw / predicted"]
    assert all(row[title].met for title in accuracy)
    # a smooth wheel loses nothing; rollers that are hulls of spheres cost some percent
    assert -10.0 < row["energy %/s"].value < 0.5


def test_the_projection_takes_away_the_ripple_and_little_else(figures):
    engines = [physics.DartEngine(robot("nexus"), STEP_S, projects=p) for p in (True, False)]
    projected, plain = figures([physics.measure("Physics", engines, blocks=1)]).values()
    assert projected["ripple % of R"].value < 1e-6
    # DART lets wheels sink by some micrometres where rollers hand over
    assert 0.001 < plain["ripple % of R"].value < 0.1
    assert projected["lateral"].value == pytest.approx(plain["lateral"].value, abs=0.002)


def test_a_step_of_1_ms_that_takes_20_us_is_50_times_real_time():
    ((subject, row),) = physics.measure("Physics", [Ideal()], blocks=2).rows.items()
    assert subject == "nexus 1 ms ideal"
    # sums of thousands of steps
    assert row["µs/step"].value == pytest.approx(20.0, rel=1e-9)
    assert row["× real time"].value == pytest.approx(50.0, rel=1e-9)


def test_our_largest_step_is_measured_by_the_capsules_of_mujoco():
    class Named(Ideal):
        def __init__(self, name: str, dt_s: float) -> None:
            super().__init__()
            self.name, self.dt_s = name, dt_s

    engines = [Named(physics.PEER, 0.001), Named("mecazen", 0.001)]
    peer, ours = physics.measure("Physics", engines, blocks=1).rows.values()
    assert peer["of MuJoCo"].value == 1.0
    # both take 20 us a step
    assert ours["of MuJoCo"].value == pytest.approx(1.0, rel=1e-9)
