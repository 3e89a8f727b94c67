"""The recorder's speed is measured, and that it loses nothing."""

from mecazen_bench import recorder


def test_the_recorder_loses_nothing_alone_or_as_a_process(figures):
    rows = figures(recorder.run(duration_s=1.0))
    assert len(rows) == 2
    assert all(row["messages/s"].value > 1.0 for row in rows.values())
    assert [row["lost"].value for row in rows.values() if "lost" in row] == [0.0]
