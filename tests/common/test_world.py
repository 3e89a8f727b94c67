"""Places from small files: walls, doors, tables and ramps become shapes."""

import math
from pathlib import Path

import pytest
from harness import error_of
from mecazen.config import WorldConfig
from mecazen.config.world import Box, Door, Patch, Ramp, Table, Wall
from mecazen.errors import ConfigError
from mecazen.loading import effective, from_tables, load_scenario, parse_settings, to_toml

ROOT = Path(__file__).parents[2]
PLACES = sorted((ROOT / "configs/worlds").glob("*.toml"))


def covered(solids, x, y, z=0.1):
    """Whether a point is in one of the boxes."""
    for box in solids:
        along, across = x - box.position_m[0], y - box.position_m[1]
        c, s = math.cos(math.radians(box.yaw_deg)), math.sin(math.radians(box.yaw_deg))
        half = [length / 2 for length in box.size_m]
        at = c * along + s * across, c * across - s * along, z - box.bottom_m - half[2]
        if all(abs(value) < most for value, most in zip(at, half, strict=True)):
            return True
    return False


def test_a_wall_is_closed_at_its_corner_and_open_at_its_door():
    door = Door(at_m=3.0, width_m=0.9, sill_m=0.01)
    wall = Wall(points_m=((0, 0), (2, 0), (2, 2)), thickness_m=0.2, height_m=2.5, doors=(door,))
    world = WorldConfig(walls=(wall,))
    for point in ((0.01, 0.0), (1.0, 0.09), (2.09, -0.09), (2.0, 0.5), (2.0, 1.99)):
        assert covered(world.solids, *point, z=2.4)
    for point in ((-0.01, 0.0), (1.0, 0.11), (2.0, 0.6), (2.0, 1.4), (2.0, 2.01)):
        assert not covered(world.solids, *point)
    (sill,) = world.ridges
    # its way across is the wall's left; its bevels are twice as long as they are high
    assert sill.middle == pytest.approx((2.0, 1.0, math.pi))
    assert sill[1:] == pytest.approx((0.02, 0.2, 0.01, 0.9))


def test_a_table_has_a_top_and_legs_with_room_between_them():
    table = Table(size_m=(1.2, 0.8, 0.75), position_m=(1.0, 2.0), yaw_deg=90.0)
    solids = WorldConfig(tables=(table,)).solids
    assert covered(solids, 1.0, 2.0, 0.74)
    assert not covered(solids, 1.0, 2.0, 0.70)
    assert covered(solids, 1.0 - 0.39, 2.0 + 0.59, 0.1)  # a leg
    assert not covered(solids, 1.0, 2.0 + 0.59, 0.1)


def test_a_ramp_is_a_ridge_between_rails():
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, landing_m=0.5, position_m=(3.0, 0.0))
    world = WorldConfig(ramps=(ramp,))
    assert world.ridges[0][1:] == (1.0, 0.5, 0.08, 0.8)
    assert covered(world.solids, 3.0 - 1.24, 0.42)
    assert covered(world.solids, 3.0, -0.42)
    assert not covered(world.solids, 3.0, 0.39)


def test_a_patch_covers_its_rectangle():
    patch = Patch(size_m=(2.0, 0.4), position_m=(1.0, 1.0), yaw_deg=90.0, friction=0.3)
    assert patch.covers(1.1, 1.9)
    assert not patch.covers(1.9, 1.1)


def read(text, folder, **others):
    (folder / "place.toml").write_text(text)
    tables = {"robot": str(ROOT / "configs/robots/nexus.toml"), "world": "place.toml", **others}
    return from_tables(tables, folder / "test.toml")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("wals = []", "place.toml: world.wals: unknown key; did you mean walls? allowed: "),
        ("[[walls]]\npoints_m = [[0, 0]]", "walls.0.points_m: got [[0, 0]]; allowed: a list"),
        ("[[walls]]\npoints_m = [[0, 0], [0, 0]]", "two points that follow each other must differ"),
        (
            "[[walls]]\npoints_m = [[0, 0], [2, 0]]\ndoors = [{ at_m = 1.9, width_m = 1.0 }]",
            "world.walls.0: doors: one from 1.4 m to 2.4 m along the wall is not within one",
        ),
        (
            "[[walls]]\npoints_m = [[0, 0], [2, 0]]\ndoors = [{ at_m = 1.0, width_m = 1.0 }, "
            "{ at_m = 1.4, width_m = 1.0 }]",
            "world.walls.0: doors: two of them overlap",
        ),
        (
            "[[walls]]\npoints_m = [[0, 0], [2, 0]]\n"
            "doors = [{ at_m = 1.0, width_m = 1.0, sill_m = 0.03 }]",
            "world.walls.0.doors.0.sill_m: got 0.03; allowed: a number >= 0 and <= 0.01",
        ),
        (
            "[[ramps]]\nlength_m = 1.0\nwidth_m = 1.0\nrise_m = 0.1\nposition_m = [0.0, 0.0]",
            "world.ramps.0: rise_m = 0.1 must be at most 8% of length_m = 1",
        ),
        ("map = 'none.yaml'", "none.yaml: can't be read: No such file or directory"),
    ],
)
def test_what_is_wrong_with_a_world_file_is_one_line_that_names_it(text, expected, tmp_path):
    problem = error_of(ConfigError, lambda: read(text, tmp_path))
    assert expected in problem


def test_a_scenario_lays_its_changes_over_a_world_file(tmp_path):
    text = "ground_friction = 0.7\n[[walls]]\npoints_m = [[0, 0], [2, 0]]"
    changes = {"file": "place.toml", "ground_friction": 0.5, "person": {"radius_m": 0.3}}
    world = read(text, tmp_path, world=changes).world
    assert (world.ground_friction, world.person.radius_m, len(world.walls)) == (0.5, 0.3, 1)
    changes["slope_deg"] = 90.0
    problem = error_of(ConfigError, lambda: read(text, tmp_path, world=changes))
    assert f"{tmp_path / 'test.toml'}: world.slope_deg: got 90" in problem


@pytest.mark.parametrize("place", PLACES, ids=lambda path: path.stem)
def test_places_are_free_at_the_start_and_survive_being_printed(place, tmp_path):
    overrides = (f"world={place}",)
    scenario = load_scenario(ROOT / "configs/scenarios/senses.toml", parse_settings(overrides))
    boxes = [solid for solid in scenario.world.solids if isinstance(solid, Box)]
    assert boxes
    for x, y in ((-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)):
        assert not covered(boxes, x, y)
    (tmp_path / "again.toml").write_text(to_toml(scenario))
    assert effective(load_scenario(tmp_path / "again.toml")) == effective(scenario)
