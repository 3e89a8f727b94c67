"""The commands of `mecazen bench`: which benchmarks there are, and what they print and write."""

from pathlib import Path

from mecazen_bench import harness
from mecazen_bench.cli import BENCHMARKS, ON_REQUEST, benchmark
from mecazen_bench.harness import Figure, Group, Results
from mecazen_tools.cli.app import app
from typer.testing import CliRunner


def result(value: float) -> Results:
    """Return results of one figure, which is the better the less it is."""
    groups = (Group("Physics", "so", {"nexus": {"µs/step": Figure(value, "less")}}),)
    return Results(harness.SCHEMA, "some machine", {"physics": groups})


def test_benchmarks_are_found_by_name_and_those_that_take_minutes_are_named_in_the_help():
    assert all(map(callable, map(benchmark, BENCHMARKS)))
    refused = CliRunner().invoke(app, ["bench", "run", "--only", "fast"])
    assert refused.exit_code != 0
    assert "fast: no such benchmark; there are physics, robots" in str(refused.exception)
    shown = CliRunner().invoke(app, ["bench", "run", "--help"], env={"COLUMNS": "400"}).output
    assert f"take minutes: {', '.join(ON_REQUEST)}." in shown


def test_a_run_prints_its_tables_and_writes_its_figures(monkeypatch, tmp_path):
    groups = list(result(80.0).benchmarks["physics"])
    monkeypatch.setattr("mecazen_bench.cli.benchmark", lambda name: lambda: groups)
    file = tmp_path / "new" / "out.json"
    done = CliRunner().invoke(app, ["bench", "run", "--only", "loop", "--json", str(file)])
    assert done.exit_code == 0
    assert "| nexus | 80 |" in done.output
    assert list(harness.read(file).benchmarks) == ["loop"]


def test_the_command_shows_ratios_and_ends_with_1_where_something_became_worse(tmp_path):
    paths = [str(tmp_path / name) for name in ("a.json", "b.json")]
    for path, value in zip(paths, (80.0, 100.0), strict=True):
        harness.write(result(value), Path(path))
    worse = CliRunner().invoke(app, ["bench", "compare", *paths])
    assert worse.exit_code == 1
    assert "| 1.250 | worse |" in worse.output
    assert "1 figures became worse" in worse.output
    better = CliRunner().invoke(app, ["bench", "compare", *reversed(paths)])
    assert better.exit_code == 0
    assert "0.800" in better.output
