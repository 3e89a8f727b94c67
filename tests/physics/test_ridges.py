"""Robots cross sills and ramps, and feel patches of other friction."""

import math

import numpy as np
import pytest
from mecazen.config.world import Door, Patch, Ramp, Ridge, Wall
from mecazen.geometry import Pose2D, Twist2D
from mecazen_physics.ridges import Profile
from mecazen_physics.world import GRAVITY
from physics_rig import Rig, masses, wheel_speeds

STEEP = math.atan(0.08)


def test_distances_from_a_ridge_are_those_by_hand():
    profile = Profile(Ridge(Pose2D(1.0, 2.0, math.pi / 2), 0.2, 0.1, 0.02, 1.0))
    points = {
        (1.3, 2.01, 0.05): (0.03, (0.0, 1.0)),  # above the top
        (1.0, 2.28, 0.04): (0.05, (0.6, 0.8)),  # off the foot, which is at y = 2.25
        (1.6, 2.0, 0.05): (math.inf, None),  # beside it
        (1.0, 2.15, 0.11): (0.1 * 10 / math.hypot(10, 1), (1 / math.hypot(10, 1), 0)),  # slope
    }
    distances, ways = profile.nearest(np.array([*points]))
    for number, (distance, way) in enumerate(points.values()):
        assert distances[number] == pytest.approx(distance, abs=1e-12)
        if way is not None:
            assert ways[number][0] == pytest.approx(way[0], abs=1e-12)
    pose = profile.plane(np.array((1.0, 2.28, 0.04)), 0.05, ways[1]).matrix()
    assert pose[:3, 2] == pytest.approx((0.0, 0.6, 0.8))
    assert pose[:3, 3] == pytest.approx((1.0, 2.25, 0.0))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi / 4], ids=["ahead", "aside", "aslant"])
def test_robot_crosses_a_sill_straight(nexus, yaw):
    sill = 0.01
    wall = Wall(points_m=((0.0, -2.0), (0.0, 2.0)), doors=(Door(at_m=2, width_m=2, sill_m=sill),))
    rig = Rig(nexus, Pose2D(-0.3, 0.0, yaw), walls=(wall,), dt_s=0.002)
    ahead = Twist2D(0.4 * math.cos(yaw), -0.4 * math.sin(yaw))
    speeds, states = wheel_speeds(nexus, ahead), []
    for tick in range(170):
        states.append(rig.advance([min(1.0, tick / 20) * s for s in speeds], steps=5))
    last = states[-1]
    assert last.position[0] > 0.3
    # edges push rollers aside, by less than a quarter of their wheel's width
    assert last.position[1] == pytest.approx(0.0, abs=0.01)
    assert last.yaw == pytest.approx(yaw, abs=math.radians(0.5))
    assert abs(last.position[2]) < 1e-3
    # one axle, or side, is on it at a time: half of its height, and a little hop off its bevels
    assert max(s.position[2] for s in states) == pytest.approx(sill / 2, abs=0.0015)


def test_ramp_gives_the_expected_speed_attitude_and_work(nexus):
    ramp = Ramp(length_m=1.0, width_m=0.8, rise_m=0.08, landing_m=0.5, position_m=(0.0, 0.0))
    rig = Rig(nexus, Pose2D(-1.47), ramps=(ramp,), dt_s=0.002)
    states = [rig.advance(wheel_speeds(nexus, Twist2D(0.5)), steps=2) for _ in range(475)]
    up = [s for s in states if -1.0 < s.position[0] < -0.55]
    pitches = [2.0 * math.asin(s.orientation[1]) for s in up]
    assert np.mean(pitches) == pytest.approx(-STEEP, rel=0.01)
    assert np.mean([s.linear[0] for s in up]) == pytest.approx(0.5, rel=0.005)
    work = sum(sum(np.multiply(s.joint_effort[:4], s.joint_velocity[:4])) for s in up) * 0.004
    rise = up[-1].position[2] - up[0].position[2]
    assert rise == pytest.approx(0.08 * (up[-1].position[0] - up[0].position[0]), abs=1e-4)
    # what the motors do is lifting; rollers lose some where they hand over, as on level ground,
    # 4 % more or less by where they are at the start
    assert work == pytest.approx(masses(nexus)[0] * GRAVITY * rise, rel=0.1)
    before = rig.advance([0.0] * 4, steps=100).position
    rested = rig.advance([0.0] * 4, steps=100)
    assert rested.tilt == pytest.approx(STEEP, abs=1e-3)
    assert math.dist(rested.position, before) < 1e-4  # locked wheels hold it, without creeping


def test_locked_wheels_brake_by_the_patchs_friction(nexus):
    patch = Patch(size_m=(4.0, 2.0), position_m=(2.3, 0.0), friction=0.2)
    rig = Rig(nexus, patches=(patch,))
    rig.drive(wheel_speeds(nexus, Twist2D(1.0)), 1.5)
    assert rig.state().position[0] > 0.5  # all wheels are on it
    rig.advance([0.0] * 4, steps=30)
    before = rig.state()
    after = rig.advance([0.0] * 4, steps=200)
    slowed = (before.linear[0] - after.linear[0]) / 0.2
    # a roller resists along its axis alone
    assert slowed == pytest.approx(0.2 * GRAVITY / math.sqrt(2.0), rel=0.01)
