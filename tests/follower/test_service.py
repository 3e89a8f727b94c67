"""The follower on the bus: what it answers to odometry and observations."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import pytest
from harness import (
    FORGED,
    FUZZ,
    NO_STAMP,
    Listener,
    Put,
    Sample,
    assert_sendable,
    load_robot,
    put_all,
    puts,
)
from hypothesis import given, settings
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import Scenario, SensorConfig, SimConfig
from mecazen.covariance import diagonal_covariance
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import (
    FollowerState,
    Header,
    Observation,
    Pose,
    PoseWithCovariance,
    Time,
    Twist,
    planar_odometry,
)
from mecazen.wire import Stamp
from mecazen_follower.config import AngularGains, FollowerConfig, LinearGains, PidControl
from mecazen_follower.estimators import ESTIMATORS
from mecazen_follower.service import FollowerService

RUN, NEXT_RUN = 5, 2**32 - 1
TICK_NS = 10_000_000
NEXUS = load_robot()
ORIGIN = Pose2D()
ALL = ("physics", "controller", "target", "follower")
NO_TARGET = ("physics", "controller", "follower")
PROPORTIONAL = PidControl(
    x=LinearGains(kp=1.0, ki=0.0, limit=2.0),
    y=LinearGains(kp=1.0, ki=0.0, limit=2.0),
    yaw=AngularGains(kp=1.0, ki=0.0, limit=2.0),
)
RAW = FollowerConfig(estimator="none", control=PROPORTIONAL)
"""Takes what it sees as it is, and drives at 1 m/s for each metre that is missing."""


class Rig:
    """A follower, and the controller and the target that it hears."""

    def __init__(
        self,
        config: FollowerConfig = RAW,
        *,
        sensor: SensorConfig | None = None,
        services: Sequence[str] = ALL,
        mode: Any = "lockstep",
    ) -> None:
        self.bus = LocalBus()
        self.service = FollowerService(
            self.bus,
            Scenario(
                robot=NEXUS,
                services=tuple(services),
                sim=SimConfig(mode=mode),
                sensor=sensor or SensorConfig(),
                sections={"follower": config},
            ),
        )
        self.odometry = self.bus.publisher(keys.ODOM)
        self.observation = self.bus.publisher(keys.OBSERVATION)
        self.heard = Listener(self.bus, keys.CMD_VEL, keys.FOLLOWER_STATE)
        self.health = Listener(self.bus, keys.diagnostics("follower"))

    def odom(self, tick: int, robot: Pose2D = ORIGIN, run: int = RUN) -> list[Sample]:
        """Publish the robot's odometry of a tick; return what comes of it."""
        stamp = Stamp(tick * TICK_NS, run, 0)
        self.odometry.put(planar_odometry(stamp.time, "odom", "base_link", robot, Twist2D()), stamp)
        return self.listen()

    def see(
        self,
        tick: int,
        person: Pose2D | None,
        *,
        captured: int | None = None,
        run: int = RUN,
        frame_id: str = "base_link",
        covariance: tuple[float, ...] = (0.0,) * 36,
        foreign: bool = False,
    ) -> list[Sample]:
        """Publish the frame of a tick, empty without a person; return what comes of it."""
        time = Time.from_ns((tick if captured is None else captured) * TICK_NS)
        seen = () if person is None else (PoseWithCovariance(Pose.planar(person), covariance),)
        stamp: Any = None if foreign else Stamp(tick * TICK_NS, run, 0)
        self.observation.put(Observation(Header(time, frame_id), seen), stamp)
        return self.listen()

    def tick(
        self, tick: int, robot: Pose2D = ORIGIN, person: Pose2D | None = None, run: int = RUN
    ) -> tuple[Twist2D, FollowerState]:
        """Let a tick pass, with its frame if it brings one; return command and state."""
        heard = self.odom(tick, robot, run)
        if tick % 4 == 0:
            heard += self.see(tick, person, run=run)
        return answer_of(heard)

    def listen(self) -> list[Sample]:
        self.bus.spin()
        return self.heard.take()


