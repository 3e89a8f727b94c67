"""Where entities are in a recording."""

from mecazen_viewer import entities as e


def test_what_several_robots_have_is_below_their_names_and_what_they_share_is_not():
    assert e.of_robot(e.GOAL, "two") == "world/two/odom/goal"
    assert e.of_robot(e.DISTANCE, "two") == "plots/two/distance"
    assert e.of_robot(e.HEALTH, "two") == e.HEALTH
    assert e.of_robot(e.GOAL, "") == e.GOAL
