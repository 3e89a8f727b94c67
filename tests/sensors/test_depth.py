"""The content and the noise of depth pictures."""

import math

import numpy as np
import pytest
from mecazen.config import WorldConfig
from mecazen.config.sensors import DepthConfig
from mecazen.config.world import Box
from mecazen.geometry import Pose2D
from mecazen.messages import Image, Time
from mecazen.robot import CameraMount
from mecazen.wire import decode, encode
from mecazen_sensors.camera import DepthCamera
from mecazen_sensors.raycast import RayScene
from people import HEIGHT, NEXUS, body

MOUNT = CameraMount(
    size_m=(0.02, 0.09, 0.02), position_m=(0.1, 0.0, 0.5), mass_kg=0.1, pitch_deg=10.0
)
EXACT = {"noise_m": 0.0, "edge_probability": 0.0}
HALF_MM = 0.5


def room(*obstacles, people=0):
    return RayScene(WorldConfig(obstacles=obstacles), [NEXUS], people)


def wall(distance):
    return Box(size_m=(1.0, 40.0, 10.0), position_m=(distance + 0.5, 0.0))


def pixels(image):
    assert image.step * image.height == len(image.data)
    return np.frombuffer(image.data, "<u2").reshape(image.height, image.width).astype(float)


def picture(scene, pose=None, seed=0, mount=MOUNT, **settings):
    camera = DepthCamera(DepthConfig(**settings), mount, seed)
    return pixels(camera.picture(scene, pose or Pose2D(), Time()))


def test_the_points_of_a_wall_and_the_ground_are_on_them():
    camera = DepthCamera(DepthConfig(**EXACT), MOUNT, 0)
    depths = pixels(camera.picture(room(wall(3.0)), Pose2D(), Time())) / 1000.0
    k = np.reshape(camera.info(Time()).k, (3, 3))
    rows, columns = np.indices(depths.shape)
    right, down = (columns - k[0, 2]) / k[0, 0] * depths, (rows - k[1, 2]) / k[1, 1] * depths
    c, s = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    x, z = c * depths + s * down + 0.1, s * depths - c * down + 0.5
    seen = depths > 0.0
    assert np.mean(seen) > 0.9
    assert np.all((np.abs(x - 3.0) < 1e-3) | (np.abs(z) < 1e-3) | ~seen)
    assert depths[0, 0] == pytest.approx(depths[0, -1], abs=1e-3)
    assert right[0, 0] < 0.0 < right[0, -1]


def test_a_level_picture_of_a_wall_has_one_depth_and_the_field_of_view_its_width():
    mount = CameraMount(size_m=(0.02, 0.09, 0.02), position_m=(0.1, 0.0, 1.9), mass_kg=0.1)
    depths = picture(room(wall(2.1)), mount=mount, **EXACT)
    assert np.all(np.abs(depths - 2000.0) <= HALF_MM)
    edge = Box(size_m=(1.0, 20.0, 10.0), position_m=(2.6, 10.0))  # its side is at y = 0
    depths = picture(room(edge), mount=mount, **EXACT)
    assert np.all(depths[:100, :160] > 0.0)
    assert np.all(depths[:100, 160:] == 0.0)


def test_what_is_beyond_the_range_has_no_depth():
    assert np.all(picture(room(), mount=MOUNT, max_range_m=0.6, **EXACT) == 0.0)


def test_noise_grows_with_the_square_of_depth():
    mount = CameraMount(size_m=(0.02, 0.09, 0.02), position_m=(0.1, 0.0, 1.9), mass_kg=0.1)
    for distance in (1.0, 2.0):
        depths = picture(room(wall(distance + 0.1)), mount=mount, noise_m=0.004)
        wrong = depths - 1000.0 * distance
        std = math.hypot(4.0 * distance**2, 1.0 / math.sqrt(12.0))  # and rounding to 1 mm
        count = depths.size
        assert np.mean(wrong) == pytest.approx(0.0, abs=4 * std / math.sqrt(count))
        assert np.std(wrong) == pytest.approx(std, rel=4 / math.sqrt(2 * count))


def test_pixels_at_edges_are_lost_or_between_the_two_depths_as_often_as_told():
    share = 0.3
    scene = room(wall(3.0), people=1)
    scene.place_person(0, body(pose=(1.8, 0.0, 0.0)), HEIGHT)
    exact = picture(scene, **EXACT)
    found = picture(scene, noise_m=0.0, edge_probability=share)
    changed = found != exact
    lost, flying = changed & (found == 0.0), changed & (found > 0.0)
    # the outline of a person: 2 x 5 limbs of some 60 pixels, with the trunk
    assert 300 < np.sum(changed) / (2 * share) < 3000
    for part in (lost, flying):
        count = np.sum(changed) / 2
        assert np.sum(part) == pytest.approx(count, abs=4 * math.sqrt(count))
    assert np.all(found[flying] < exact[flying])
    assert np.all(found[flying] > 1000.0)


def test_the_picture_comes_back_from_the_wire_and_repeats_with_its_seed():
    camera = DepthCamera(DepthConfig(), MOUNT, 3)
    image = camera.picture(room(wall(3.0)), Pose2D(0.2, 0.1, 0.4), Time())
    assert decode(encode(image), Image) == image
    again = DepthCamera(DepthConfig(), MOUNT, 3)
    assert again.picture(room(wall(3.0)), Pose2D(0.2, 0.1, 0.4), Time()) == image