def answer_of(heard: Sequence[Sample]) -> tuple[Twist2D, FollowerState]:
    state, command = heard
    assert (state.key, command.key) == ("follower/state", "cmd_vel")
    assert command.stamp == state.stamp
    return command.message.to_planar(), state.message


def estimate_of(state: FollowerState) -> Pose2D:
    return state.estimate[0].pose.pose.to_planar()


def test_a_tick_that_brings_no_frame_is_answered_at_once():
    rig = Rig()
    state, command = rig.odom(1)
    assert (state.key, command.key) == ("follower/state", "cmd_vel")
    assert command.stamp == state.stamp == Stamp(TICK_NS, RUN, 0)
    assert command.message == Twist()
    assert state.message.header == Header(Time(nanosec=TICK_NS), "odom")


@pytest.mark.parametrize("order", ["odom first", "frame first"])
def test_a_tick_that_brings_a_frame_waits_for_both(order: str):
    rig = Rig()
    ahead = Pose2D(1.5, 0.0, 0.0)
    if order == "odom first":
        assert rig.odom(4) == []
        heard = rig.see(4, ahead)
    else:
        assert rig.see(4, ahead) == []
        heard = rig.odom(4)
    command, state = answer_of(heard)
    assert command == pytest.approx((0.5, 0.0, 0.0))  # half a metre too far behind
    assert state.tracking == "following"
    assert heard[0].stamp == Stamp(4 * TICK_NS, RUN, 0)


def test_an_empty_frame_ends_the_wait_as_well():
    rig = Rig()
    rig.odom(0)
    command, state = answer_of(rig.see(0, None))
    assert command == Twist2D()
    assert (state.tracking, state.estimate, state.goal) == ("waiting", (), ())


def test_without_a_target_no_tick_waits():
    rig = Rig(services=NO_TARGET)
    assert [len(rig.odom(tick)) for tick in range(5)] == [2] * 5


def test_each_tick_is_answered_once_and_only_with_a_stamp():
    rig = Rig()
    assert rig.odom(3)
    assert rig.odom(3) == rig.odom(2) == []
    rig.bus.put_bytes("odom", b"{}")
    assert rig.listen() == []


def test_what_is_seen_from_base_link_is_placed_in_odom_and_the_errors_are_told():
    rig = Rig()
    # The robot at (1, 2) looks along y; it sees the person 2 m ahead and 1 m to the left,
    # turned by 90° to the left: in odom at (1 - 1, 2 + 2), looking back along x.
    command, state = rig.tick(0, Pose2D(1.0, 2.0, math.pi / 2), Pose2D(2.0, 1.0, math.pi / 2))
    assert state.header.frame_id == "odom"
    assert estimate_of(state) == pytest.approx((0.0, 4.0, math.pi))
    # 1 m behind somebody at (0, 4) who looks along -x is (1, 4): 2 m ahead, and turn left
    assert state.goal[0].to_planar() == pytest.approx((1.0, 4.0, math.pi))
    assert command == pytest.approx((2.0, 0.0, math.pi / 2))
    assert state.distance_error == pytest.approx(math.sqrt(5.0) - 1.0)
    # seen from the person, the robot is 1 m behind and 2 m to the left
    assert state.bearing_error == pytest.approx(math.atan2(2.0, -1.0) - math.pi)
    assert state.heading_error == pytest.approx(-math.pi / 2)
    assert state.estimate[0].child_frame_id == "person"


@pytest.mark.parametrize("frame_id", ["world", "odom"])
def test_what_is_seen_in_world_is_taken_to_be_in_odom(frame_id: str):
    rig = Rig()
    rig.odom(0, Pose2D(1.0, 2.0, math.pi / 2))
    _, state = answer_of(rig.see(0, Pose2D(0.0, 4.0, 3.0), frame_id=frame_id))
    assert estimate_of(state) == pytest.approx((0.0, 4.0, 3.0))


def test_the_estimates_covariance_is_turned_into_odom():
    rig = Rig()
    rig.odom(0, Pose2D(0.0, 0.0, math.pi / 2))
    covariance = diagonal_covariance((0.04, 0.01, 0.0, 0.0, 0.0, 0.09))
    _, state = answer_of(rig.see(0, Pose2D(2.0), covariance=covariance))
    told = state.estimate[0].pose.covariance
    assert told[::7] == pytest.approx((0.01, 0.04, 0.0, 0.0, 0.0, 0.09))


