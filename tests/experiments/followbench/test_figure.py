"""The figure: the published success rates, and a line for each follower."""

from mecazen_experiments.followbench.figure import _published, draw
from mecazen_experiments.report import Row
from mecazen_experiments.statistics import Interval


def test_the_published_rates_are_those_of_their_figure_by_number_of_people():
    points = dict(_published("SFM", "back"))
    assert (points[5], points[20], points[30]) == (84.9, 46.6, 31.9)
    assert sorted(points) == list(points)


def test_a_figure_is_written_with_a_line_for_each_follower(tmp_path):
    rows = [
        Row(
            name,
            {"sr": Interval(80.0, 60.0, 90.0, 20)},
            labels={"follower": name, "open, place": place, "density": f"{people} people"},
        )
        for name in ("ours", "social")
        for place in ("back", "left_side")
        for people in (5, 30)
    ]
    png, svg = draw(rows, tmp_path)
    assert png.stat().st_size
    assert ">ours<" in svg.read_text()
