"""Commands of another process are answered, and their latencies summarised."""

import pytest
from mecazen_bench import latency


def test_commands_are_answered_before_the_next_tick_would_repeat_them(figures):
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