@pytest.mark.parametrize(
    ("view", "goal"),
    [
        ("back", (-1.0, 0.0, 0.0)),
        ("front", (1.0, 0.0, math.pi)),
        ("side_left", (0.0, 1.0, -math.pi / 2)),
        ("side_right", (0.0, -1.0, math.pi / 2)),
    ],
)
def test_every_view_has_its_place_and_looks_at_the_person(view: Any, goal: Sequence[float]):
    rig = Rig(FollowerConfig(view=view, estimator="none", control=PROPORTIONAL))
    place = Pose2D(*goal)
    seen = place.between(ORIGIN)
    assert seen[:2] == pytest.approx((1.0, 0.0))  # 1 m straight ahead of the robot
    command, state = rig.tick(0, place, seen)
    assert state.goal[0].to_planar() == pytest.approx(place)
    assert command == pytest.approx((0.0, 0.0, 0.0))
    errors = (state.distance_error, state.bearing_error, state.heading_error)
    assert errors == pytest.approx((0.0, 0.0, 0.0))


def test_any_other_place_works_too():
    config = FollowerConfig(
        bearing_deg=135.0, heading_deg=-45.0, standoff_m=math.sqrt(2.0), estimator="none"
    )
    _, state = Rig(config).tick(0, ORIGIN, ORIGIN)
    assert state.goal[0].to_planar() == pytest.approx((-1.0, 1.0, -math.pi / 4))


def test_waiting_following_coasting_lost_and_following_again():
    config = FollowerConfig(
        estimator="none", control=PROPORTIONAL, coast_after_s=0.1, lost_after_s=0.5
    )
    rig = Rig(config)
    ahead = Pose2D(1.5)
    told = {}
    for tick in range(121):
        seen = ahead if 8 <= tick <= 20 or tick >= 100 else None
        told[tick] = rig.tick(tick, ORIGIN, seen)
    tracking = [state.tracking for _, state in told.values()]
    assert tracking[:8] == ["waiting"] * 8
    assert tracking[8:31] == ["following"] * 23  # last seen at tick 20, and for 0.1 s more
    assert tracking[31:71] == ["coasting"] * 40
    assert tracking[71:100] == ["lost"] * 29
    assert tracking[100:] == ["following"] * 21
    for tick, (command, state) in told.items():
        driven = state.tracking in ("following", "coasting")
        assert command == pytest.approx((0.5 if driven else 0.0, 0.0, 0.0)), tick
    assert told[50][1].last_seen_s == pytest.approx(0.3)
    assert told[120][1].last_seen_s == 0.0


def test_who_comes_back_elsewhere_is_followed_there_at_once():
    rig = Rig(FollowerConfig(lost_after_s=0.5))
    for tick in range(60):
        rig.tick(tick, ORIGIN, Pose2D(1.0) if tick < 5 else None)
    _, state = rig.tick(60, ORIGIN, Pose2D(3.0, 2.0, 1.0))
    assert state.tracking == "following"
    assert estimate_of(state) == pytest.approx((3.0, 2.0, 1.0))


def test_a_person_who_is_not_seen_is_predicted_to_walk_on():
    rig = Rig(FollowerConfig(estimator="kf_cv"))
    for tick in range(400):
        person = Pose2D(1.0 + 0.002 * tick)
        _, state = rig.tick(tick, ORIGIN, person if tick < 300 else None)
    assert state.tracking == "coasting"
    assert estimate_of(state) == pytest.approx((1.0 + 0.002 * 399, 0.0, 0.0), abs=5e-3)
    assert state.estimate[0].twist.twist.linear.x == pytest.approx(0.2, abs=5e-3)


def test_latency_is_made_up_for_by_the_pose_at_capture():
    rig = Rig(sensor=SensorConfig(latency_s=0.03))
    for tick in range(4):  # the robot drives along x at 1 m/s
        if rig.odom(tick, Pose2D(0.01 * tick)) == []:
            rig.see(tick, None, captured=0)
    rig.odom(4, Pose2D(0.04))
    _, state = answer_of(rig.see(4, Pose2D(2.0), captured=1))
    assert estimate_of(state) == pytest.approx((2.01, 0.0, 0.0))


