"""The cost of ROS 2 is measured beside a run without it."""

import pytest
from mecazen_bench import ros2


def test_a_tick_is_measured_without_ros_2_and_with_subscribers_beside_that(figures):
    rows = figures(ros2.run(windows=1, window_s=0.3))
    assert list(rows) == ["without ROS 2", "0 subscribers", "5 subscribers"]
    without = rows["without ROS 2"]["µs/tick"].value
    for row in rows.values():  # of a single window, the median is that of the pair
        assert row["% more"].value == pytest.approx(100.0 * (row["µs/tick"].value / without - 1.0))
