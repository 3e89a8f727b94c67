"""The follower goes on with other parameters: what it knows of the person and the robot stays."""

import msgspec
import pytest
from follower.test_node import Follower
from follower.walks import ORIGIN, PROPORTIONAL
from mecazen.config.follower import LinearGains, PidControl, PlannerConfig, PolarControl
from mecazen.geometry import Pose2D

PERSON = Pose2D(1.5, 0.3, 0.2)


def with_follower(scenario, **settings):
    """The scenario with other settings of its follower."""
    section = msgspec.structs.replace(scenario.follower, **settings)
    return msgspec.structs.replace(scenario, follower=section)


def drive(follower, ticks):
    """What it commands while it goes along x past somebody who stands."""
    made = []
    for tick in ticks:
        robot = Pose2D(0.002 * tick)
        made.append(follower.tick(tick, robot, robot.between(PERSON) if tick % 4 == 0 else None))
    return made


@pytest.mark.parametrize(
    "settings",
    [
        {"control": PolarControl(), "estimator": "imm"},
        {"control": PidControl(), "response_s": 0.05},
        {"planner": PlannerConfig(samples=100)},
    ],
    ids=["polar", "pid", "planner"],
)
def test_a_change_that_changes_nothing_changes_no_bit(settings):
    told, kept = Follower(**settings), Follower(**settings)
    assert drive(told, range(30)) == drive(kept, range(30))
    told.node.configure(msgspec.structs.replace(told.node.scenario))
    assert drive(told, range(30, 60)) == drive(kept, range(30, 60))


def test_it_drives_to_another_place_at_once_and_still_knows_the_person():
    follower = Follower(estimator="kf_cv")
    _, before = drive(follower, range(20))[-1]
    follower.node.configure(with_follower(follower.node.scenario, standoff_m=1.5, view="front"))
    command, after = follower.tick(20, Pose2D(0.04))
    assert after.tracking == before.tracking == "following"
    assert after.estimate[0].pose.pose.to_planar() == pytest.approx(PERSON, abs=1e-3)
    # by 1.5 m ahead of the person instead of 1 m behind, and looking back
    forward = PERSON.compose(Pose2D(1.5))
    assert after.goal[0].to_planar()[:2] == pytest.approx(forward[:2], abs=2e-3)
    assert command.x == PROPORTIONAL.x.limit  # more than 2 m are missing


def test_other_gains_count_from_the_next_tick_on_and_keep_the_integral():
    """With kp doubled the proportional part doubles; what was integrated stays."""
    gains = {"kp": 1.0, "ki": 1.0, "limit": 100.0}
    follower = Follower(control=PidControl(x=LinearGains(**gains), feed_forward=False))
    for tick in range(100):
        command, _ = follower.tick(tick, ORIGIN, Pose2D(1.5) if tick % 4 == 0 else None)
    # the goal is 0.5 m ahead, for 1 s
    assert command.x == pytest.approx(0.5 + 0.5)
    control = PidControl(x=LinearGains(**{**gains, "kp": 2.0}), feed_forward=False)
    follower.node.configure(with_follower(follower.node.scenario, control=control))
    command, _ = follower.tick(100, ORIGIN, Pose2D(1.5))
    assert command.x == pytest.approx(1.0 + 0.5 + 0.005)
