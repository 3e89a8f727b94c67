"""Occupancy images become few boxes at their places."""

import random
from pathlib import Path

import msgspec
import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen.loading import from_tables, load_scenario
from mecazen.occupancy import read_map

ROOT = Path(__file__).parents[2]


def read(text, folder, **others):
    (folder / "place.toml").write_text(text)
    tables = {"robot": str(ROOT / "configs/robots/nexus.toml"), "world": "place.toml", **others}
    return from_tables(tables, folder / "test.toml")


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


def test_an_occupancy_image_becomes_few_boxes_at_their_places(tmp_path):
    binary = b"P5 4 3 255\n" + bytes([0, 0, 254, 205, 0, 0, 254, 254, 254, 254, 254, 0])
    for picture in (ASCII, binary):
        block, cell = read_map(map_of(tmp_path, picture))
        # its upper left corner of 2 x 2 cells, and the lower right cell; y is up
        assert (block["size_m"][:2], block["position_m"]) == ([1.0, 1.0], [1.5, 3.0])
        assert (cell["size_m"][:2], cell["position_m"]) == ([0.5, 0.5], [2.75, 2.25])
    (turned, _) = read_map(map_of(tmp_path, ASCII, origin="[0.0, 0.0, 1.5707963267948966]"))
    assert turned["position_m"] == pytest.approx([-1.0, 0.5])
    assert turned["yaw_deg"] == pytest.approx(90.0)
    block, _ = read_map(map_of(tmp_path, ASCII, negate=1))  # white is occupied
    assert block["position_m"] == [2.5, 3.0]


def test_a_world_names_its_occupancy_image_beside_itself(tmp_path):
    map_of(tmp_path, ASCII)
    scenario = read("map = 'map.yaml'", tmp_path)
    assert len(scenario.world.solids) == 2
    assert msgspec.to_builtins(scenario.world)["obstacles"][0]["kind"] == "box"


def test_an_override_names_an_occupancy_image_as_well(tmp_path):
    text = map_of(tmp_path, ASCII)
    scenario = load_scenario(ROOT / "configs/scenarios/back.toml", (f"world.map={text}",))
    assert len(scenario.world.solids) == 2


def test_random_cells_are_covered_exactly_once(tmp_path):
    chance = random.Random(1)
    cells = [[chance.random() < 0.3 for _ in range(40)] for _ in range(30)]
    picture = b"P5\n40 30\n255\n" + bytes([0 if cell else 255 for row in cells for cell in row])
    boxes = read_map(map_of(tmp_path, picture, resolution=1.0, origin="[0, 0, 0]"))
    count = [[0] * 40 for _ in range(30)]
    for box in boxes:
        (x, y), (length, width, _) = box["position_m"], box["size_m"]
        left, low = round(x - length / 2), round(y - width / 2)
        for row in count[low : low + round(width)]:
            for column in range(left, left + round(length)):
                row[column] += 1
    assert count[::-1] == cells


@pytest.mark.parametrize(
    ("picture", "changes", "expected"),
    [
        (b"P6 1 1 255\n000", {}, "map.pgm: not a PGM picture (P2 or P5)"),
        (b"P5 99999 99999 255\n0", {}, "map.pgm: 99999 x 99999 pixels up to 255; allowed: at most"),
        (b"P5 99999 1 255\n0", {}, "pixels, 65536 along each side"),
        (b"P5 4 3 255\n0", {}, "map.pgm: 1 pixels of 4 x 3"),
        (b"P5 2 2 65535\n000", {}, "map.pgm: 1 pixels of 2 x 2"),
        (b"P2 1 1 255\n" + b"9" * 5000, {}, "map.pgm: 0 pixels of 1 x 1"),
        (b"P2 2 1 7\n7 8", {}, "map.pgm: a pixel of 8, where 7 is white"),
        (ASCII, {"resolution": 0.0}, "map.yaml: resolution: got 0; allowed: 0.001 to 10 m"),
        (ASCII, {"origin": "[0, nan, 0]"}, "map.yaml: origin and occupied_thresh must be finite"),
        (ASCII, {"origin": "[0, 0]"}, "map.yaml: needs image, resolution, origin"),
    ],
)
def test_an_image_that_is_none_is_refused_with_one_line(picture, changes, expected, tmp_path):
    path = map_of(tmp_path, picture, **changes)
    problem = error_of(ConfigError, lambda: read_map(path))
    assert expected in problem


def test_an_image_of_too_many_boxes_is_refused(tmp_path):
    # the largest one, as a check: each line has 2,048 boxes
    even = bytes([0, 255]) * 2048
    picture = b"P5\n4096 4096\n255\n" + (even + even[::-1]) * 2048
    problem = error_of(ConfigError, lambda: read_map(map_of(tmp_path, picture)))
    assert "at most 2000 boxes can be simulated" in problem
