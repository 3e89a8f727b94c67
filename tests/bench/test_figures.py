"""Figures, the file that keeps them, and two files beside each other."""

import pytest
from mecazen.errors import MecazenError
from mecazen_bench import harness, loop
from mecazen_bench.harness import Figure, ResultsError, tables
from mecazen_tools.cli.app import app
from typer.testing import CliRunner


def figure(value, goal="less", spread=0.0, column="µs/step"):
    ends = value - spread / 2, value + spread / 2
    return Figure("Physics", "nexus", column, value, *ends, goal)


def run(*words):
    return CliRunner().invoke(app, ["bench", *map(str, words)])


def test_rounds_become_medians_with_quartiles_and_are_interleaved():
    order, reports = [], []

    def benchmark(name):
        def measure():
            order.append(name)
            return {name: {"a": {"place": (float(len(order)), "less")}}}

        return measure

    figures = harness.measure({"a": benchmark("a"), "b": benchmark("b")}, 3, reports.append)
    assert order == ["a", "b"] * 3
    assert reports[1] == "b, round 1 of 3"
    assert figures[0] == Figure("a", "a", "place", 3.0, 2.0, 4.0, "less")


@pytest.mark.parametrize(
    ("before", "after", "goal", "spread", "expected"),
    [
        (80.0, 90.0, "less", 0.0, "worse"),
        (600.0, 700.0, "more", 0.0, "better"),
        (0.99, 1.04, "1", 0.0, "worse"),
        (0.98, 1.02, "1", 0.0, ""),
        (1.0, 1.0005, "less", 0.0, ""),
        (80.0, 89.0, "less", 5.0, ""),  # within the spread of both
        (80.0, 91.0, "less", 5.0, "worse"),
    ],
)
def test_a_change_is_judged_by_the_goal_of_the_figure(before, after, goal, spread, expected):
    table, worse = harness.compare([figure(before, goal, spread)], [figure(after, goal, spread)])
    assert table.splitlines()[2].split("|")[-2].strip() == expected
    assert worse == (expected == "worse")


def test_a_table_has_quartiles_and_empty_cells():
    both = Figure("T", "a", "y", 0.25, 0.2, 0.3, "1")
    figures = [Figure("T", "a", "x", 12_345.6, 12_345.6, 12_345.6, "more"), both]
    figures.append(Figure("T", "b", "y", 0.5, 0.5, 0.5, "1"))
    assert tables(figures) == {
        "T": "| | x | y |\n| --- | --- | --- |\n| a | 12,346 | 0.25 (0.2 to 0.3) |\n| b | | 0.5 |\n"
    }


def test_a_run_prints_its_tables_and_writes_its_figures(monkeypatch, tmp_path):
    monkeypatch.setattr(loop, "run", lambda: {"Loop": {"back": {"µs/tick": (80.0, "less")}}})
    file = tmp_path / "new" / "out.csv"
    done = run("run", "--only", "loop", "--csv", file)
    assert done.exit_code == 0
    assert "Loop\n\n| | µs/tick |\n| --- | --- |\n| back | 80 |\n" in done.output
    assert harness.read(file) == [Figure("Loop", "back", "µs/tick", 80.0, 80.0, 80.0, "less")]
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


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file or directory"),
        (b"\xff\xfe", "no results of mecazen bench"),
        (b"table,row\na,b\n", "no results of mecazen bench: Object missing required field"),
        (b"table,row,column,value,low,high,goal\na,b,c,much,1,1,less\n", "no results of mec"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(content, reason, tmp_path):
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ResultsError, match=reason) as refused:
        harness.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)
