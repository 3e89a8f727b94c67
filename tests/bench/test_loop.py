"""The loop of the bench runs in every way, and a tick's time is divided into its parts."""

import itertools
import time

import pytest
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.loading import load_scenario
from mecazen.messages import Clock
from mecazen.wire import Stamp
from mecazen_bench import hops, loop, safety, senses
from mecazen_bench.loop import BUS, Stopwatch, TimedBus

PARTS = ["physics", "controller", "target", "follower", "trajectory", BUS]


def test_the_loop_runs_in_all_ways_and_a_tick_has_all_its_parts():
    ways, parts = loop.run(duration_s=1.0)
    assert len(ways.rows) == 6
    for row in ways.rows[4:]:  # with the work of a process beside them, whatever passes bytes on
        assert row.figures["ticks/s"].value > 1.0
        assert 0.0 < row.figures["of one process"].value < 1.0
    for row in ways.rows[:4]:
        assert row.figures["ticks/s"].value == pytest.approx(
            100.0 * row.figures["× real time"].value
        )
        assert row.figures["ticks/s"].value > 1.0

    *each, everything = parts.rows
    assert [row.subject for row in each] == PARTS
    costs = [row.figures["µs/tick"].value for row in each]
    shares = [row.figures["% of the tick"].value for row in each]
    assert min(costs) > 0.0
    assert sum(costs) == pytest.approx(everything.figures["µs/tick"].value)
    assert sum(shares) == pytest.approx(100.0)
    unbounded = [row.subject for row in each if row.figures["% of the tick"].target is None]
    assert unbounded == ["physics", "follower"]


def test_time_is_that_of_the_part_at_work_and_publishing_is_the_bus_s(monkeypatch):
    clock = itertools.count()
    monkeypatch.setattr(time, "perf_counter_ns", lambda: next(clock))
    local, watch = LocalBus(), Stopwatch()  # at 0, as the bus
    sender, taker = (TimedBus(local, watch, part) for part in ("sender", "taker"))
    publisher = sender.publisher(keys.CLOCK)
    taker.subscribe(keys.CLOCK, lambda *_: watch.turn_to("inner"))
    watch.turn_to("sender")  # 1
    publisher.put(Clock(), Stamp(0, 0, 0))  # the bus from 2 to 3
    local.spin()  # taker from 4, inner from 5, the bus from 6
    watch.turn_to(BUS)  # 7
    assert watch.ns == {BUS: 1 + 1 + 1, "sender": 1 + 1, "taker": 1, "inner": 1}


def test_each_kind_of_sensor_has_its_share_of_the_loop_with_the_pose():
    kinds, parts = senses.run(duration_s=1.0)
    assert [row.subject for row in kinds.rows] == ["pose", "body", "legs", "fused"]
    assert kinds.rows[0].figures["of pose"].value == 1.0
    assert "sensors" in {row.subject for row in parts.rows}


def test_guard_and_planner_share_what_they_take_of_a_core():
    (group,) = safety.run(duration_s=2.0)
    guard, planner, both = (row.figures["% of a core"].value for row in group.rows)
    assert min(guard, planner) > 0.0
    assert both == pytest.approx(guard + planner)


def test_processes_that_pass_bytes_on_do_so_as_the_nodes_of_the_scenario_do():
    first, *others = hops.relays_of(load_scenario(loop.PATH))
    assert [relay.inputs for relay in first] == [("joint_command", "target/odom")]
    assert [set(relay.outputs) for relays in others for relay in relays] == [
        {"odom"},
        {"joint_command"},
        {"target/odom"},
        {"follower/state", "cmd_vel"},
    ]
    assert min(min(r.outputs.values()) for rs in (first, *others) for r in rs) > 50  # of JSON
