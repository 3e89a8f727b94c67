"""The cost of several robots is measured by robot."""

import pytest
from mecazen_bench import robots


def test_a_robot_costs_twice_as_much_where_the_world_costs_the_square(monkeypatch, figures):
    spent_s = 0.0

    class Quadratic:
        def __init__(self, *_): ...

        def advance(self, commands, _):
            nonlocal spent_s
            spent_s += 1e-3 * len(commands) ** 2

    monkeypatch.setattr(robots, "Simulation", Quadratic)
    monkeypatch.setattr(robots.time, "thread_time", lambda: spent_s)
    rows = figures(robots.run(blocks=1)).values()
    # differences of a clock that has run for seconds: roundings
    assert [row["µs/robot and tick"].value for row in rows] == pytest.approx(
        [1e3, 2e3, 4e3, 8e3, 64e3, 2e3, 16e3], rel=1e-9
    )
    assert [row["relative to one robot"].value for row in rows] == pytest.approx(
        [1.0, 2.0, 4.0, 8.0, 64.0, 2.0, 16.0], rel=1e-9
    )


def test_robots_apart_two_that_push_and_a_crowd_are_measured(monkeypatch, figures):
    monkeypatch.setattr(robots, "COUNTS", (1, 2))
    assert list(figures(robots.run(blocks=1))) == [
        *("1 apart", "2 apart", "2 head on", "16 in a crowd")
    ]
