"""`mecazen people import`: a scenario from recordings of several people, and what is refused."""

import math

import pytest
from harness import here
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen_people.paths import make_path


@pytest.fixture
def people_import(tmp_path):
    """Import a text; return the scenario or the error."""

    def run(text, *arguments):
        (tmp_path / "hall.txt").write_text(text)
        file = tmp_path / "out.toml"
        done = here("people", "import", tmp_path / "hall.txt", "-o", file, *arguments)
        return done.stderr if done.returncode else load_scenario(file)

    return run


# at 2.5 Hz: 7 goes east at 1 m/s from the third sample on, 12 goes north at 0.5 m/s all the time
SAMPLES = [
    sample
    for n in range(21)
    for sample in [(n, "12", 5.0, 0.2 * n), *([(n, "7", 1.0 + 0.4 * n, -2.0)] if n >= 2 else [])]
]
FORMATS = {
    "obsmat": "".join(f" {780 + 6 * n:.7e} {i} {x} 0.0 {y} 0 0 0\n" for n, i, x, y in SAMPLES),
    "text": "".join(f"{780 + 10 * n}.0\t{i}.0\t{x}\t{y}\n" for n, i, x, y in SAMPLES),
    "csv": "id,time,x,y\n" + "".join(f"{i},{50 + 0.4 * n},{x},{y}\n" for n, i, x, y in SAMPLES),
    "units": "t_s,y_m,x_m,id\n" + "".join(f"{0.4 * n},{y},{x},{i}\n" for n, i, x, y in SAMPLES),
}


@pytest.mark.parametrize("name", FORMATS)
def test_imported_people_keep_places_and_times(name, people_import):
    scenario = people_import(FORMATS[name], "--target", "12")
    (walker,) = scenario.crowd.walkers
    assert walker.enters_and_leaves
    north, east = make_path(scenario.target.path), make_path(walker.path)
    assert scenario.sim.duration_s == pytest.approx(8.0)
    assert (walker.path.start_after_s, east.duration) == pytest.approx((0.8, 8.0))
    for t in (0.9, 4.0, 7.9):
        assert north.at(t).pose == pytest.approx((5.0, 0.5 * t, math.pi / 2), abs=1e-3)
        assert east.at(t).pose == pytest.approx((1.0 + t, -2.0, 0.0), abs=1e-3)
    assert scenario.start.pose == pytest.approx(Pose2D(5.0, -1.2, math.pi / 2), abs=1e-3)
    assert scenario.sensor.kind == "fused"
    assert "crowd" in scenario.services


def test_farthest_walk_is_followed(people_import):
    gone = "".join(f"bob,{t / 10},{t},0\n" for t in range(3))
    scenario = people_import(f"{FORMATS['csv']}{gone}")
    assert scenario.target.path.start_after_s == 0.0
    (walker,) = scenario.crowd.walkers  # those of the time of the walk
    assert (walker.path.x_m, walker.path.y_m) == pytest.approx((5.0, 0.4))
    assert "out.toml: exists already, and is not overwritten" in people_import(FORMATS["csv"])


@pytest.mark.parametrize(
    ("text", "arguments", "expected"),
    [
        ("", (), "hall.txt: no person has two samples"),
        ("1 1 2\n", (), "line 1: must name the columns time, x, y, and"),
        ("1 1 0 0\n\n2 1 0\n", (), "line 3: must have 4 columns, has 3"),
        ("1 1 0 0\n2 1 0 ?\n", (), "line 2: y must be a number from -1e9 to 1e9, is '?'"),
        ("9 1 0 0\n9 1 1 1\n", (), "line 2: frame of person 1 must grow by at least"),
        ("id,time,x,y\n../a,0,0,0\n", (), "line 2: id must be of letters, digits, _, . and -"),
        ("1 1 0 0\n2 1 99 0\n", (), "people move at 248 m/s; x and y must be in metres"),
        (FORMATS["csv"], ("--target", "71"), "--target 71: no such person; did you mean 7? "),
    ],
)
def test_what_is_wrong_is_one_line(text, arguments, expected, people_import):
    (line,) = people_import(text, *arguments).splitlines()
    assert expected in line
