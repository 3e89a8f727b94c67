"""Figures of benchmarks, the file that keeps them, and the loop and processes that they measure."""

import math

import pytest
from mecazen.errors import MecazenError
from mecazen_bench import harness, latency, loop, processes, realtime
from mecazen_bench.harness import Quantity, ResultsError
from mecazen_tools.cli.app import app
from typer.testing import CliRunner


def figure(value, goal="less", spread=0.0, column="µs/step"):
    ends = value - spread / 2, value + spread / 2
    return Quantity("Physics", "nexus", column, value, *ends, goal)


def run(*words):
    return CliRunner().invoke(app, ["bench", *map(str, words)])


def test_a_run_prints_its_tables_and_writes_its_figures(monkeypatch, tmp_path):
    monkeypatch.setattr(loop, "run", lambda: {"Loop": {"back": {"µs/tick": (80.0, "less")}}})
    file = tmp_path / "new" / "out.csv"
    done = run("run", "--only", "loop", "--csv", file)
    assert done.exit_code == 0
    assert "Loop\n\n| | µs/tick |\n| --- | --- |\n| back | 80 |\n" in done.output
    assert harness.read(file) == [Quantity("Loop", "back", "µs/tick", 80.0, 80.0, 80.0, "less")]
    with pytest.raises(MecazenError, match="fast: no such benchmark; there are loop, latency, re"):
        raise run("run", "--only", "fast").exception


def test_compare_shows_ratios_and_ends_with_1_where_something_became_worse(tmp_path):
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    harness.write([figure(80.0), figure(1.0, column="lost")], a)
    harness.write([figure(100.0)], b)
    worse = run("compare", a, b)
    assert worse.exit_code == 1
    assert "| 1.250 | worse |" in worse.output
    assert "1 figures became worse" in worse.output
    better = run("compare", b, a)
    assert better.exit_code == 0
    assert "| 0.800 | better |" in better.output
    assert "lost" not in better.output  # only one file has it
    with pytest.raises(ResultsError, match="no figure is in both"):
        harness.compare([figure(1.0)], [])


def values(rows):
    """Return the values of a table by row and column; all are finite."""
    table = {
        name: {column: value for column, (value, _) in row.items()} for name, row in rows.items()
    }
    assert all(math.isfinite(value) for row in table.values() for value in row.values())
    return table


def test_the_loop_runs_in_every_way_and_a_tick_is_divided_among_its_nodes():
    whole, *parts = map(values, loop.run(blocks=1, duration_s=1.0).values())
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
    (rows,) = map(values, latency.run(puts=10).values())
    assert len(rows) == 3
    assert [row["lost"] for row in rows.values()] == [0, 0, 0]
    assert all(0.0 < row["median ms"] <= row["max ms"] for row in rows.values())


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
