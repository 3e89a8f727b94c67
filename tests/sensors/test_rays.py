"""Rays: the scene, scans of a lidar, depth images, and a camera's view."""

import math

import msgspec
import numpy as np
import pytest
from mecazen.config import WorldConfig
from mecazen.config.sensors import DepthConfig, LidarConfig
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan, Time
from mecazen.robot import WHEELS, CameraMount, LidarMount
from mecazen.skeleton import INDEX, LIMBS
from mecazen.wire import decode, encode
from mecazen_sensors.camera import DepthCamera
from mecazen_sensors.lidar import STEPS_PER_M, Lidar
from mecazen_sensors.raycast import RayScene
from people import HEIGHT, NEXUS, body, walking
from sensors import analytic

EXACT_M = 1e-6
"""Far more than rounding, which is 1e-15 of the largest coordinate, and its square root for a ray
that nearly grazes a shape; far less than a millimetre."""
LIDAR = LidarMount(size_m=(0.04, 0.04), position_m=(-0.13, 0.0, 0.16), mass_kg=0.2)
NO_NOISE = {"range_std_m": 0.0, "dropout_probability": 0.0}
STEP_M = 0.5 / STEPS_PER_M + 1e-9
"""Half a step of the lidar's resolution."""
SHARP = {"noise_m": 0.0, "edge_probability": 0.0}
HALF_MM = 0.5


def room(*obstacles, people=0):
    return RayScene(WorldConfig(obstacles=obstacles), [NEXUS], people)


def wall(distance, height=10.0):
    return Box(size_m=(1.0, 40.0, height), position_m=(distance + 0.5, 0.0))


def random_world(random):
    obstacles = []
    for number in range(20):
        place = tuple(random.uniform(-4.0, 4.0, 2).tolist())
        size = tuple(random.uniform(0.05, 1.2, 3).tolist())
        box = Box(size_m=size, position_m=place, yaw_deg=random.uniform(-180.0, 180.0))
        obstacles.append(box if number % 2 else Cylinder(size_m=size[:2], position_m=place))
    return WorldConfig(obstacles=tuple(obstacles))


