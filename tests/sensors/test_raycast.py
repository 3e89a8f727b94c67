"""Rays meet the world where geometry says that they do."""

import math

import analytic
import numpy as np
import pytest
from mecazen.config import WorldConfig
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen.skeleton import INDEX, LIMBS
from mecazen_sensors.raycast import RayScene
from people import HEIGHT, NEXUS, body, walking

EXACT_M = 1e-6
"""Far more than rounding, which is 1e-15 of the largest coordinate, and than what a ray that
nearly grazes makes of it: its square root; far less than the millimetre that is asked for."""


def random_world(random):
    things = []
    for number in range(20):
        place = tuple(random.uniform(-4.0, 4.0, 2).tolist())
        size = tuple(random.uniform(0.05, 1.2, 3).tolist())
        yaw = float(random.uniform(-180.0, 180.0))
        things.append(
            Box(size_m=size, position_m=place, yaw_deg=yaw)
            if number % 2
            else Cylinder(size_m=size[:2], position_m=place)
        )
    return WorldConfig(obstacles=tuple(things))


def turned(yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def expected(origins, directions, world, people=(), robots=()):
    """Distances by `analytic`: of people as joints and heights, of robots as files and poses."""
    up = np.array((0.0, 0.0, 1.0))
    ways = [analytic.ground(origins, directions)]
    for thing in world.obstacles:
        centre = np.array((*thing.position_m, thing.size_m[-1] / 2))
        if isinstance(thing, Box):
            turn, half = turned(math.radians(thing.yaw_deg)), np.array(thing.size_m) / 2
            ways.append(analytic.box(origins, directions, centre, turn, half))
        else:
            radius, height = thing.size_m
            ways.append(analytic.cylinder(origins, directions, centre, up, radius, height / 2))
    for joints, height in people:
        for limb in LIMBS:
            begin, end = joints[INDEX[limb.begin]], joints[INDEX[limb.end]]
            ways.append(analytic.capsule(origins, directions, begin, end, limb.radius * height))
    for robot, pose in robots:
        turn, foot = turned(pose.yaw), np.array((pose.x, pose.y, 0.0))
        base, camera, lidar = robot.base, robot.camera, robot.lidar
        sizes = (base.length_m, base.width_m, base.height_m), camera.size_m
        centres = (0.0, 0.0, base.clearance_m + base.height_m / 2), camera.position_m
        for size, centre in zip(sizes, centres, strict=True):
            middle = turn @ np.array(centre) + foot
            ways.append(analytic.box(origins, directions, middle, turn, np.array(size) / 2))
        middle, (radius, height) = turn @ np.array(lidar.position_m) + foot, lidar.size_m
        ways.append(analytic.cylinder(origins, directions, middle, up, radius, height / 2))
        hub = robot.wheels.radius_m, robot.wheels.hub_width_m / 2
        for wheel in WHEELS:
            middle = turn @ np.array(robot.wheel_position(wheel)) + foot
            ways.append(analytic.cylinder(origins, directions, middle, turn[:, 1], *hub))
    return np.min(ways, axis=0)


def assert_same(distances, exact):
    assert np.array_equal(np.isinf(distances), np.isinf(exact))
    seen = np.isfinite(exact)
    assert np.max(np.abs(distances[seen] - exact[seen])) < EXACT_M


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("level", [False, True])
def test_distances_are_those_of_an_independent_implementation(seed, level):
    random = np.random.default_rng(seed)
    world = random_world(random)
    scene = RayScene(world, [NEXUS, NEXUS], people=2)
    pose, rays = Pose2D(*random.uniform(-3.0, 3.0, 3)), 2000
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
    if level:
        directions[:, 2] = 0.0
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    distances, hits = scene.cast(origin, directions, level=level)
    exact = expected(np.tile(origin, (rays, 1)), directions, world, people, [(NEXUS, pose)])
    assert_same(distances, exact)
    assert np.array_equal(hits < 0, np.isinf(exact))


def test_a_limb_longer_than_at_first_is_hit_at_its_ends():
    scene = RayScene(WorldConfig())
    for factor in (1.0, 1.5, 0.6):
        joints = body() * factor
        scene.place_person(0, joints, HEIGHT)
        for limb in LIMBS:
            for name in (limb.begin, limb.end):
                origin = joints[INDEX[name]] + np.array((5.0, 0.0, 0.0))
                distances, _ = scene.cast(origin, np.array([[-1.0, 0.0, 0.0]]))
                assert distances[0] <= 5.0 - limb.radius * HEIGHT + EXACT_M


def test_nothing_is_hit_beyond_the_range_though_it_begins_within():
    world = WorldConfig(obstacles=(Box(size_m=(2.0, 2.0, 1.0), position_m=(5.0, 0.0)),))
    scene, ray = RayScene(world), np.array([[1.0, 0.0, 0.0]])
    origin = np.array((0.0, 0.0, 0.5))
    assert scene.cast(origin, ray, max_range=4.01)[0][0] == pytest.approx(4.0, abs=EXACT_M)
    distances, hits = scene.cast(origin, ray, max_range=3.99)
    assert np.isinf(distances[0])
    assert hits[0] == -1


def test_a_robot_does_not_see_itself_but_others_see_it():
    scene = RayScene(WorldConfig(), [NEXUS, NEXUS], people=0)
    scene.place_robot(0, Pose2D(1.0, 2.0, 0.3))
    angles = np.linspace(0.0, math.tau, 200, endpoint=False)
    rays = np.stack((np.cos(angles), np.sin(angles), 0.0 * angles), axis=-1)
    origin = np.array((1.0, 2.0, 0.1))
    assert np.all(np.isinf(scene.cast(origin, rays, robot=0, level=True)[0]))
    assert np.all(np.isfinite(scene.cast(origin, rays, robot=1, level=True)[0]))


def test_who_is_not_placed_is_not_there():
    scene = RayScene(WorldConfig(), [NEXUS], people=1)
    rays = np.random.default_rng(1).normal(size=(500, 3))
    rays[:, 2] = np.abs(rays[:, 2])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    assert np.all(np.isinf(scene.cast(np.array((0.0, 0.0, 0.1)), rays)[0]))
