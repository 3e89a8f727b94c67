"""Figures, the file that keeps them, and two files beside each other."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from mecazen_bench import machine, results
from mecazen_bench.compare import Change, compare, notes
from mecazen_bench.figures import Better, Figure, Group, Row, Target, merged
from mecazen_bench.machine import Machine, Others, OtherWork
from mecazen_bench.parts import PARTS, Part, measure
from mecazen_bench.results import Results, ResultsError
from mecazen_tools.cli.app import app
from typer.testing import CliRunner

MACHINE = Machine("Some(R) CPU(TM) i7 @ 2.60GHz", 2, "6.1", "3.11.7", {"numpy": "2.4.6"})
OTHERS = OtherWork((0.5, 0.25, 0.125), 0.25, {"cc1plus": 0.2})


def result(value: float, better: Better = "less", spread: float = 0.0, **others: Figure) -> Results:
    """Results of one figure, and others."""
    quartiles = (value - spread / 2, value + spread / 2)
    row = Row("nexus", {"µs/step": Figure(value, better, quartiles), **others})
    return Results(1, MACHINE, OTHERS, {"physics": 2.0}, (Group("Physics", "so", (row,)),))


def change(before: Results, after: Results) -> Change:
    (found,) = compare(before, after)
    return found


@pytest.mark.parametrize(
    ("target", "good", "bad", "better"),
    [
        (Target.at_least(12.0), 12.0, 11.9, "more"),
        (Target.below(0.1), 0.05, 0.11, "less"),
        (Target.around(1.0, 0.01), 0.995, 1.011, 1.0),
    ],
)
def test_a_figure_is_held_against_its_target(
    target: Target, good: float, bad: float, better: Better
) -> None:
    assert Figure.of(good, target).met is True
    assert Figure.of(bad, target).met is False
    assert Figure.of(good, target).better == better
    assert Figure.of(good, "less").met is None
    assert target.text in Figure.of(good, target).texts()[2]


def test_rounds_become_medians_with_quartiles() -> None:
    rounds = [
        [Group("Loop", "so", (Row("a", {"ticks/s": Figure.of(value, "more")}),))]
        for value in (5.0, 1.0, 2.0, 4.0, 3.0)
    ]
    (group,) = merged(rounds)
    assert group.rows[0].figures["ticks/s"] == Figure(3.0, "more", (2.0, 4.0))
    assert group.how == "so; medians (quartiles) of 5 rounds"
    assert merged(rounds[:1]) == rounds[0]


def test_parts_take_turns_until_each_has_had_its_rounds() -> None:
    turns: list[str] = []

    def part(name: str, rounds: int) -> Part:
        def run() -> list[Group]:
            turns.append(name)
            figure = Figure.of(float(len(turns)), "less")
            return [Group(name, "so", (Row("a", {"turn": figure}),))]

        return Part(run, rounds)

    told: list[str] = []
    found = measure({"a": part("a", 3), "b": part("b", 1)}, told.append)
    assert turns == ["a", "b", "a", "a"]
    assert told[1] == "b, round 1 of 1"
    assert [group.rows[0].figures["turn"].value for group in found.groups] == [3.0, 2.0]
    assert list(found.seconds) == ["a", "b"]
    assert msgspec.json.decode(msgspec.json.encode(found), type=Results) == found


def test_a_whole_bench_leaves_out_what_takes_minutes() -> None:
    assert [name for name, part in PARTS.items() if not part.on_demand] == [
        "physics",
        "robots",
        "loop",
        "latency",
        "realtime",
        "recorder",
        "viewer",
    ]


def test_results_read_back_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.json"
    figures = {"gain": Figure.of(0.99, Target.around(1.0, 0.01)), "lost": Figure.of(0.0, 0.0)}
    written = result(80.0, spread=1.0, **figures)
    results.write(written, path)
    assert results.read(path) == written


def test_results_of_the_reference_machine_can_be_read() -> None:
    for path in results.FOLDER.glob("*.json"):
        assert results.read(path).groups


def test_a_machine_is_named_by_its_processor_and_cores() -> None:
    assert MACHINE.name == "some-cpu-i7-2-cores"
    assert results.default_path(MACHINE, []).name == "some-cpu-i7-2-cores.json"
    assert results.default_path(MACHINE, ["peers"]).name == "some-cpu-i7-2-cores-peers.json"
    here = Machine.here()
    assert here.cores >= 1
    assert "dartpy" in here.libraries
    assert here.name.strip("-abcdefghijklmnopqrstuvwxyz0123456789") == ""


def test_what_others_do_is_seen_and_what_we_do_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, all_s = 100.0, 50.0
    spent = {(7, "make", 5.0): 1.0, (8, "cc1plus", 6.0): 2.0, (os.getpid(), "we", 7.0): 3.0}

    def processes(_: list[str]) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(
                pid=pid,
                info={
                    "name": name,
                    "create_time": begin,
                    "cpu_times": SimpleNamespace(user=seconds, system=0.0),
                },
            )
            for (pid, name, begin), seconds in spent.items()
        ]

    monkeypatch.setattr(machine.psutil, "process_iter", processes)
    monkeypatch.setattr(machine.time, "monotonic", lambda: now_s)
    monkeypatch.setattr(machine, "_processor_s", lambda: all_s)
    others = Others()
    # in 10 s: cc1plus 3 s and ends; another of it 2 s; make next to nothing; we a lot
    now_s, all_s = 110.0, 56.0
    spent |= {(8, "cc1plus", 6.0): 5.0, (os.getpid(), "we", 7.0): 12.0, (7, "make", 5.0): 1.01}
    others.look()
    del spent[8, "cc1plus", 6.0]
    spent[9, "cc1plus", 105.0] = 2.0
    work = others.work()
    assert work.cores == pytest.approx(0.6)
    assert work.busiest == pytest.approx({"cc1plus": 0.5})
    assert work.text().endswith("meanwhile others took 0.60 cores: cc1plus 0.50")


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
def test_a_change_is_judged_by_what_is_better_for_the_figure(
    before: float, after: float, better: Better, verdict: str
) -> None:
    assert change(result(before, better), result(after, better)).verdict == verdict


def test_a_change_within_the_spread_of_both_is_none() -> None:
    assert change(result(80.0, spread=5.0), result(89.0, spread=5.0)).verdict == ""
    assert change(result(80.0, spread=5.0), result(91.0, spread=5.0)).verdict == "worse"


def test_a_ratio_is_the_later_over_the_earlier() -> None:
    assert change(result(80.0), result(100.0)).ratio == 1.25
    assert change(result(0.0), result(1.0)).ratio is None


def test_figures_that_only_one_has_and_other_machines_are_told() -> None:
    before = result(80.0, lost=Figure.of(1.0, "less"))
    other = msgspec.structs.replace(result(80.0), machine=Machine.here())
    assert len(compare(before, other)) == 1
    lines = notes(before, other)
    assert lines[0].startswith("different machines: Some(R) CPU(TM)")
    assert lines[1] == "1 figures are in one of them only: Physics"
    assert notes(before, before) == [f"{when}: {OTHERS.text()}" for when in ("before", "after")]


def test_the_command_shows_ratios_and_ends_with_1_where_something_became_worse(
    tmp_path: Path,
) -> None:
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


def test_results_are_printed_as_a_documents_tables(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    gain = Figure.of(0.9991, Target.around(1.0, 0.01))
    results.write(result(80.0, spread=2.0, gain=gain), path)
    shown = CliRunner().invoke(app, ["bench", "markdown", str(path)])
    assert shown.exit_code == 0
    assert "### Physics\n\n| | µs/step | gain |\n| --- | --- | --- |\n" in shown.output
    assert "| nexus | 80 (79 to 81) | 0.9991 ✓ 1 ± 0.01 |\n\nSo.\n" in shown.output


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file or directory"),
        (b"", "no results of mecazen bench"),
        (b"\xff\xfe", "no results of mecazen bench"),
        (b"[1, 2]", "no results of mecazen bench"),
        (b'{"a": 1}', "no results of mecazen bench"),
        (b'{"schema": "x"}', "no results of mecazen bench"),
        (b'{"schema": 2}', "results of schema 2, not of 1"),
        (b'{"schema": 1}', "no results of mecazen bench: Object missing required field"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(
    content: bytes | None, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ResultsError, match=reason) as refused:
        results.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_or_results_without_a_common_figure_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="Is a directory"):
        results.read(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(ResultsError, match=r"a\.json: .+"):
        results.write(result(1.0), tmp_path / "file" / "a.json")
    with pytest.raises(ResultsError, match="no figure is in both"):
        compare(result(1.0), msgspec.structs.replace(result(1.0), groups=()))


def test_an_unknown_part_is_refused() -> None:
    from mecazen.errors import MecazenError

    done = CliRunner().invoke(app, ["bench", "run", "--only", "speed"])
    assert isinstance(done.exception, MecazenError)
    assert "no such part; there are physics, robots, loop" in str(done.exception)
    assert json.dumps(str(done.exception)).count("\\n") == 0


def test_a_figure_that_a_row_lacks_is_an_empty_cell() -> None:
    one, two = Figure.of(12_345.6, "more"), Figure.of(0.25, "less")
    group = Group("T", "so", (Row("a", {"x": one, "y": two}), Row("b", {"x": two})))
    assert "| a | 12,346 | 0.25 |\n| b | 0.25 | |\n" in group.markdown()
