"""Benchmarks of the loop and of processes return finite figures for each part."""

import math
import time

import psutil
import pytest
from mecazen_bench import latency, loop, processes, realtime


def values(rows):
    """Return the values of a table by row and column; all are finite."""
    table = {
        name: {column: value for column, (value, _) in row.items()} for name, row in rows.items()
    }
    assert all(math.isfinite(value) for row in table.values() for value in row.values())
    return table


def test_the_loop_runs_in_every_way_and_a_tick_is_divided_among_its_nodes():
    whole, *parts = map(values, loop.run(blocks=1, duration_s=2.0).values())
    assert list(whole) == ["in one process", *loop.GROUPS]
    in_one = whole["in one process"]["µs/tick"]
    for row in whole.values():  # of a single block, the ratio of medians is that of the pair
        assert row["of one process"] == pytest.approx(in_one / row["µs/tick"])
    back, fused, crowd = parts
    for table in parts:
        *each, everything = (row["µs/tick"] for row in table.values())
        assert sum(each) == pytest.approx(everything)
        assert min(each) > 0.0
    assert {"physics", "controller", "target", "follower"} < set(back)
    assert "sensors: lidar" in fused
    assert crowd["guard"]["p99 of a step, ms"] > 1e-3 * crowd["guard"]["µs/tick"]


def test_every_command_is_answered_and_its_latency_measured():
    (rows,) = map(values, latency.run(puts=30).values())
    assert len(rows) == 3
    assert [row["lost"] for row in rows.values()] == [0, 0, 0]
    assert all(0.0 < row["median ms"] <= row["max ms"] for row in rows.values())


def test_latencies_are_summarised_in_ms_without_those_that_are_lost():
    row = latency.percentiles([number / 1e3 for number in range(101)] + [None, None])
    assert values({"": row})[""] == pytest.approx(
        {"median ms": 50.0, "p99 ms": 99.0, "max ms": 100.0, "lost": 2}
    )


def test_a_stack_in_real_time_is_measured_by_process():
    tables = {title: values(rows) for title, rows in realtime.run(window_s=1.0).items()}
    back, _, side, schedule = tables.values()
    services = ["physics", "controller", "target", "follower"]
    assert sorted(back) == sorted(["router", *services, *processes.HELPERS, "all"])
    for name in services:
        assert back[name]["% of a core"] > 0.0
        assert back[name]["MB"] > 1.0
    assert side["viewer"]["% of a core"] > 0.0
    assert len(side) > len(back) + 1  # Rerun's server as well
    assert schedule["mecazen up"]["first odom s"] > 0.0


def test_the_processor_time_of_a_process_is_the_time_that_it_measures_itself():
    before_s = time.process_time()
    spent_s = processes.spent_s(psutil.Process())
    assert before_s <= spent_s <= time.process_time()
