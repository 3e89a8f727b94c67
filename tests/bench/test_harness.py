"""Figures, the file that keeps them, and two files beside each other."""

import msgspec
import pytest
from mecazen_bench import harness
from mecazen_bench.harness import Figure, Goal, Group, MarkdownTable, Results, ResultsError


def result(value: float, goal: Goal = "less", spread: float = 0.0, **more: Figure) -> Results:
    """Results of one figure, and others."""
    quartiles = (value - spread / 2, value + spread / 2)
    rows = {"nexus": {"µs/step": Figure(value, goal, quartiles), **more}}
    groups = (Group("Physics", "so", rows),)
    return Results(harness.SCHEMA, "some machine", {"physics": groups})


@pytest.mark.parametrize(
    ("goal", "good", "bad", "text"),
    [
        ((12.0, None), 12.0, 11.9, "≥ 12"),
        ((None, 0.1), 0.05, 0.11, "< 0.1"),
        ((0.965, 1.035), 0.97, 1.036, "1 ± 0.035"),
    ],
)
def test_a_figure_is_compared_with_its_target(goal, good, bad, text):
    assert Figure(good, goal).met is True
    assert Figure(bad, goal).met is False
    assert str(Figure(good, goal)) == f"{good:g} ✓ {text}"
    assert Figure(good, "less").met is None


def test_a_target_is_met_only_by_the_whole_interval():
    assert Figure(1.0, (None, 1.1), (0.9, 1.1)).met is True
    assert Figure(1.0, (None, 1.1), (0.9, 1.2)).met is False
    assert Figure(1.0, (0.95, None), (0.9, 1.2)).met is False


def test_rounds_become_medians_with_quartiles_and_are_interleaved():
    order, reports = [], []

    def run(name):
        def measure():
            order.append(name)
            return [Group(name, "so", {"a": {"place": Figure(float(len(order)), "less")}})]

        return measure

    found = harness.measure({"a": run("a"), "b": run("b")}, 3, reports.append)
    assert order == ["a", "b"] * 3
    assert reports[1] == "b, round 1 of 3"
    (group,) = found.benchmarks["a"]
    assert group.rows["a"]["place"] == Figure(3.0, "less", (2.0, 4.0))
    assert group.how == "so; medians (quartiles) of 3 rounds"
    (once,) = harness.measure({"a": run("a")}, 1, reports.append).benchmarks["a"]
    assert once.how == "so"


@pytest.mark.parametrize(
    ("before", "after", "goal", "spread", "expected"),
    [
        (80.0, 90.0, "less", 0.0, "worse"),
        (90.0, 80.0, (None, 70.0), 0.0, "better"),
        (700.0, 600.0, "more", 0.0, "worse"),
        (600.0, 700.0, (1000.0, None), 0.0, "better"),
        (0.99, 1.04, 1.0, 0.0, "worse"),
        (1.04, 0.99, (0.9, 1.1), 0.0, "better"),
        (0.98, 1.02, 1.0, 0.0, ""),
        (0.0, 3.0, "less", 0.0, "worse"),
        (1.0, 1.0005, "less", 0.0, ""),
        (80.0, 89.0, "less", 5.0, ""),  # within the spread of both
        (80.0, 91.0, "less", 5.0, "worse"),
    ],
)
def test_a_change_is_judged_by_the_goal_of_the_figure(before, after, goal, spread, expected):
    table, _ = harness.compare(result(before, goal, spread), result(after, goal, spread))
    verdict = table.splitlines()[2].split(" | ")[-1].removesuffix(" |").strip("| ")
    assert verdict == expected


def test_only_figures_that_both_have_are_compared():
    one, more = result(80.0), result(80.0, lost=Figure(1.0, "less"))
    assert len(harness.compare(one, more)[0].splitlines()) == 3
    with pytest.raises(ResultsError, match="no figure is in both"):
        harness.compare(one, msgspec.structs.replace(one, benchmarks={}))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file or directory"),
        (b"\xff\xfe", "no results of mecazen bench"),
        (b'{"schema": 3}', "no results of mecazen bench: Object missing required field"),
        (b'{"schema": 1, "context": "", "benchmarks": {}}', "schema 1 instead of 3"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(content, reason, tmp_path):
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ResultsError, match=reason) as refused:
        harness.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_in_the_place_of_a_folder_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ResultsError, match="File exists"):
        harness.write(result(1.0), tmp_path / "file" / "a.json")


def test_a_figure_that_a_row_lacks_is_an_empty_cell():
    one, two = Figure(12_345.6, "more"), Figure(0.25, (0.9, 1.1), (0.2, 0.3))
    group = Group("T", "so", {"a": {"x": one, "y": two}, "b": {"y": two}})
    cell = "0.25 (0.2 to 0.3) ✗ 1 ± 0.1"
    assert str(group.table()) == (
        "**T.** So.\n\n| | x | y |\n| --- | --- | --- |\n"
        f"| a | 12,346 | {cell} |\n| b | | {cell} |\n"
    )


def test_a_table_begins_with_its_title_and_the_sentences_of_its_caption():
    table = MarkdownTable("Loop", "means; µs/tick: of one core", ("a", "b"), (("", "1"),))
    assert str(table) == (
        "**Loop.** Means. µs/tick: of one core.\n\n| a | b |\n| --- | --- |\n| | 1 |\n"
    )
    assert str(MarkdownTable("", "so", ("a",), ())) == "So.\n\n| a |\n| --- |\n"
