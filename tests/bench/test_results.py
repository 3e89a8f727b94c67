"""Figures, the file that keeps them, two files beside each other, and the document's tables."""

import re
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from mecazen.errors import MecazenError
from mecazen_bench import benchmarks, machine, results
from mecazen_bench.benchmarks import BENCHMARKS, Benchmark, measure
from mecazen_bench.compare import Change, compare, notes
from mecazen_bench.figures import Better, Figure, Group, Row, Target, merged
from mecazen_bench.machine import Machine, OtherLoad, Others
from mecazen_bench.results import Measured, Results, ResultsError, updated
from mecazen_tools.cli.app import app
from typer.testing import CliRunner

MACHINE = Machine("Some(R) CPU(TM) i7 @ 2.60GHz", 2, "6.1", "3.11.7", {"numpy": "2.4.6"})
OTHERS = OtherLoad((0.5, 0.25, 0.125), 0.25)


def result(value: float, better: Better = "less", spread: float = 0.0, **more: Figure) -> Results:
    """Results of one figure, and others."""
    quartiles = (value - spread / 2, value + spread / 2)
    row = Row("nexus", {"µs/step": Figure(value, better, quartiles), **more})
    groups = (Group("Physics", "so", (row,)),)
    return Results(results.SCHEMA, MACHINE, OTHERS, {"physics": Measured(2.0, groups)})


def change(before: Results, after: Results) -> Change:
    (found,) = compare(before, after)
    return found


@pytest.mark.parametrize(
    ("target", "good", "bad", "better", "text"),
    [
        (Target(low=12.0), 12.0, 11.9, "more", "≥ 12"),
        (Target(high=0.1), 0.05, 0.11, "less", "< 0.1"),
        (Target(0.965, 1.035), 0.97, 1.036, 1.0, "1 ± 0.035"),
    ],
)
def test_a_figure_is_compared_with_its_target(target, good, bad, better, text):
    assert Figure.of(good, target).met is True
    assert Figure.of(bad, target).met is False
    assert Figure.of(good, target).better == better
    assert Figure.of(good, "less").met is None
    assert Figure.of(good, target).texts()[2] == f"✓ {text}"


def test_rounds_become_medians_with_quartiles():
    rounds = [
        [Group("Loop", "so", (Row("a", {"ticks/s": Figure.of(value, "more")}),))]
        for value in (5.0, 1.0, 2.0, 4.0, 3.0)
    ]
    (group,) = merged(rounds)
    assert group.rows[0].figures["ticks/s"] == Figure(3.0, "more", (2.0, 4.0))
    assert group.how == "so; medians (quartiles) of 5 rounds"
    assert merged(rounds[:1]) == rounds[0]


def test_benchmarks_are_interleaved_until_each_has_had_its_rounds():
    order = []

    def benchmark(name, rounds):
        def run():
            order.append(name)
            figure = Figure.of(float(len(order)), "less")
            return [Group(name, "so", (Row("a", {"place": figure}),))]

        return Benchmark(run, rounds)

    reports = []
    found = measure({"a": benchmark("a", 3), "b": benchmark("b", 1)}, reports.append)
    assert order == ["a", "b", "a", "a"]
    assert reports[1] == "b, round 1 of 1"
    assert [group.rows[0].figures["place"].value for group in found.groups] == [3.0, 2.0]
    assert msgspec.json.decode(msgspec.json.encode(found), type=Results) == found


def test_what_takes_minutes_is_measured_on_request_only():
    some = {"quick": Benchmark(list), "slow": Benchmark(list, on_demand=True)}
    assert list(benchmarks.select([], some)) == ["quick"]
    assert list(benchmarks.select(["slow"], some)) == ["slow"]
    with pytest.raises(MecazenError, match="fast: no such benchmark; there are quick, slow"):
        benchmarks.select(["fast"], some)


def test_the_help_names_what_is_measured_on_request_only():
    shown = CliRunner().invoke(app, ["bench", "run", "--help"], env={"COLUMNS": "400"}).output
    names = re.search(r"take minutes: ([\w, ]+)\.", shown)
    on_demand = {name for name, benchmark in BENCHMARKS.items() if benchmark.on_demand}
    assert set(names[1].split(", ")) == on_demand


def test_results_read_back_as_they_were_written(tmp_path):
    path = tmp_path / "new" / "results.json"
    figures = {"gain": Figure.of(0.99, Target(0.99, 1.01)), "lost": Figure.of(0.0, 0.0)}
    written = result(80.0, spread=1.0, **figures)
    results.write(written, path)
    assert results.read(path) == written


def test_a_machine_is_named_by_its_processor_and_cores():
    assert MACHINE.name == "some-cpu-i7-2-cores"
    assert results.default_path(MACHINE.name, []).name == "some-cpu-i7-2-cores.json"
    assert results.default_path(MACHINE.name, ["a"]).name == "some-cpu-i7-2-cores-a.json"
    here = Machine.here()
    assert here.cores >= 1
    assert "dartpy" in here.libraries
    assert here.name.strip("-abcdefghijklmnopqrstuvwxyz0123456789") == ""