def test_a_latency_longer_than_the_history_is_no_exception():
    rig = Rig(sensor=SensorConfig(latency_s=6.0))
    for tick in range(604):
        if rig.odom(tick, Pose2D(0.001 * tick)) == []:
            rig.see(tick, None, captured=0)
    rig.odom(604, Pose2D(0.604))
    _, state = answer_of(rig.see(604, Pose2D(2.0), captured=4))
    assert estimate_of(state) == pytest.approx((2.004, 0.0, 0.0))


def test_a_late_frame_is_taken_in_at_the_next_tick_with_the_pose_of_its_capture():
    rig = Rig(mode="real_time")
    assert rig.odom(4, Pose2D(0.1)) == []
    closing, _, *now = rig.odom(5, Pose2D(0.2))  # the frame of tick 4 has not come
    assert closing.stamp == Stamp(4 * TICK_NS, RUN, 0)
    assert answer_of(now)[1].tracking == "waiting"
    assert rig.see(4, Pose2D(2.0)) == []
    _, state = answer_of(rig.odom(6, Pose2D(0.3)))
    assert state.tracking == "following"
    assert estimate_of(state) == pytest.approx((2.1, 0.0, 0.0))
    assert rig.service.diagnostics()["late_frames"] == 1


def test_a_frame_of_somebody_elses_without_a_stamp_is_used():
    rig = Rig(services=NO_TARGET)
    rig.odom(6)
    rig.bus.put_bytes(
        "target/observation",
        json.dumps(
            {"header": {"frame_id": "base_link"}, "poses": [{"pose": {"position": {"x": 1.5}}}]}
        ).encode(),
    )
    assert rig.listen() == []
    command, state = answer_of(rig.odom(7, Pose2D(1.0)))
    assert estimate_of(state) == pytest.approx((2.5, 0.0, 0.0))
    assert command == pytest.approx((0.5, 0.0, 0.0))


def test_lockstep_with_a_target_hears_no_outsiders_frame():
    rig = Rig()
    rig.see(1, Pose2D(9.0), foreign=True)
    assert answer_of(rig.odom(1))[1].tracking == "waiting"


def test_in_real_time_an_outsiders_frame_does_not_make_the_tick_wait_in_vain():
    rig = Rig(mode="real_time")
    assert rig.see(4, Pose2D(1.0)) == []
    assert rig.see(4, Pose2D(2.0), foreign=True) == []
    assert answer_of(rig.odom(4))[1].tracking == "following"


