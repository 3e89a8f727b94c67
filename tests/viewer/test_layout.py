"""Which views there are, of which robot."""

from typing import Any

from mecazen_viewer import entities as e
from mecazen_viewer.layout import application, blueprint
from mecazen_viewer.plots import LINES, TIME_LINES


def origins(part: Any) -> set[str]:
    """Where the views of a part of the layout begin."""
    if hasattr(part, "origin"):
        return {part.origin}
    return set().union(*(origins(child) for child in part.contents))


def test_the_layout_shows_every_plot_and_text_there_is():
    shown = origins(blueprint(("",)).root_container)
    assert {e.FOLLOW, e.HEALTH, e.LOG} <= shown
    for path in LINES | TIME_LINES:
        assert any(path == origin or path.startswith(f"{origin}/") for origin in shown)


def test_each_of_several_robots_has_a_tab_with_what_a_single_one_has():
    single = origins(blueprint(("",)).root_container)
    tabs = blueprint(("one", "two")).root_container.contents
    assert [tab.name for tab in tabs] == ["one", "two"]
    for tab in tabs:
        assert origins(tab) == {
            path if path == e.REAL_TIME else e.of_robot(path, tab.name) for path in single
        }
    # what a user has made of the layout of one is not taken for that of others
    assert len({application(robots) for robots in (("",), ("one",), ("one", "two"))}) == 3