def test_the_load_of_others_is_that_of_the_machine_without_ours_and_our_childrens(monkeypatch):
    now_s, machine_s, own_s, child_s = 100.0, 50.0, 3.0, 1.0

    def cpu_times():
        others = dict.fromkeys(("nice", "system", "irq", "softirq", "steal"), machine_s / 10)
        return SimpleNamespace(user=machine_s / 2, **others)

    child = SimpleNamespace(cpu_times=lambda: (child_s, 0.0))
    process = SimpleNamespace(children=lambda recursive: [child] if recursive else [])
    monkeypatch.setattr(machine.psutil, "cpu_times", cpu_times)
    monkeypatch.setattr(machine.psutil, "Process", lambda: process)
    monkeypatch.setattr(machine.os, "times", lambda: (own_s, 0.0, 0.0, 0.0, now_s))
    monkeypatch.setattr(machine.time, "monotonic", lambda: now_s)
    others = Others()
    # in 10 s the machine is busy for 18 s, of which we take 9 s and our child 3 s
    now_s, machine_s, own_s, child_s = 110.0, 68.0, 12.0, 4.0
    found = others.so_far()
    assert found.cores == pytest.approx(0.6)
    assert str(found).endswith("other processes took 0.60 cores meanwhile")


@pytest.mark.parametrize(
    ("before", "after", "better", "verdict"),
    [
        (80.0, 90.0, "less", "worse"),
        (90.0, 80.0, "less", "better"),
        (700.0, 600.0, "more", "worse"),
        (600.0, 700.0, "more", "better"),
        (0.99, 1.04, 1.0, "worse"),
        (1.04, 0.99, 1.0, "better"),
        (0.98, 1.02, 1.0, ""),
        (0.0, 3.0, "less", "worse"),
        (1.0, 1.0005, "less", ""),
    ],
)
def test_a_change_is_judged_by_what_is_better_for_the_figure(before, after, better, verdict):
    assert change(result(before, better), result(after, better)).verdict == verdict


def test_a_change_within_the_spread_of_both_is_ignored():
    assert change(result(80.0, spread=5.0), result(89.0, spread=5.0)).verdict == ""
    assert change(result(80.0, spread=5.0), result(91.0, spread=5.0)).verdict == "worse"


def test_a_ratio_is_the_later_over_the_earlier():
    assert change(result(80.0), result(100.0)).ratio == 1.25
    assert change(result(0.0), result(1.0)).ratio is None


def test_figures_that_only_one_has_and_other_machines_are_noted():
    before = result(80.0, lost=Figure.of(1.0, "less"))
    other = msgspec.structs.replace(result(80.0), machine=Machine.here())
    assert len(compare(before, other)) == 1
    lines = notes(before, other)
    assert lines[0].startswith("different machines: Some(R) CPU(TM)")
    assert lines[1] == "1 figures are in only one of them: Physics"
    assert notes(before, before) == [f"{when}: {OTHERS}" for when in ("before", "after")]


def test_the_command_shows_ratios_and_ends_with_1_where_something_became_worse(tmp_path):
    paths = [str(tmp_path / name) for name in ("a.json", "b.json")]
    for path, value in zip(paths, (80.0, 100.0), strict=True):
        results.write(result(value), Path(path))
    worse = CliRunner().invoke(app, ["bench", "compare", *paths])
    assert worse.exit_code == 1
    assert "1.250" in worse.output
    assert "1 of 1 figures became worse" in worse.output
    better = CliRunner().invoke(app, ["bench", "compare", *reversed(paths)])
    assert better.exit_code == 0
    assert "0.800" in better.output


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file or directory"),
        (b"", "no results of mecazen bench"),
        (b"\xff\xfe", "no results of mecazen bench"),
        (b"[1, 2]", "no results of mecazen bench"),
        (b'{"a": 1}', "no results of mecazen bench"),
        (b'{"schema": "x"}', "no results of mecazen bench"),
        (b'{"schema": 1}', "schema 1 instead of 2"),
        (b'{"schema": 2}', "no results of mecazen bench: Object missing required field"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(content, reason, tmp_path):
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ResultsError, match=reason) as refused:
        results.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_or_results_without_a_common_figure_are_refused(tmp_path):
    with pytest.raises(ResultsError, match="Is a directory"):
        results.read(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(ResultsError, match="File exists"):
        results.write(result(1.0), tmp_path / "file" / "a.json")
    with pytest.raises(ResultsError, match="no figure is in both"):
        compare(result(1.0), msgspec.structs.replace(result(1.0), benchmarks={}))


def test_a_figure_that_a_row_lacks_is_an_empty_cell():
    one, two = Figure.of(12_345.6, "more"), Figure(0.25, "less", (0.2, 0.3), Target(0.9, 1.1))
    group = Group("T", "so", (Row("a", {"x": one, "y": two}), Row("b", {"y": two})))
    cell = "0.25 (0.2 to 0.3) ✗ 1 ± 0.1"
    assert group.markdown() == (
        "**T.** So.\n\n| | x | y |\n| --- | --- | --- |\n"
        f"| a | 12,346 | {cell} |\n| b | | {cell} |\n"
    )


def test_the_tables_of_the_document_are_those_of_the_results_files():
    text = results.DOCUMENT.read_text()
    assert results.BLOCK.search(text)
    assert updated(text) == text  # `mecazen bench tables` writes them


def test_a_block_holds_its_benchmark_from_its_own_file_or_the_main_one(tmp_path):
    def block(name):
        text = updated(f"a\n<!-- bench: {name} -->\nold\n<!-- /bench -->\nb", tmp_path)
        begin, end = f"a\n<!-- bench: {name} -->\n", "<!-- /bench -->\nb"
        assert text.startswith(begin)
        assert text.endswith(end)
        return text.removeprefix(begin).removesuffix(end)

    def write(value, *only):
        results.write(result(value), results.default_path(results.MACHINE, only, tmp_path))

    write(80.0)
    (group,) = result(80.0).groups
    assert block("physics") == group.markdown()
    assert block("machine") == f"{MACHINE};\n{OTHERS}.\n"
    assert block("flood") == "Not measured yet: `mecazen bench run --only flood`.\n"
    write(90.0, "physics")
    assert "| nexus | 90 |" in block("physics")
    assert str(OTHERS) in block("physics")
