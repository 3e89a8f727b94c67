"""Commands of another process are answered, and their latencies summarised."""

import pytest
from mecazen_bench import latency


def test_every_command_is_answered_and_its_latency_measured(figures):
    rows = figures(latency.run(puts=30))
    assert len(rows) == 4
    assert [row["lost"].value for row in rows.values()] == [0, 0, 0, 0]
    assert all(0.0 < row["median ms"].value <= row["max ms"].value for row in rows.values())


def test_latencies_are_summarised_in_ms_without_those_that_are_lost():
    found = latency.figures([number / 1e3 for number in range(101)] + [None, None])
    assert {title: figure.value for title, figure in found.items()} == pytest.approx(
        {"median ms": 50.0, "p99 ms": 99.0, "max ms": 100.0, "lost": 2}
    )
