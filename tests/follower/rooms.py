"""A flat world of circles for the planner: a scan of them, and a closed loop without physics."""

import math

import numpy as np
from harness import load_robot
from mecazen.config import FollowerConfig, Scenario
from mecazen.config.follower import PlannerConfig
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import LaserScan
from mecazen_follower.control import PolarController
from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.costs import Extents, Rollout, Situation
from mecazen_follower.planner.mppi import Planner
from mecazen_follower.planner.surroundings import Shadows
from mecazen_follower.sight import FieldOfView

SCENARIO = Scenario(robot=load_robot())
DRIVE = Drive.from_scenario(SCENARIO)
BODY = Extents(*SCENARIO.robot.footprint, person=0.2)
CAMERA = FieldOfView(math.radians(37.5), 0.0, 3.86)
NO_NOISE = ((0.0,) * 3,) * 3
BEAMS, LEG = 360, 0.06
TICK, STEPS = 0.05, 3
NOTHING = np.empty((0, 2))


def wall(x_from, x_to, y):
    """Return a wall along x as posts 5 cm apart."""
    return [(x, y, 0.03) for x in np.arange(x_from, x_to, 0.05)]


def legs(x, y):
    """Return two legs side by side."""
    return [(x, y - 0.1, LEG), (x, y + 0.1, LEG)]


def scan(lidar, circles, walls=(), beams=BEAMS, std=0.0):
    """Return what a lidar sees of circles (x, y, radius) and of walls, lines x = wall."""
    angles = lidar.yaw - math.pi + math.tau / beams * np.arange(beams)
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    x, y, radius = np.array(circles, float).reshape(-1, 3).T
    centres = np.stack((x - lidar.x, y - lidar.y), axis=-1)
    along = directions @ centres.T
    off = np.sum(centres**2, axis=-1) - along**2
    hit = (off < radius**2) & (along > 0.0)
    ranges = np.where(hit, along - np.sqrt(np.maximum(radius**2 - off, 0.0)), 13.0)
    ranges = ranges.min(axis=1, initial=13.0)
    for wall in walls:
        ahead = directions[:, 0] * (wall - lidar.x)
        distances = abs(wall - lidar.x) / np.maximum(np.abs(directions[:, 0]), 1e-9)
        ranges = np.minimum(ranges, np.where(ahead > 0.0, distances, 13.0))
    noise = std * np.random.default_rng(1).standard_normal(beams)
    ranges = np.where(ranges < 12.0, ranges + noise, 13.0)
    return LaserScan(
        angle_min=-math.pi,
        angle_max=math.pi - math.tau / beams,
        angle_increment=math.tau / beams,
        range_min=0.05,
        range_max=12.0,
        ranges=tuple(ranges.tolist()),
    )


def planner_of(config):
    config = FollowerConfig(planner=PlannerConfig(samples=400), **config)
    return config, Planner(config, DRIVE, BODY, CAMERA, seed=1)


def standing(place, velocity=(0.0, 0.0)):
    return Estimate(Pose2D(*place), Twist2D(*velocity), NO_NOISE)


def follow(seconds, circles, walkers=(), **config):
    """Yield robot, person, the plan and the least gap of each tick; the person walks along x.

    The robot is a circle about its rectangle here. `walkers` are (x, y, vx, vy) at time 0.
    """
    config, planner = planner_of(config)
    view = FieldOfView(math.radians(22.5))
    law = PolarController(config.standoff, config.control, DRIVE, view)
    person, twist = standing((0.0, 0.0, 0.0), (0.6, 0.0)), Twist2D()
    robot = config.standoff.goal(person.pose)
    for tick in range(round(seconds / TICK)):
        time = tick * TICK
        now = [(x + vx * time, y + vy * time) for x, y, vx, vy in walkers]
        if tick % 2 == 0:
            around = [*circles, *legs(person.pose.x, person.pose.y)]
            around += [leg for place in now for leg in legs(*place)]
            planner.see(time, scan(robot, around), robot)
        goal = config.standoff.goal(person.pose)
        velocity = config.standoff.goal_velocity(person.pose, person.velocity)
        nominal = law.command(goal, velocity, robot, TICK)
        command = planner.command(time, TICK, person, robot, nominal)
        if command is not nominal:
            law.resume(command)
        twist = DRIVE.step(twist, command, 2.0, TICK)
        robot = robot.integrate(twist, TICK)
        person = person.after(TICK)
        things = [*circles, *((*place, 0.2) for place in now)]
        gaps = [math.dist(robot[:2], (x, y)) - radius for x, y, radius in things]
        yield robot, person.pose, planner.plan.state, min(gaps, default=math.inf)


def still(x, y, yaw=0.0):
    """Return a path of some steps on which a robot stands."""
    poses = [np.full((STEPS, 1), value) for value in (x, y, math.cos(yaw), math.sin(yaw))]
    return Rollout(*poses, np.zeros((STEPS, 3, 1)))


def situation(points=NOTHING, person=(0.0, 0.0, 0.0), walkers=None):
    """Return a person who stands, and what else is there; the goal is 1.2 m behind the origin."""
    places, goals = np.tile(person, (STEPS, 1)), np.tile((-1.2, 0.0, 0.0), (STEPS, 1))
    hiding = np.broadcast_to(points, (STEPS, *points.shape))
    shadows = Shadows(places[:, :2], hiding, np.full(len(points), 0.05))
    walkers = np.empty((STEPS, 0, 2)) if walkers is None else walkers
    return Situation(places, goals, walkers, points, shadows)