def turned(yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def analytic_distances(origins, directions, world, people, robot, pose):
    """Return distances by `analytic`; `people` are joints and heights."""
    up, turn = np.array((0.0, 0.0, 1.0)), turned(pose.yaw)
    distances = [analytic.ground(origins, directions)]

    def box(centre, rotation, size):
        half = np.array(size) / 2
        distances.append(analytic.box(origins, directions, centre, rotation, half))

    def cylinder(centre, axis, radius, height):
        distances.append(analytic.cylinder(origins, directions, centre, axis, radius, height / 2))

    def on_robot(position):
        return turn @ np.array(position) + (pose.x, pose.y, 0.0)

    for obstacle in world.obstacles:
        centre = np.array((*obstacle.position_m, obstacle.size_m[-1] / 2))
        if isinstance(obstacle, Box):
            box(centre, turned(math.radians(obstacle.yaw_deg)), obstacle.size_m)
        else:
            cylinder(centre, up, *obstacle.size_m)
    for joints, height in people:
        for limb in LIMBS:
            ends = joints[INDEX[limb.begin]], joints[INDEX[limb.end]]
            distances.append(analytic.capsule(origins, directions, *ends, limb.radius * height))
    base, camera, lidar, wheels = robot.base, robot.camera, robot.lidar, robot.wheels
    middle = (0.0, 0.0, base.clearance_m + base.height_m / 2)
    box(on_robot(middle), turn, (base.length_m, base.width_m, base.height_m))
    box(on_robot(camera.position_m), turn, camera.size_m)
    cylinder(on_robot(lidar.position_m), up, *lidar.size_m)
    for wheel in WHEELS:
        centre = on_robot(robot.wheel_position(wheel))
        cylinder(centre, turn[:, 1], wheels.radius_m, wheels.hub_width_m)
    return np.min(distances, axis=0)


@pytest.mark.parametrize(("seed", "is_level"), [(0, False), (1, True)])
def test_distances_are_those_of_an_independent_implementation(seed, is_level):
    random = np.random.default_rng(seed)
    world = random_world(random)
    scene = RayScene(world, [NEXUS, NEXUS], people=2)
    pose, rays = Pose2D(*random.uniform(-3.0, 3.0, 3)), 4000
    scene.place_robot(0, Pose2D(50.0, 0.0, 0.0))
    scene.place_robot(1, pose)
    people = []
    for person, height in ((0, 1.75), (1, 1.2)):
        # limbs whose lengths differ from the first ones: bounds of the first are of no use
        joints = walking(random.uniform(0.0, 1.0), random.uniform(-3.0, 3.0, 3))
        joints += random.normal(0.0, 0.05, joints.shape)
        joints[:, 2] *= random.uniform(0.5, 1.4)
        scene.place_person(person, joints, height)
        people.append((joints, height))
    origin = np.append(random.uniform(-4.0, 4.0, 2), random.uniform(0.02, 1.8))
    directions = random.normal(size=(rays, 3))
    if is_level:
        directions[:, 2] = 0.0
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    distances, hits = scene.cast(origin, directions)
    origins = np.tile(origin, (rays, 1))
    exact = analytic_distances(origins, directions, world, people, NEXUS, pose)
    assert np.array_equal(np.isinf(distances), np.isinf(exact))
    assert np.array_equal(hits < 0, np.isinf(exact))
    seen = np.isfinite(exact)
    assert np.max(np.abs(distances[seen] - exact[seen])) < EXACT_M


def test_a_robot_is_seen_by_others_only():
    scene = RayScene(WorldConfig(), [NEXUS, NEXUS], people=0)
    scene.place_robot(0, Pose2D(1.0, 2.0, 0.3))
    angles = np.linspace(0.0, math.tau, 200, endpoint=False)
    rays = np.stack((np.cos(angles), np.sin(angles), 0.0 * angles), axis=-1)
    origin = np.array((1.0, 2.0, 0.1))
    assert np.all(np.isinf(scene.cast(origin, rays, robot=0)[0]))
    assert np.all(np.isfinite(scene.cast(origin, rays, robot=1)[0]))


def scan(scene, pose=Pose2D(), seed=0, **settings):  # noqa: B008
    return Lidar(LidarConfig(**settings), LIDAR, seed).scan(scene, pose, Time())


def test_a_wall_is_where_its_beams_end():
    result = scan(room(wall(3.0)), Pose2D(0.5, 1.0, 0.4), **NO_NOISE)
    ranges = np.array(result.ranges)
    angles = result.angle_min + result.angle_increment * np.arange(720) + 0.4
    x = 0.5 - 0.13 * math.cos(0.4) + ranges * np.cos(angles)
    hit = ranges <= result.range_max
    assert np.sum(hit) > 200
    assert x[hit] == pytest.approx(3.0, abs=STEP_M)
    assert np.all(ranges[~hit] == result.range_max + 1.0)


def test_ranges_outside_the_limits_have_their_values():
    near = Cylinder(size_m=(0.02, 1.0), position_m=(-0.13, 0.05))
    result = scan(room(near, wall(7.0)), fov_deg=250.0, max_range_m=7.3, **NO_NOISE)
    ranges = np.array(result.ranges)
    assert 0.0 < ranges.min() < result.range_min  # 0 would be no measurement
    assert ranges.max() == pytest.approx(8.3)
    assert decode(encode(result), LaserScan) == result
    numbers = [v for v in msgspec.structs.astuple(result)[1:-2] if isinstance(v, float)]
    for values in (np.array(numbers), ranges):  # exact in ROS's 32 bits
        assert np.array_equal(values.astype(np.float32).astype(np.float64), values)


def test_legs_are_seen_and_low_objects_are_not():
    scene = room(wall(3.0, height=0.15), people=1)
    scene.place_person(0, body(pose=(1.5, 0.0, 0.0)), HEIGHT)
    result = scan(scene, **NO_NOISE)
    seen = [r for r in result.ranges if r <= result.range_max]
    # two shanks of 0.105 m at 1.6 m: 3.7 degrees each, of half a degree a beam
    assert 12 <= len(seen) <= 16
    assert min(seen) == pytest.approx(1.63 - 0.03 * HEIGHT, abs=0.02)


def test_an_occluded_lidar_measures_nothing():
    lidar, scene = Lidar(LidarConfig(occlusions_s=((1.0, 2.0),)), LIDAR, 0), room(wall(3.0))
    measures = [
        any(lidar.scan(scene, Pose2D(), Time.from_ns(round(time_s * 1e9))).ranges)
        for time_s in (0.9, 1.0, 2.0, 2.1)
    ]
    assert measures == [True, False, False, True]


def mounted(x=0.0, z=0.5, pitch_deg=0.0, yaw_deg=0.0):
    return CameraMount(
        size_m=(0.02, 0.09, 0.02),
        position_m=(x, 0.0, z),
        mass_kg=0.1,
        pitch_deg=pitch_deg,
        yaw_deg=yaw_deg,
    )


def pixels(image):
    assert image.step * image.height == len(image.data)
    return np.frombuffer(image.data, "<u2").reshape(image.height, image.width).astype(float)


def picture(scene, mount, **settings):
    """Return the depths [mm] of an image from the origin."""
    return pixels(DepthCamera(DepthConfig(**settings), mount, 0).picture(scene, Pose2D(), Time()))


def test_depths_are_those_of_wall_and_ground():
    camera = DepthCamera(DepthConfig(**SHARP), mounted(x=0.1, pitch_deg=10.0), 0)
    depths = pixels(camera.picture(room(wall(3.0)), Pose2D(), Time())) / 1000.0
    k = np.reshape(camera.info(Time()).k, (3, 3))
    rows, columns = np.indices(depths.shape)
    right, down = (columns - k[0, 2]) / k[0, 0] * depths, (rows - k[1, 2]) / k[1, 1] * depths
    c, s = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    x, z = c * depths + s * down + 0.1, s * depths - c * down + 0.5
    seen = depths > 0.0
    assert np.mean(seen) > 0.9
    assert np.all((np.abs(x - 3.0) < 1e-3) | (np.abs(z) < 1e-3) | ~seen)
    assert right[0, 0] < 0.0 < right[0, -1]


def test_pixels_without_a_hit_in_range_are_0():
    to_the_left = Box(size_m=(1.0, 20.0, 10.0), position_m=(2.6, 10.0))  # its side is at y = 0
    depths = picture(room(to_the_left), mounted(x=0.1, z=1.9), **SHARP)
    assert np.all(np.abs(depths[:100, :160] - 2000.0) <= HALF_MM)
    assert np.all(depths[:100, 160:] == 0.0)
