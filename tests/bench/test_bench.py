"""Each benchmark gives finite and plausible figures; how fast it is, is not tested."""

import math

import pytest
from mecazen_bench import (
    experiments,
    flood,
    intruder,
    latency,
    malformed,
    physics,
    realtime,
    recorder,
    robots,
    ros2,
    ros2_loop,
)
from mecazen_bench.figures import Figure, Group, named
from mecazen_bench.stack import robot

STEP_S = 0.001


def figures(groups: list[Group]) -> dict[str, dict[str, Figure]]:
    """The figures of all groups by row; each is finite, and shown."""
    rows: dict[str, dict[str, Figure]] = {}
    shown = "".join(group.markdown() for group in groups)
    for (_, subject, title), figure in named(groups):
        assert math.isfinite(figure.value)
        assert f"| {subject} |" in shown
        rows.setdefault(subject, {})[title] = figure
    return rows


@pytest.mark.parametrize("rollers", physics.ROLLERS)
@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_is_smooth_and_has_the_predicted_gains(name, rollers):
    engine = physics.DartEngine(robot(name), STEP_S, rollers)
    (row,) = figures([physics.measure("Physics", [engine], blocks=2)]).values()
    accuracy = ["ripple % of R", "forward", "lateral", "lateral / predicted", "yaw / predicted"]
    assert all(row[title].met for title in accuracy)
    # a smooth wheel loses nothing; rollers that are hulls of spheres cost some percent
    assert -10.0 < row["energy %/s"].value < 0.5


def test_experiments_run_with_one_worker_and_with_two_also_of_dask(monkeypatch):
    monkeypatch.setattr(experiments, "NOTHINGS", 60)
    groups = experiments.run(duration_s=0.5)
    one, two, _, dask = figures(groups[:1]).values()
    assert one["runs/min"].value > 0.0
    assert "120 runs, min" in two.keys() - one.keys()
    assert dask["runs/min"].value > 0.0
    assert dask["scheduler ms/run"].value > 0.0
    assert 0.0 < dask["modelled: 100 workers' efficiency"].value <= 1.0
    *parts, whole = figures(groups[1:]).items()
    assert {"scenario loaded", "physics", "follower", "scores"} <= {name for name, _ in parts}
    assert sum(part["ms"].value for _, part in parts) == pytest.approx(whole[1]["ms"].value)
    assert sum(part["% of the run"].value for _, part in parts) == pytest.approx(100.0)


def test_commands_are_answered_before_the_next_tick_would_repeat_them():
    rows = figures(latency.run(puts=30))
    assert len(rows) == 4
    assert [row["lost"].value for row in rows.values()] == [0, 0, 0, 0]
    # puts are at random phases of a tick of 10 ms: the tick alone would take 5 ms in the median
    assert rows["idle"]["median ms"].value < 5.0


def test_latencies_are_summarised_in_ms_without_those_that_are_lost():
    found = latency.figures([number / 1e3 for number in range(101)] + [None, None])
    assert {title: figure.value for title, figure in found.items()} == pytest.approx(
        {"median ms": 50.0, "p99 ms": 99.0, "max ms": 100.0, "lost": 2}
    )


def test_a_stack_in_real_time_is_measured_by_process():
    rows = figures(realtime.run(window_s=1.0))
    services = ["physics", "controller", "target", "follower"]
    assert sorted(rows) == sorted(["router", *services, "parent", "up", "all", "mecazen up"])
    for name in services:
        assert rows[name]["% of a core"].value > 0.0
        assert rows[name]["MB"].value > 1.0


def test_under_every_flood_ticks_are_answered():
    rows = figures(flood.run(window_s=1.0))
    assert list(rows) == list(flood.FLOODS)
    for name, row in rows.items():
        assert (row["puts/s"].value > 0.0) is ("quiet" not in name)


def test_malformed_payloads_on_every_key_are_refused_and_change_no_trajectory():
    rows = figures(malformed.run(payloads=20_000, ticks=100))
    assert {*malformed.CALLS, "cmd_vel", "diagnostics/physics", "all"} < set(rows)
    assert rows["all"]["payloads"].value == 20_000
    assert all(row["not refused"].value == 0 for row in rows.values())
    assert rows["all"]["trajectories that differ"].value == 0


def test_an_intruder_changes_nothing_in_an_open_and_in_a_secured_stack():
    rows = figures([intruder.run(4_000, ticks=100)])
    assert list(rows) == ["open stack", "secured stack"]
    for row in rows.values():
        assert row["payloads"].value == 4_000
        for nothing in ("trajectories that differ", "crashes", "tools not answered"):
            assert row[nothing].value == 0


def test_the_recorder_loses_nothing_alone_or_as_a_process():
    rows = figures(recorder.run(duration_s=1.0))
    assert len(rows) == 4
    for row in rows.values():
        assert row["messages/s"].value > 1.0
    assert [row["lost"].value for row in rows.values() if "lost" in row] == [0.0, 0.0]


def test_messages_for_ros_are_timed_in_each_way():
    rows = figures(ros2.run(repeats=2))
    assert len(rows) == 4 * 3
    assert all(min(row["write µs"].value, row["read µs"].value) > 0.0 for row in rows.values())


def test_ros_2_costs_a_tick_something_and_its_commands_are_answered():
    puts = 10
    rows = figures(ros2_loop.run(puts=puts, windows=1, window_s=0.3))
    assert list(rows) == ["without ROS 2", "0 subscribers", "5 subscribers", "plain", "from ROS 2"]
    # on a busy machine a command may come too late for its tick: that is a figure, no failure
    assert all(0 <= rows[way]["lost"].value < puts for way in ("plain", "from ROS 2"))
    assert rows["5 subscribers"]["µs/tick"].value > 0.0


def test_the_viewer_takes_some_processor_time_and_memory():
    service, server, _ = figures(realtime.run_viewer(window_s=2.0)).values()
    # a server without a browser may take less than the resolution of the processor's clock
    assert service["% of a core"].value > 0.0
    assert min(service["MB"].value, server["MB"].value) > 1.0


def test_robots_apart_two_that_push_and_a_crowd_are_measured():
    assert len(figures(robots.run(blocks=1))) == len(robots.COUNTS) + 2


def test_a_robot_costs_twice_as_much_where_the_world_costs_the_square(monkeypatch):
    spent_s = 0.0

    class Quadratic:
        def __init__(self, *_): ...

        def advance(self, commands, _):
            nonlocal spent_s
            spent_s += 1e-3 * len(commands) ** 2

    monkeypatch.setattr(robots, "World", Quadratic)
    monkeypatch.setattr(robots.time, "thread_time", lambda: spent_s)
    rows = figures(robots.run(blocks=1))
    # differences of a clock that has run for seconds: roundings
    assert [row["µs/robot and tick"].value for row in rows.values()] == pytest.approx(
        [1e3, 2e3, 4e3, 8e3, 64e3, 2e3, 16e3], rel=1e-9
    )
    assert [row["relative to one robot"].value for row in rows.values()] == pytest.approx(
        [1.0, 2.0, 4.0, 8.0, 64.0, 2.0, 16.0], rel=1e-9
    )