@pytest.mark.parametrize(
    "covariance",
    [
        diagonal_covariance((-1.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
        diagonal_covariance((1e300, 1.0, 0.0, 0.0, 0.0, 1.0)),
        (0.0, 1.0, *(0.0,) * 34),
    ],
)
@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
def test_a_covariance_that_is_none_is_refused_and_the_estimate_stays(
    covariance: tuple[float, ...], estimator: str
):
    rig = Rig(FollowerConfig(estimator=estimator, control=PROPORTIONAL))
    rig.tick(0, ORIGIN, Pose2D(1.5))
    rig.odom(4)
    command, state = answer_of(rig.see(4, Pose2D(7.0), covariance=covariance))
    assert rig.bus.refused == {"target/observation": 1}
    assert estimate_of(state) == pytest.approx((1.5, 0.0, 0.0), abs=1e-6)
    assert command.x == pytest.approx(0.5, abs=1e-6)
    for tick in (8, 12):
        rig.tick(tick, ORIGIN, Pose2D(1.5))
    assert rig.bus.refused == {"target/observation": 1}


def test_a_covariance_too_large_to_be_turned_is_refused():
    rig = Rig()
    rig.odom(0, Pose2D(yaw=0.5))
    _, state = answer_of(rig.see(0, Pose2D(1.0), covariance=(1.797e308,) * 36))
    assert state.tracking == "waiting"
    assert rig.bus.refused == {"target/observation": 1}


def test_a_person_farther_than_any_is_refused():
    rig = Rig()
    _, state = rig.tick(0, ORIGIN, Pose2D(1e308, 1e308))
    assert state.tracking == "waiting"
    assert rig.bus.refused == {"target/observation": 1}


def test_an_odometry_farther_than_any_is_refused_and_the_next_good_one_is_used():
    rig = Rig()
    rig.tick(0, ORIGIN, Pose2D(1.5))
    assert rig.odom(1, Pose2D(1e308, 0.0)) == []
    assert rig.bus.refused == {"odom": 1}
    command, _ = rig.tick(2)
    assert command == pytest.approx((0.5, 0.0, 0.0))


@pytest.mark.parametrize("jump", [Pose2D(5.0, 5.0, 0.0), Pose2D(0.0, 0.0, math.pi / 2)])
def test_when_the_odometry_is_set_anew_the_person_is_sought_anew(jump: Pose2D):
    rig = Rig(FollowerConfig(estimator="kf_cv"))
    for tick in range(41):
        rig.tick(tick, ORIGIN, Pose2D(1.5))
    command, state = rig.tick(41, jump)
    assert state.estimate == ()
    assert command == Twist2D()
    rig.odom(44, jump)
    _, state = answer_of(rig.see(44, Pose2D(1.5)))
    assert estimate_of(state) == pytest.approx(jump.compose(Pose2D(1.5)))
    assert state.estimate[0].twist.twist.to_planar() == pytest.approx((0.0, 0.0, 0.0))


def test_odometry_rarer_than_frames_waits_for_the_newest_frame_before_it():
    rig = Rig()
    rig.odom(0)
    assert len(rig.see(0, Pose2D(2.0))) == 2
    assert rig.odom(6) == []  # the frame of tick 4 is still on its way
    assert len(rig.see(4, Pose2D(2.0))) == 2
    assert len(rig.odom(7)) == 2  # no frame has come due since


def test_missed_ticks_are_no_jump_of_the_odometry():
    rig = Rig(mode="real_time")
    rig.tick(0, ORIGIN, Pose2D(2.0))
    _, state = rig.tick(60, Pose2D(0.6))
    assert estimate_of(state) == pytest.approx((2.0, 0.0, 0.0))


def test_who_joins_late_makes_up_for_nothing():
    control = PidControl(x=LinearGains(kp=1.0, ki=1.0, limit=2.0))
    rig = Rig(FollowerConfig(estimator="none", control=control))
    command, _ = rig.tick(1000, ORIGIN, Pose2D(1.5))
    assert command == pytest.approx((0.5 + 0.5 * 0.01, 0.0, 0.0))  # not 10 s of integral
    command, _ = rig.tick(1001)
    assert command.x == pytest.approx(0.5 + 0.5 * 0.02)
    command, _ = rig.tick(1003)  # one was missed
    assert command.x == pytest.approx(0.5 + 0.5 * 0.04)


def test_a_new_run_forgets_the_person():
    rig = Rig()
    rig.tick(0, ORIGIN, Pose2D(1.5))
    _, state = rig.tick(1, run=RUN + 1)
    assert (state.tracking, state.estimate) == ("waiting", ())
    assert rig.odom(2) == rig.see(4, Pose2D(1.5)) == []  # still on their way from before
    assert rig.tick(4, person=Pose2D(1.5), run=RUN + 1)[0].x == pytest.approx(0.5)


def test_the_frame_of_a_new_run_may_come_before_its_odom():
    rig = Rig()
    rig.tick(0, ORIGIN, Pose2D(1.0))
    assert rig.see(0, Pose2D(1.5), run=RUN + 1) == []
    assert answer_of(rig.odom(0, run=RUN + 1))[0].x == pytest.approx(0.5)


def test_the_truth_is_never_read():
    heard: list[str] = []

    class Eavesdropped(LocalBus):
        def subscribe(self, topic: Any, handler: Any, *, every: bool = False) -> None:
            heard.append(topic.key)
            super().subscribe(topic, handler, every=every)

    FollowerService(Eavesdropped(), Scenario(robot=NEXUS))
    assert set(heard) - {"clock"} == {"odom", "target/observation"}


def test_with_a_controller_that_is_back_the_person_is_looked_for_anew():
    rig = Rig(FollowerConfig(estimator="kf_cv"))
    for tick in range(9):
        _, before = rig.tick(tick, ORIGIN, Pose2D(1.5))
    rig.bus.presence.update("controller", alive=True)
    rig.bus.presence.update("controller", alive=False)
    rig.bus.presence.update("controller", alive=True)
    # within what a robot may do in this time, so no jump that shows
    elsewhere = Pose2D(0.4, 0.3, 0.2)
    rig.odom(29, elsewhere)
    _, lost = answer_of(rig.see(29, None))
    _, found = rig.tick(32, elsewhere, Pose2D(1.5))
    assert (before.tracking, lost.tracking, found.tracking) == ("following", "waiting", "following")
    seen = elsewhere.compose(Pose2D(1.5))
    assert found.estimate[0].pose.pose.to_planar() == pytest.approx(seen, abs=1e-6)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_after_a_gap_in_which_the_person_would_be_lost_they_are_looked_for_anew(estimator):
    rig = Rig(FollowerConfig(estimator=estimator))
    for tick in range(9):
        _, before = rig.tick(tick, ORIGIN, Pose2D(1.5))
    rig.odom(2**31 * 100 - 3)  # the latest time there is: no estimator may go there step by step
    _, after = answer_of(rig.see(2**31 * 100 - 3, None))
    assert (before.tracking, after.tracking) == ("following", "waiting")


def test_diagnostics_tell_late_frames_the_filters_consistency_and_what_was_refused():
    rig = Rig(FollowerConfig(estimator="kf_cv"))
    for tick in range(101):
        rig.tick(tick, ORIGIN, Pose2D(1.5))
        rig.bus.put_bytes("odom", b"[")
    health = [sample.message.status[0] for sample in rig.health.take()]
    first, last = ({value.key: value.value for value in status.values} for status in health)
    assert first == {
        "late_frames": "0",
        "nis": "None",
        "missed_ticks": "0",
        "refused_payloads": "0",
    }
    assert (last["hz/odom"], last["hz/target/observation"]) == ("100.0", "25.0")
    assert (last["late_frames"], last["refused_payloads"]) == ("0", "100")
    assert float(last["nis"]) < 1.0


GOOD = {
    "odom": [planar_odometry(Time(1), "odom", "base_link", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1))],
    "target/observation": [
        Observation(
            Header(Time(0, TICK_NS), frame),
            (PoseWithCovariance(Pose.planar(Pose2D(2.0, 1.0, 0.5)), covariance),),
        )
        for frame in ("base_link", "world")
        for covariance in (
            (0.0,) * 36,
            diagonal_covariance((0.01, 0.02, 0.0, 0.0, 0.0, 0.03)),
            diagonal_covariance((1e12, 1e-12, 0.0, 0.0, 0.0, 1.0)),
        )
    ],
}


@FUZZ
@given(puts(GOOD, NO_STAMP))
def test_malformed_payloads_change_nothing_for_the_run(wrong: list[Put]):
    rig = Rig()
    rig.tick(0, ORIGIN, Pose2D(1.5))
    put_all(rig.bus, wrong)
    assert rig.listen() == []
    command, state = rig.tick(4, Pose2D(0.1), Pose2D(1.5, 0.2))
    assert estimate_of(state) == pytest.approx((1.6, 0.2, 0.0))
    assert command == pytest.approx((0.5, 0.2, 0.0))


@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
@settings(FUZZ, max_examples=40)
@given(wrong=puts(GOOD, FORGED))
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(
    estimator: str, wrong: list[Put]
):
    rig = Rig(FollowerConfig(estimator=estimator, control=PROPORTIONAL))
    rig.tick(0, ORIGIN, Pose2D(1.5))
    put_all(rig.bus, wrong)
    for sample in rig.listen() + rig.health.take():
        assert_sendable(sample)
        if sample.key == "cmd_vel":
            assert max(map(abs, sample.message.to_planar())) <= 2.0
    command, state = rig.tick(0, Pose2D(0.1), Pose2D(1.5, 0.2), NEXT_RUN)
    assert estimate_of(state) == pytest.approx((1.6, 0.2, 0.0))
    assert command == pytest.approx((0.5, 0.2, 0.0))
