"""The loop runs in every way, and a tick is divided among its nodes."""

import pytest
from mecazen_bench import loop


def test_the_loop_runs_in_every_way_each_beside_one_process(figures):
    ways, parts = loop.run(blocks=1, duration_s=1.0)
    rows = figures([ways])
    assert list(rows) == ["in one process", *loop.GROUPS]
    one = rows["in one process"]["µs/tick"].value
    for row in rows.values():  # of a single block, the ratio of medians is that of the pair
        assert row["of one process"].value == pytest.approx(one / row["µs/tick"].value)
    *each, everything = figures([parts]).values()
    assert sum(row["µs/tick"].value for row in each) == pytest.approx(everything["µs/tick"].value)
    assert min(row["µs/tick"].value for row in each) > 0.0
    assert {"physics", "controller", "target", "follower"} < set(parts.rows)


def test_each_kind_of_sensor_has_its_share_of_the_loop_with_the_pose(figures):
    kinds, parts = loop.run_senses(duration_s=1.0)
    assert list(figures([kinds])) == ["pose", "body", "legs", "fused"]
    assert kinds.rows["pose"]["of pose"].value == 1.0
    assert any("sensors" in part for part in figures([parts]))


def test_a_crowd_is_measured_with_its_guard(figures):
    rows = figures(loop.run_safety(duration_s=2.0))
    assert rows["guard"]["p99 of a step, ms"].value > 1e-3 * rows["guard"]["µs/tick"].value


def test_calls_of_a_method_are_timed_until_the_end_only():
    class Node:
        def step(self, number):
            return number + 1

    with loop.timed(Node, "step") as took:
        assert Node().step(1) == 2
    Node().step(1)
    assert len(took) == 1
    assert took[0] >= 0.0
