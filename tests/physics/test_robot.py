"""A robot in the world: at rest, driven, and stopped before its state diverges."""

import math
import re

import numpy as np
import pytest
from harness import load_robot
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot
from mecazen.rollers import lateral_gain, yaw_gain
from mecazen_physics.state import DivergedError
from msgspec.structs import replace
from physics_rig import Rig, wheel_speeds

FORWARD, LEFT, TURN = Twist2D(x=0.3), Twist2D(y=0.3), Twist2D(yaw=0.6)


def test_new_world_rests_at_the_start_pose(robot):
    start = Pose2D(1.5, -2.0, 2.5)
    rig = Rig(robot, start)
    state = rig.state()
    assert state.position == (start.x, start.y, 0.0)
    assert state.yaw == pytest.approx(start.yaw, abs=1e-15)
    assert state.orientation[:2] == (0.0, 0.0)
    assert set(state.linear + state.angular) == {0.0}
    assert {*state.joint_position, *state.joint_velocity, *state.joint_effort} == {0.0}
    for _ in range(30):
        state = rig.advance([0.0] * 4)
        # It starts in contact, so nothing falls: 1 µm is the depth of resting contacts.
        assert state.position == pytest.approx((start.x, start.y, 0.0), abs=1e-6)


def with_rollers(angle_deg: float, arrangement: str) -> Robot:
    """Return nexus with other rollers; it is not square, so it can turn in the arrangement O."""
    nexus = load_robot()
    rollers = replace(nexus.rollers, angle_deg=angle_deg, arrangement=arrangement, count=12)
    wheels = replace(nexus.wheels, wheelbase_m=0.42, track_m=0.28)
    return replace(nexus, rollers=rollers, wheels=wheels)


@pytest.mark.parametrize(
    ("robot", "twist"),
    [
        (load_robot("nexus"), FORWARD),
        (load_robot("nexus"), TURN),
        (load_robot("artbul"), LEFT),
        (load_robot("slant"), TURN),
        (with_rollers(30.0, "O"), LEFT),
        (with_rollers(60.0, "X"), TURN),
    ],
)
def test_motion_has_the_gain_of_the_rollers_geometry(robot, twist):
    states = Rig(robot).drive(wheel_speeds(robot, twist), 2.0)[100:]
    before, after = states[0], states[-1]
    moved = (*np.subtract(after.position, before.position)[:2], after.yaw - before.yaw)
    gains = np.array((1.0, lateral_gain(robot.rollers.count), yaw_gain(robot)))
    # 1 % is required. Nothing but the hand-over between rollers, whose axes differ, and of slant
    # wheels that strain each other, makes a difference. Contacts wander by 5 mm.
    expected = gains * twist * 0.99
    assert moved == pytest.approx(expected, rel=0.01, abs=5e-3 if twist.yaw else 1e-3)
    heights = [state.position[2] for state in states]
    assert max(heights) - min(heights) < 1e-3 * robot.wheels.radius_m


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda robot: robot.setVelocity(8, math.nan), "not finite"),
        (lambda robot: robot.setPosition(5, -0.2), "below the ground"),
        (lambda robot: robot.setPosition(4, math.nan), "moved"),
    ],
)
def test_divergence_error_contains_the_last_good_state(nexus, spoil, reason):
    rig = Rig(nexus, Pose2D(1.0, 2.0, 0.0))
    rig.advance([0.0] * 4, 10)
    spoil(rig.body.skeleton)
    with pytest.raises(DivergedError, match=reason) as caught:
        rig.advance([0.0] * 4, 10)
    good = re.search(r"last good state at 0\.010 s: position \(([^,]*),", str(caught.value))
    assert good
    assert float(good[1]) == pytest.approx(1.0)
    assert rig.state().time == pytest.approx(0.01)
