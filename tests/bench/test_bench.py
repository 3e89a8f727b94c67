"""Each part of the bench gives finite and sane figures; how fast it is, is not tested."""

from __future__ import annotations

import io
import math

import msgspec
import pytest
from rich.console import Console

from bench import experiments, flood, latency, loop, malformed, physics, recorder, viewer
from bench.__main__ import Report
from bench.figures import Figure, Group, Target
from bench.machine import Machine
from bench.scenarios import robot

SECONDS = 0.001
"""The physics step."""


def figures(groups: list[Group]) -> dict[str, dict[str, Figure]]:
    """The figures of all groups by row; each is finite, and shown."""
    rows: dict[str, dict[str, Figure]] = {}
    for group in groups:
        console = Console(width=200, file=io.StringIO())
        with console.capture() as shown:
            console.print(group.table())
        for row in group.rows:
            assert all(math.isfinite(figure.value) for figure in row.figures.values())
            assert row.subject in shown.get()
            rows.setdefault(row.subject, {}).update(row.figures)
    return rows


@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_is_smooth_and_has_the_predicted_gains(name: str) -> None:
    groups = physics.run([physics.DartEngine(robot(name), SECONDS, "near")], repetitions=2)
    (row,) = figures(groups).values()
    accuracy = ["% of R", "forward", "lateral", "/ predicted", "yaw / predicted"]
    assert all(row[title].met for title in accuracy)
    assert 1.0 < row["µs/step"].value < 1e5
    assert row["× real time"].value == pytest.approx(1e3 / row["µs/step"].value, rel=0.5)


@pytest.mark.parametrize("shape", ["capsule", "mesh"])
def test_the_same_robot_drives_alike_in_mujoco(shape: str) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo, the bench's peer, is not installed")
    from bench.mujoco_peer import MujocoEngine

    engine = MujocoEngine(robot("nexus"), SECONDS, shape)  # type: ignore[arg-type]
    (row,) = figures(physics.run([engine], repetitions=2)).values()
    assert all(row[axis].value == pytest.approx(1.0, abs=0.1) for axis in ("forward", "lateral"))
    assert row["yaw"].value == pytest.approx(1.0, abs=0.1)
    assert 0.0 < row["ripple mm"].value < 3.0
    assert 1.0 < row["µs/step"].value < 1e5


def test_experiments_run_with_one_worker_and_with_two() -> None:
    one, two = figures(experiments.run(duration_s=0.5, repetitions=1)).values()
    assert one["runs/min"].value > 0.0
    assert two["120 runs, min"].value == pytest.approx(120 / two["runs/min"].value)


def test_the_loop_runs_in_all_three_ways() -> None:
    rows = figures(loop.run(duration_s=0.3, repetitions=1))
    assert len(rows) == 3
    for row in rows.values():
        assert row["ticks/s"].value == pytest.approx(100.0 * row["× real time"].value)
        assert row["ticks/s"].value > 1.0


def test_every_command_is_answered_in_real_time() -> None:
    (row,) = figures(latency.run(puts=30)).values()
    assert row["lost"].value == 0
    assert 0.01 < row["median ms"].value <= row["p99 ms"].value <= row["max ms"].value < 1000.0


def test_under_every_flood_ticks_are_answered() -> None:
    rows = figures(flood.run(window_s=1.0))
    assert list(rows) == list(flood.FLOODS)
    for name, row in rows.items():
        assert (row["puts/s"].value > 0.0) is ("quiet" not in name)
        assert 0.01 < row["median ms"].value <= row["p99 ms"].value < 10_000.0


def test_malformed_payloads_on_every_key_are_refused_and_change_no_trajectory() -> None:
    rows = figures(malformed.run(payloads=20_000, ticks=100))
    assert {*malformed.CALLS, "cmd_vel", "diagnostics/physics", "all"} < set(rows)
    assert rows["all"]["payloads"].value == 20_000
    assert all(row["not refused"].value == 0 for row in rows.values())
    assert rows["all"]["trajectories that differ"].value == 0


def test_the_recorder_loses_nothing_alone_or_as_a_process() -> None:
    rows = figures(recorder.run(duration_s=1.0, repetitions=1))
    assert len(rows) == 4
    for row in rows.values():
        assert row["messages/s"].value > 1.0
    assert [row["lost"].value for row in rows.values() if "lost" in row] == [0.0, 0.0]


def test_the_viewer_takes_some_processor_time_and_memory() -> None:
    service, server, both = figures(viewer.run(window_s=2.0)).values()
    for figure in ("% of a core", "MB"):
        # a server that nobody looks at may take less than the clock of the processor counts
        assert service[figure].value > 0.0
        assert server[figure].value >= 0.0
        total = service[figure].value + server[figure].value
        assert both[figure].value == pytest.approx(total)


@pytest.mark.parametrize(
    ("target", "good", "bad"),
    [
        (Target.at_least(12.0), 12.0, 11.9),
        (Target.below(0.1), 0.05, 0.11),
        (Target.around(1.0, 0.01), 0.995, 1.011),
    ],
)
def test_a_figure_is_held_against_its_target(target: Target, good: float, bad: float) -> None:
    assert Figure.of(good, target).met is True
    assert Figure.median([bad, bad, good], target).met is False
    assert target.text in Figure.of(good, target).cell()


def test_a_report_is_json_that_reads_back() -> None:
    report = Report(Machine.here(), (Group("title", "how", ()),))
    assert report.machine.cores >= 1
    assert "dartpy" in report.machine.libraries
    assert msgspec.json.decode(msgspec.json.encode(report), type=Report) == report
