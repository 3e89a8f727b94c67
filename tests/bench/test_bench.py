"""Each part of the bench gives finite and sane figures; how fast it is, is not tested."""

from __future__ import annotations

import math

import pytest
from mecazen_bench import (
    experiments,
    flood,
    latency,
    malformed,
    physics,
    realtime,
    recorder,
    robots,
    viewer,
)
from mecazen_bench.figures import Figure, Group, named
from mecazen_bench.scenarios import robot

SECONDS = 0.001
"""The physics step."""


def figures(groups: list[Group]) -> dict[str, dict[str, Figure]]:
    """The figures of all groups by row; each is finite, and shown."""
    rows: dict[str, dict[str, Figure]] = {}
    shown = "".join(group.markdown() for group in groups)
    for (_, subject, title), figure in named(groups):
        assert math.isfinite(figure.value)
        assert f"| {subject} |" in shown
        rows.setdefault(subject, {})[title] = figure
    return rows


@pytest.mark.parametrize("rollers", physics.OURS)
@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_is_smooth_and_has_the_predicted_gains(name: str, rollers: str) -> None:
    engine = physics.DartEngine(robot(name), SECONDS, rollers)
    (row,) = figures([physics.measure("Physics", [engine], blocks=2)]).values()
    accuracy = ["ripple % of R", "forward", "lateral", "lateral / predicted", "yaw / predicted"]
    assert all(row[title].met for title in accuracy)
    # a smooth wheel loses nothing; that the rollers are hulls of spheres costs some percent
    assert -10.0 < row["energy %/s"].value < 0.5
    assert 1.0 < row["µs/step"].value < 1e5
    assert row["× real time"].value == pytest.approx(1e3 / row["µs/step"].value)


def test_experiments_run_with_one_worker_and_with_two() -> None:
    one, two = figures(experiments.run(duration_s=0.5)).values()
    assert one["runs/min"].value > 0.0
    assert two["120 runs, min"].value == pytest.approx(120 / two["runs/min"].value)


def test_every_command_is_answered_in_real_time() -> None:
    rows = figures(latency.run(puts=30))
    assert list(rows) == ["idle", latency.BUSY]
    for row in rows.values():
        assert row["lost"].value == 0
        assert 0.01 < row["median ms"].value <= row["p99 ms"].value <= row["max ms"].value < 1000.0


def test_a_stack_in_real_time_is_measured_part_by_part() -> None:
    rows = figures(realtime.run(window_s=1.0))
    parts = [name for name in rows if name != "all"]
    assert set(parts) == {"router", "physics", "controller", "target", "follower", "up"}
    for name in parts:
        assert rows[name]["MB"].value > 1.0
    total = sum(rows[name]["% of a core"].value for name in parts)
    assert 0.0 < total == pytest.approx(rows["all"]["% of a core"].value)


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
    rows = figures(recorder.run(duration_s=1.0))
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


def test_robots_apart_are_measured_beside_one_alone_and_two_that_push() -> None:
    rows = figures(robots.run(blocks=1))
    assert list(rows) == ["1 apart", "2 apart", "4 apart", "8 apart", "2 head on"]
    assert rows["1 apart"]["of one alone"].value == 1.0
    one = rows["1 apart"]["µs/robot and tick"].value
    for row in rows.values():
        assert row["of one alone"].value == pytest.approx(row["µs/robot and tick"].value / one)
