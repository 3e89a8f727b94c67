"""The cost of ROS 2 is measured beside a run without it."""

from mecazen_bench import ros2


def test_subscribers_in_ros_2_cost_a_tick_something(figures):
    rows = figures(ros2.run(windows=1, window_s=0.3))
    assert list(rows) == ["without ROS 2", "0 subscribers", "5 subscribers"]
    assert rows["5 subscribers"]["% more"].value > 5.0
