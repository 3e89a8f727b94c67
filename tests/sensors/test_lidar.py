"""The ranges of a scan and their noise."""

import math

import msgspec
import numpy as np
import pytest
from mecazen.config import WorldConfig
from mecazen.config.sensors import LidarConfig
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan, Time
from mecazen.robot import Attachment
from mecazen.wire import decode, encode
from mecazen_sensors.lidar import STEPS_PER_M, Lidar
from mecazen_sensors.raycast import RayScene
from people import HEIGHT, NEXUS, body

MOUNT = Attachment(size_m=(0.04, 0.04), position_m=(-0.13, 0.0, 0.16), mass_kg=0.2)
EXACT = {"range_std_m": 0.0, "dropout_probability": 0.0}
STEP_M = 0.5 / STEPS_PER_M + 1e-9
"""Half a step of the sensor's resolution."""


def room(*obstacles, people=0):
    return RayScene(WorldConfig(obstacles=obstacles), [NEXUS], people)


def wall(distance, height=1.0):
    return Box(size_m=(1.0, 40.0, height), position_m=(distance + 0.5, 0.0))


def scan(scene, pose=None, seed=0, **settings):
    return Lidar(LidarConfig(**settings), MOUNT, seed).scan(scene, pose or Pose2D(), Time())


def test_a_wall_is_where_its_beams_say():
    found = scan(room(wall(3.0)), Pose2D(0.5, 1.0, 0.4), **EXACT)
    assert len(found.ranges) == 720
    seen = 0
    for number, distance in enumerate(found.ranges):
        if distance <= found.range_max:
            seen += 1
            angle = found.angle_min + number * found.angle_increment + 0.4
            x = 0.5 - 0.13 * math.cos(0.4) + distance * math.cos(angle)
            assert x == pytest.approx(3.0, abs=STEP_M)
    assert seen > 200


def test_what_is_not_hit_or_too_near_is_outside_of_the_limits_but_a_number():
    found = scan(room(wall(3.0), Cylinder(size_m=(0.02, 1.0), position_m=(-0.13, 0.05))), **EXACT)
    behind, left = found.ranges[0], found.ranges[540]
    assert behind == found.range_max + 1.0
    assert 0.0 < left < found.range_min  # 0 would be no measurement
    assert decode(encode(found), LaserScan) == found


def test_the_numbers_are_exact_in_the_32_bits_of_ros():
    found = scan(room(wall(3.0)), max_range_m=7.3, fov_deg=250.0)
    numbers = np.array([v for v in msgspec.structs.astuple(found)[1:-2] if isinstance(v, float)])
    for values in (numbers, np.array(found.ranges)):
        assert np.array_equal(values.astype(np.float32).astype(np.float64), values)


def test_a_narrow_field_has_a_beam_on_either_edge():
    found = scan(room(wall(3.0)), fov_deg=90.0, beams=91, **EXACT)
    assert found.angle_min == pytest.approx(-math.pi / 4)
    assert found.angle_max == pytest.approx(math.pi / 4)
    assert found.ranges[45] == pytest.approx(3.13, abs=STEP_M)


def test_what_is_lower_than_the_beams_is_not_seen_and_legs_are():
    scene = room(wall(3.0, height=0.15), people=1)
    scene.place_person(0, body(pose=(1.5, 0.0, 0.0)), HEIGHT)
    found = scan(scene, **EXACT)
    seen = [r for r in found.ranges if r <= found.range_max]
    # two shanks of 0.105 m at 1.6 m: 3.7 degrees each, of half a degree a beam
    assert 12 <= len(seen) <= 16
    assert min(seen) == pytest.approx(1.63 - 0.03 * HEIGHT, abs=0.02)


def test_noise_and_dropouts_are_as_told():
    std, share = 0.013, 0.02
    lidar = Lidar(LidarConfig(range_std_m=std, dropout_probability=share), MOUNT, 3)
    scene, frames = room(wall(3.0)), 60
    exact = np.array(scan(scene, **EXACT).ranges)
    seen = exact < 11.0  # the range cuts off the noise of what is near its end
    ranges = np.array([lidar.scan(scene, Pose2D(), Time()).ranges for _ in range(frames)])[:, seen]
    count = ranges.size
    lost = ranges == 0.0
    # four standard errors of a share, of a mean and of a deviation of normal numbers
    assert np.mean(lost) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / count))
    errors = (ranges - exact[seen])[~lost]
    assert np.mean(errors) == pytest.approx(0.0, abs=4 * std / math.sqrt(count))
    assert np.std(errors) == pytest.approx(std, abs=4 * std / math.sqrt(2 * count) + STEP_M**2)
    white = np.where(lost, 0.0, ranges - exact[seen])
    correlation = np.mean(white[1:] * white[:-1]) / std**2
    assert correlation == pytest.approx(0.0, abs=4 / math.sqrt(count))


def test_the_same_seed_has_the_same_bits_whatever_was_seen_before():
    one, other = (Lidar(LidarConfig(), MOUNT, 8) for _ in range(2))
    one.scan(room(wall(3.0)), Pose2D(), Time())
    other.scan(room(), Pose2D(), Time())
    scene = room(wall(2.0))
    assert one.scan(scene, Pose2D(), Time()) == other.scan(scene, Pose2D(), Time())
    assert scan(scene, seed=1) != scan(scene, seed=2)


def test_while_it_is_occluded_no_beam_brings_a_valid_measurement():
    lidar = Lidar(LidarConfig(occlusions_s=((1.0, 2.0),)), MOUNT, 0)
    scene = room(wall(3.0))

    def is_blind(time_s):
        found = lidar.scan(scene, Pose2D(), Time.from_ns(round(time_s * 1e9)))
        return not any(found.ranges)

    assert [is_blind(time_s) for time_s in (0.9, 1.0, 2.0, 2.1)] == [False, True, True, False]
