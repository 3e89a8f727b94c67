"""Places: walls, doors, tables and ramps become shapes, and occupancy maps become boxes."""

import math
from io import BytesIO

import numpy as np
import pytest
from harness import ROOT, SCENARIOS, error_of
from mecazen.config import WorldConfig
from mecazen.config.world import Box, Door, Patch, Ramp, Table, Wall
from mecazen.errors import ConfigError
from mecazen.loading import effective, load_scenario, to_toml
from mecazen.occupancy import MAX_BOXES, read_map
from PIL import Image

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


def test_ramps_and_patches_have_their_shapes():
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, landing_m=0.5, position_m=(3.0, 0.0))
    world = WorldConfig(ramps=(ramp,))
    assert world.ridges[0][1:] == (1.0, 0.5, 0.08, 0.8)
    assert covered(world.solids, 3.0 - 1.24, 0.42)
    assert covered(world.solids, 3.0, -0.42)
    assert not covered(world.solids, 3.0, 0.39)
    patch = Patch(size_m=(2.0, 0.4), position_m=(1.0, 1.0), yaw_deg=90.0, friction=0.3)
    assert patch.covers(1.1, 1.9)
    assert not patch.covers(1.9, 1.1)


@pytest.mark.parametrize("place", PLACES, ids=lambda path: path.stem)
def test_places_are_free_at_the_start_and_survive_being_printed(place, tmp_path):
    scenario = load_scenario(SCENARIOS / "senses.toml", {"world": place})
    boxes = [solid for solid in scenario.world.solids if isinstance(solid, Box)]
    assert boxes
    for x, y in ((-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)):
        assert not covered(boxes, x, y)
    (tmp_path / "again.toml").write_text(to_toml(scenario))
    assert effective(load_scenario(tmp_path / "again.toml")) == effective(scenario)


def map_of(folder, picture: bytes, **changes):
    settings = {
        "image": "map.pgm",
        "resolution": 0.5,
        "origin": "[1.0, 2.0, 0.0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        **changes,
    }
    (folder / "map.pgm").write_bytes(picture)
    text = "".join(f"{key}: {value}\n" for key, value in settings.items())
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


ASCII = b"P2\n# made by hand\n4 3\n255\n0 0 254 205\n0 0 254 254\n254 254 254 0\n"


def test_an_occupancy_map_becomes_few_boxes_at_their_places(tmp_path):
    binary = b"P5 4 3 255\n" + bytes([0, 0, 254, 205, 0, 0, 254, 254, 254, 254, 254, 0])
    for picture in (ASCII, binary):
        block, cell = read_map(map_of(tmp_path, picture))
        # a block of 2 x 2 cells in the upper left corner, and the lower right cell; y is up
        assert (block["size_m"][:2], block["position_m"]) == ([1.0, 1.0], [1.5, 3.0])
        assert (cell["size_m"][:2], cell["position_m"]) == ([0.5, 0.5], [2.75, 2.25])
    (turned, _) = read_map(map_of(tmp_path, ASCII, origin="\n- 0.0\n- 0.0\n- 1.5707963267948966"))
    assert turned["position_m"] == pytest.approx([-1.0, 0.5])
    assert turned["yaw_deg"] == pytest.approx(90.0)


def encoded(grey, suffix: str, mode: str = "L") -> bytes:
    file = BytesIO()
    Image.fromarray(grey).convert(mode).save(file, suffix)
    return file.getvalue()


GREYS = np.array([[0, 40, 65, 100, 205, 254, 255]], "u1")


def occupied(boxes):
    """Return which cells of one row of 0.5 m boxes cover; they end at the edges of cells."""
    cells = np.zeros(GREYS.size, int)
    for box in boxes:
        (x, y), (length, width, _) = box["position_m"], box["size_m"]
        left, right = (x - length / 2) / 0.5, (x + length / 2) / 0.5
        assert (left % 1.0, right % 1.0, y, width) == (0.0, 0.0, 0.25, 0.5)
        cells[int(left) : int(right)] = 1
    return "".join(map(str, cells))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        # 1 - 65/255 = 0.75 and 1 - 100/255 = 0.61, of which 0.65 is the threshold
        ({"mode": "scale"}, "1110000"),
        ({"negate": "true"}, "0000111"),  # white is occupied; 205/255 = 0.80
        # raw levels are shares of 100; those above are unknown
        ({"mode": "raw", "occupied_thresh": 0.9}, "0001000"),
        ({"occupied_thresh": 1.0}, "1000000"),
    ],
)
def test_modes_and_thresholds_are_those_of_map_server(changes, expected, tmp_path):
    for suffix, mode in (("PNG", "P"), ("PNG", "RGBA"), ("BMP", "L")):
        path = map_of(tmp_path, encoded(GREYS, suffix, mode), origin="[0, 0, 0]", **changes)
        assert occupied(read_map(path)) == expected, (suffix, mode)


@pytest.mark.parametrize(
    ("picture", "changes", "line"),
    [
        (b"%PDF", {}, "map.pgm: no whole PGM, PNG or BMP picture: cannot identify image file"),
        (b"P5 9000 9000 255\n0", {}, "has 9000 x 9000 pixels; at most 16,777,216 are allowed: cr"),
        (b"P5 99999 99999 255\n0", {}, "map.pgm: no whole PGM, PNG or BMP picture: Image size"),
        (encoded(GREYS, "PNG")[:45], {}, "map.pgm: no whole PGM, PNG or BMP picture"),
        (ASCII, {"resolution": 0.0}, "map.yaml: resolution: got 0.0; allowed: a number >= 0.001"),
        (ASCII, {"origin": "[0, .nan, 0]"}, "map.yaml: origin: got (0.0, nan, 0.0); allowed: fi"),
        (b"P5 2 1 255\n\0\0", {}, "map.pgm: no cell is free; check negate and occupied_thresh in"),
        (ASCII, {"image": "none.pgm"}, "none.pgm: can't be read: No such file"),
    ],
)
def test_a_map_that_can_not_be_read_is_refused(picture, changes, line, tmp_path):
    path = map_of(tmp_path, picture, **changes)
    assert line in error_of(ConfigError, lambda: read_map(path))


def test_a_map_of_too_many_boxes_is_refused_with_the_remedy(tmp_path):
    # the largest picture as a chessboard, so that each occupied cell needs a box
    even = bytes([0, 255]) * 2048
    picture = b"P5\n4096 4096\n255\n" + (even + even[::-1]) * 2048
    problem = error_of(ConfigError, lambda: read_map(map_of(tmp_path, picture)))
    assert f"its 8,388,608 occupied cells need more than {MAX_BOXES:,} boxes; remove" in problem
