"""The follower on the bus: which samples make up its ticks, and what no payload can do to it."""

import pytest
from follower.walks import AHEAD, ORIGIN, PROPORTIONAL
from harness import Rig, load_robot
from hostile import forged, malformed
from mecazen import keys
from mecazen import messages as m
from mecazen.config import FollowerConfig, Scenario, SimConfig
from mecazen.covariance import diagonal_covariance
from mecazen.geometry import Pose2D, Twist2D
from mecazen_follower.estimators import ESTIMATORS

NEXT_RUN = 2**32 - 1
ALL = ("physics", "controller", "target", "follower")
NO_TARGET = ("physics", "controller", "follower")


class Follower(Rig):
    """A follower that drives at 1 m/s for each metre that is missing."""

    def __init__(self, estimator="none", services=ALL):
        config = FollowerConfig(estimator=estimator, control=PROPORTIONAL)
        lockstep = SimConfig(mode="lockstep")
        scenario = Scenario(load_robot(), services=services, sim=lockstep, follower=config)
        super().__init__("follower", scenario, keys.FOLLOWER_STATE, keys.CMD_VEL)

    def odom(self, tick, robot=ORIGIN, run=1):
        stamp = self.at(tick, run)
        odom = m.planar_odometry(stamp.time, "odom", "base_link", robot, Twist2D())
        return self.put(keys.ODOM, odom, stamp)

    def frame(self, tick, person=None, run=1):
        """Publish what is seen at a tick; return what comes of it."""
        stamp = self.at(tick, run)
        poses = () if person is None else (m.PoseWithCovariance(m.Pose.planar(person)),)
        frame = m.Observation(m.Header(stamp.time, "base_link"), poses)
        return self.put(keys.OBSERVATION, frame, stamp)


def answer_of(heard):
    """Return estimate and command of the one tick that was answered."""
    state, command = heard
    assert (state.key, command.key) == ("follower/state", "cmd_vel")
    assert command.stamp == state.stamp
    estimate = state.message.estimate
    return estimate and estimate[0].pose.pose.to_planar(), command.message.to_planar()


def test_a_tick_with_a_frame_waits_for_both_and_another_is_answered_at_once():
    rig = Follower()
    assert rig.odom(0) == []
    assert answer_of(rig.frame(0)) == ((), Twist2D())
    for tick in (1, 2, 3):
        assert answer_of(rig.odom(tick)) == ((), Twist2D())
    assert rig.frame(4, AHEAD) == []
    heard = rig.odom(4)
    assert answer_of(heard) == (pytest.approx(AHEAD), pytest.approx((0.5, 0.0, 0.0)))
    assert heard[0].stamp == rig.at(4)


def test_without_a_target_no_tick_waits_and_a_frame_without_stamp_and_time_is_of_now():
    rig = Follower(services=NO_TARGET)
    rig.odom(6)
    rig.bus.put_bytes(
        "target/observation",
        b'{"header":{"frame_id":"base_link"},"poses":[{"pose":{"position":{"x":1.5}}}]}',
    )
    assert rig.take() == []
    estimate, command = answer_of(rig.odom(7, Pose2D(1.0)))
    assert estimate == pytest.approx((2.5, 0.0, 0.0))
    assert command == pytest.approx((0.5, 0.0, 0.0))
    assert len(rig.odom(8)) == 2


def test_with_a_controller_that_is_back_the_person_is_looked_for_anew():
    rig = Follower("kf_cv")
    rig.odom(0)
    assert answer_of(rig.frame(0, AHEAD))[0] == pytest.approx(AHEAD)
    for alive in (True, False, True):
        rig.bus.presence.update("controller", alive=alive)
    # within what a robot may do in this time, so no jump that shows
    elsewhere = Pose2D(0.4, 0.3, 0.2)
    rig.odom(20, elsewhere)
    assert answer_of(rig.frame(20)) == ((), Twist2D())
    rig.odom(24, elsewhere)
    estimate, _ = answer_of(rig.frame(24, AHEAD))
    assert estimate == pytest.approx(elsewhere.compose(AHEAD), abs=1e-6)


ODOM = m.planar_odometry(m.Time(1), "odom", "base_link", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1))
GOOD = {
    "odom": [ODOM],
    "target/observation": [
        m.Observation(
            m.Header(m.Time(0, 10_000_000), frame),
            (m.PoseWithCovariance(m.Pose.planar(Pose2D(2.0, 1.0, 0.5)), covariance),),
        )
        for frame in ("base_link", "world")
        for covariance in (
            (0.0,) * 36,
            diagonal_covariance((0.01, 0.02, 0.0, 0.0, 0.0, 0.03)),
            diagonal_covariance((1e12, 1e-12, 0.0, 0.0, 0.0, 1.0)),
        )
    ],
}


@malformed(GOOD)
def test_malformed_payloads_change_nothing_for_the_run(wrong):
    rig = Follower()
    rig.odom(0)
    rig.frame(0, AHEAD)
    assert rig.put_wrong(wrong) == []
    rig.odom(4, Pose2D(0.1))
    estimate, command = answer_of(rig.frame(4, Pose2D(1.5, 0.2)))
    assert estimate == pytest.approx((1.6, 0.2, 0.0))
    assert command == pytest.approx((0.5, 0.2, 0.0))


@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
@forged(GOOD, max_examples=40)
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(
    estimator, wrong
):
    rig = Follower(estimator)
    rig.odom(0)
    rig.frame(0, AHEAD)
    for sample in rig.put_wrong(wrong):
        if sample.key == "cmd_vel":
            assert max(map(abs, sample.message.to_planar())) <= 2.0
    rig.odom(0, Pose2D(0.1), NEXT_RUN)
    estimate, command = answer_of(rig.frame(0, Pose2D(1.5, 0.2), NEXT_RUN))
    assert estimate == pytest.approx((1.6, 0.2, 0.0))
    assert command == pytest.approx((0.5, 0.2, 0.0))
