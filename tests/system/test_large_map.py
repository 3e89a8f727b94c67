"""A large map with clutter, turned: the time to load it and to scan it, and what the lidar sees."""

import time

import numpy as np
from harness import SCENARIOS
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen.messages import Time
from mecazen_sensors.lidar import Lidar
from mecazen_sensors.raycast import RayScene
from PIL import Image

CELL_M, ORIGIN = 0.05, Pose2D(-9.0, -11.0, 0.2)


def test_a_map_of_160_000_cells_loads_and_is_scanned_in_real_time(tmp_path):
    random = np.random.default_rng(1)
    occupied = np.zeros((400, 400), bool)  # the lowest row first
    for row, column, height, width in random.integers(1, (390, 390, 7, 7), (500, 4)):
        occupied[row : row + height, column : column + width] = True
    occupied[180:260, 160:240] = False
    occupied[220, 230] = True  # ahead of the robot
    Image.fromarray(np.where(occupied, 0, 254)[::-1].astype("u1")).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(
        f"image: map.png\nresolution: {CELL_M}\norigin: {list(ORIGIN)}\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    begin = time.process_time()
    settings = {"world.map": tmp_path / "map.yaml", "world.obstacles": []}
    scenario = load_scenario(SCENARIOS / "senses.toml", settings)
    scene = RayScene(scenario.world, [scenario.robot])
    assert time.process_time() - begin < 3.0
    config = scenario.sensors.lidar
    lidar = Lidar(config, scenario.robot.lidar, 1)
    robot = ORIGIN.compose(Pose2D(180.5 * CELL_M, 220.5 * CELL_M))
    begin = time.process_time()
    scans = [lidar.scan(scene, robot, Time()) for _ in range(20)]
    assert (time.process_time() - begin) / len(scans) < 1.0 / config.rate_hz
    ahead = round(-scans[0].angle_min / scans[0].angle_increment)
    expected = 49.5 * CELL_M - scenario.robot.lidar.position_m[0]
    # the median of 20 ranges with a noise of 1 cm
    assert abs(np.median([scan.ranges[ahead] for scan in scans]) - expected) < 0.01
