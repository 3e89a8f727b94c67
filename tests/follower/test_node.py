"""The follower's node: what it makes of odometry and frames, step by step and on the bus."""

import math

import msgspec
import numpy as np
import pytest
from follower.walks import AHEAD, ORIGIN, PROPORTIONAL
from harness import SCENARIOS, Rig, Steps, error_of, load_robot
from hostile import forged, malformed
from mecazen import keys
from mecazen import messages as m
from mecazen.config import FollowerConfig, Scenario, SensorConfig, SimConfig
from mecazen.config.follower import LinearGains, PidControl, PlannerConfig, PolarControl
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario
from mecazen.messages import diagonal_covariance
from mecazen.programs import graph_of
from mecazen.runtime.live import LiveParameters, refuse_unsuitable
from mecazen_follower.control import PoseController
from mecazen_follower.estimators import ESTIMATORS
from mecazen_follower.following import Following
from mecazen_follower.node import FollowerNode
from mecazen_follower.planner import mppi
from mecazen_follower.tracker import PersonTracker

NEXUS = load_robot()
ZEROS = (0.0,) * 36


class Follower(Steps):
    """Uses observations unfiltered, and drives at 1 m/s for each metre by default."""

    def __init__(self, tick_s=None, latency_s=0.0, **settings):
        config = FollowerConfig(**{"estimator": "none", "control": PROPORTIONAL, **settings})
        sensor = SensorConfig(latency_s=latency_s)
        scenario = Scenario(robot=NEXUS, sensor=sensor, follower=config)
        super().__init__(FollowerNode, scenario, tick_s)

    def tick(
        self, tick, robot=ORIGIN, person=None, *, captured=None, seen_in="base_link", noise=ZEROS
    ):
        """Return command and state of a tick; its frame is empty where no person is given."""
        now = m.Time.from_ns(tick * self.tick_ns)
        samples = {keys.ODOM: m.planar_odometry(now, "odom", "base_link", robot, Twist2D())}
        if person is not None or tick % 4 == 0:
            time = m.Time.from_ns((tick if captured is None else captured) * self.tick_ns)
            poses = () if person is None else (m.PoseWithCovariance(m.Pose.planar(person), noise),)
            samples[keys.OBSERVATION] = m.Observation(m.Header(time, seen_in), poses)
        outputs = self.step(tick, samples)
        assert list(outputs) == [keys.FOLLOWER_STATE, keys.CMD_VEL]
        state = outputs[keys.FOLLOWER_STATE]
        assert state.header == m.Header(now, "odom")
        return outputs[keys.CMD_VEL].to_planar(), state


def estimate_of(state):
    return state.estimate[0].pose.pose.to_planar()


def test_it_stands_and_claims_nothing_before_it_has_seen_anybody():
    follower = Follower()
    assert follower.node.diagnostics() == {"nis": None}
    for tick in range(5):
        command, state = follower.tick(tick)
        assert command == Twist2D()
        assert (state.tracking, state.estimate, state.goal) == ("waiting", (), ())


def test_what_is_seen_from_base_link_is_placed_in_odom_and_the_errors_are_told():
    follower = Follower()
    # The robot at (1, 2) looks along y; it sees the person 2 m ahead and 1 m to the left,
    # turned by 90° to the left: in odom at (1 - 1, 2 + 2), looking back along x.
    robot, person = Pose2D(1.0, 2.0, math.pi / 2), Pose2D(2.0, 1.0, math.pi / 2)
    noise = diagonal_covariance((0.04, 0.01, 0.0, 0.0, 0.0, 0.09))
    command, state = follower.tick(0, robot, person, noise=noise)
    assert estimate_of(state) == pytest.approx((0.0, 4.0, math.pi))
    # 1 m behind a person at (0, 4) who faces -x is (1, 4): 2 m ahead, and turn left
    assert state.goal[0].to_planar() == pytest.approx((1.0, 4.0, math.pi))
    assert command == pytest.approx((2.0, 0.0, math.pi / 2))
    assert state.distance_error == pytest.approx(math.sqrt(5.0) - 1.0)
    # seen from the person, the robot is 1 m behind and 2 m to the left
    assert state.bearing_error == pytest.approx(math.atan2(2.0, -1.0) - math.pi)
    assert state.heading_error == pytest.approx(-math.pi / 2)
    estimate = state.estimate[0]
    assert estimate.child_frame_id == "person"
    assert estimate.pose.covariance[::7] == pytest.approx((0.01, 0.04, 0.0, 0.0, 0.0, 0.09))
    told = {"nis": None, "tracking": "following", "distance_error_m": 1.236}
    assert follower.node.diagnostics() == told
    for frame_id in ("world", "odom"):  # both are taken to be odom
        _, state = Follower().tick(0, robot, person, seen_in=frame_id)
        assert estimate_of(state) == pytest.approx(person)


def test_waiting_following_coasting_lost_and_following_again():
    follower = Follower(coast_after_s=0.1, lost_after_s=0.5)
    seen = [AHEAD if 8 <= tick <= 20 or tick >= 100 else None for tick in range(121)]
    told = [
        follower.tick(tick, person=seen[tick] if tick % 4 == 0 else None) for tick in range(121)
    ]
    tracking = [state.tracking for _, state in told]
    assert tracking[:8] == ["waiting"] * 8
    assert tracking[8:31] == ["following"] * 23  # last seen at tick 20, and for 0.1 s more
    assert tracking[31:71] == ["coasting"] * 40
    assert tracking[71:100] == ["lost"] * 29
    assert tracking[100:] == ["following"] * 21
    for tick, (command, state) in enumerate(told):
        driven = state.tracking in ("following", "coasting")
        assert command == pytest.approx((0.5 if driven else 0.0, 0.0, 0.0)), tick
    assert told[50][1].last_seen_s == pytest.approx(0.3)
    assert told[120][1].last_seen_s == 0.0


@pytest.mark.parametrize("tick_s", [0.01, 0.0123])
def test_at_any_period_a_person_who_is_not_seen_is_predicted_to_walk_on(tick_s):
    follower = Follower(tick_s, estimator="kf_cv")
    for tick in range(400):
        person = Pose2D(1.0 + 0.2 * tick * tick_s)
        seen = person if tick < 300 and tick % 4 == 0 else None
        _, state = follower.tick(tick, person=seen)
    assert state.tracking == "coasting"
    assert state.last_seen_s == pytest.approx(103 * tick_s)
    # what is left of the filter's start
    assert estimate_of(state) == pytest.approx(person, abs=5e-3)
    assert state.estimate[0].twist.twist.linear.x == pytest.approx(0.2, abs=5e-3)
    assert follower.node.diagnostics()["nis"] < 1.0


@pytest.mark.parametrize("latency", [3, 600])  # 6 s: longer than odometry is kept otherwise
def test_a_person_is_placed_by_where_the_robot_was_at_the_capture(latency):
    follower = Follower(latency_s=0.01 * latency)
    for tick in range(latency + 1):
        follower.tick(tick, Pose2D(0.01 * tick))
    _, state = follower.tick(latency + 1, Pose2D(0.0), Pose2D(2.0), captured=1)
    assert estimate_of(state) == pytest.approx((2.01, 0.0, 0.0))


def test_a_frame_from_before_the_first_odometry_is_refused():
    follower = Follower()
    follower.tick(20)
    _, state = follower.tick(21, ORIGIN, AHEAD, captured=19)
    assert (state.tracking, follower.refused) == ("waiting", ["target/observation"])


@pytest.mark.parametrize(
    "noise",
    [diagonal_covariance((-1.0, 1.0, 0.0, 0.0, 0.0, 1.0)), (0.0, 1.0, *(0.0,) * 34)],
    ids=["negative", "asymmetric"],
)
@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
def test_a_covariance_that_is_none_is_refused_and_the_estimate_stays(noise, estimator):
    follower = Follower(estimator=estimator)
    follower.tick(0, person=AHEAD)
    command, state = follower.tick(4, person=Pose2D(7.0), noise=noise)
    assert follower.refused == ["target/observation"]
    assert estimate_of(state) == pytest.approx(AHEAD, abs=1e-6)
    assert command.x == pytest.approx(0.5, abs=1e-6)
    follower.tick(8, person=AHEAD)
    assert follower.refused == ["target/observation"]


def test_a_refused_frame_is_as_if_none_had_come_and_the_step_runs_once(monkeypatch):
    steps, step = [], Following.step
    monkeypatch.setattr(Following, "step", lambda *given: steps.append(1) or step(*given))
    refusing, unseeing = Follower(estimator="imm"), Follower(estimator="imm")
    for follower in (refusing, unseeing):
        follower.tick(0, person=AHEAD)
    steps.clear()
    refused = refusing.tick(1, person=AHEAD, noise=diagonal_covariance((-1.0,) * 6))
    assert (refusing.refused, len(steps)) == (["target/observation"], 1)
    assert refused == unseeing.tick(1)
    assert refusing.tick(4, person=AHEAD) == unseeing.tick(4, person=AHEAD)


@pytest.mark.parametrize(
    ("kind", "method"), [(PersonTracker, "_see"), (PoseController, "command"), (Following, "step")]
)
def test_a_programming_error_is_not_reported_as_a_refused_frame(monkeypatch, kind, method):
    follower = Follower()
    monkeypatch.setattr(kind, method, lambda *_: np.zeros(2) + np.zeros(3))
    with pytest.raises(ValueError, match="shapes"):
        follower.tick(0, person=AHEAD)
    assert follower.refused == []


@pytest.mark.parametrize("jump", [Pose2D(5.0, 5.0, 0.0), Pose2D(0.0, 0.0, math.pi / 2)])
def test_when_the_odometry_is_set_anew_the_person_is_sought_anew(jump):
    follower = Follower(estimator="kf_cv")
    for tick in range(0, 41, 4):
        follower.tick(tick, person=AHEAD)
    command, state = follower.tick(41, jump)
    assert (command, state.estimate) == (Twist2D(), ())
    _, state = follower.tick(44, jump, AHEAD)
    assert estimate_of(state) == pytest.approx(jump.compose(AHEAD))
    assert state.estimate[0].twist.twist.to_planar() == pytest.approx((0.0, 0.0, 0.0))
    _, state = follower.tick(84, Pose2D(jump.x + 0.4, jump.y, jump.yaw))
    assert state.estimate  # motion in missed ticks is no jump


def test_who_joins_late_or_comes_back_after_long_makes_up_for_nothing():
    follower = Follower(control=PidControl(x=LinearGains(kp=1.0, ki=1.0, limit=2.0)))
    for tick in (1000, 2000):
        command, _ = follower.tick(tick, person=AHEAD)
        assert command == pytest.approx((0.5 + 0.5 * 0.01, 0.0, 0.0))  # not 10 s of integral
    command, _ = follower.tick(2001)
    assert command.x == pytest.approx(0.5 + 0.5 * 0.02)
    command, _ = follower.tick(2003)  # one was missed
    assert command.x == pytest.approx(0.5 + 0.5 * 0.04)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_after_a_gap_in_which_the_person_would_be_lost_they_are_looked_for_anew(estimator):
    follower = Follower(estimator=estimator)
    _, before = follower.tick(0, person=AHEAD)
    # the latest time there is: no estimator may go there step by step
    _, after = follower.tick(2**31 * 100 - 3)
    assert (before.tracking, after.tracking) == ("following", "waiting")


def test_after_a_gap_the_planner_keeps_the_seed_of_the_run(monkeypatch):
    seeds, noise = [], mppi.noise
    monkeypatch.setattr(mppi, "noise", lambda _, seed: seeds.append(seed) or noise(100, seed))
    follower = Follower(planner=PlannerConfig())
    follower.reset(7)
    for tick in (0, 10_000):  # 100 s: the person is lost after 2 s
        follower.tick(tick, person=AHEAD)
    assert seeds[-2:] == [7, 7]


def test_a_new_run_forgets_the_person():
    follower = Follower()
    first = follower.tick(0, person=AHEAD)
    follower.reset(1)
    assert follower.tick(1)[1].estimate == ()
    follower.reset(1)
    assert follower.tick(0, person=AHEAD) == first


def scenario(**planner):
    config = FollowerConfig(planner=PlannerConfig(**planner) if planner else None)
    return Scenario(robot=load_robot(), follower=config)


def test_scans_are_taken_where_there_is_a_planner():
    def takes(scenario):
        return keys.SCAN in {i.topic for i in graph_of(scenario).row("follower").inputs}

    assert takes(scenario(samples=200))
    assert not takes(scenario())


def test_a_wrong_setting_is_one_clear_line():
    said = error_of(ConfigError, lambda: FollowerNode(scenario(rate_hz=30.0)))
    assert said.startswith("follower.planner.rate_hz = 30 must divide the tick rate of 100 Hz")
    said = error_of(ValueError, lambda: PlannerConfig(priorities=("distance", "bearing")))
    assert said == (
        "priorities must be distance, visibility, bearing, heading, each once, in any order"
    )


def test_a_standoff_within_the_bodies_is_refused_in_one_line():
    def node(standoff_m):
        config = FollowerConfig(standoff_m=standoff_m)
        return FollowerNode(Scenario(robot=NEXUS, follower=config))

    with pytest.raises(ConfigError) as refused:
        node(0.5)
    assert str(refused.value) == (
        "follower.standoff_m = 0.5 must be at least 0.58: the radii of the person, 0.2, and of "
        "the robot, 0.28, and 0.1 between them"
    )
    node(0.6)


PERSON = Pose2D(1.5, 0.3, 0.2)


def with_follower(scenario, **settings):
    """The scenario with other settings of its follower."""
    section = msgspec.structs.replace(scenario.follower, **settings)
    return msgspec.structs.replace(scenario, follower=section)


def drive(follower, ticks):
    """Return the commands of a robot that moves along x past a standing person."""
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


NEXT_RUN = 2**32 - 1
ALL = ("physics", "controller", "target", "follower")
NO_TARGET = ("physics", "controller", "follower")


class OnBus(Rig):
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
    rig = OnBus()
    assert rig.odom(0) == []
    assert answer_of(rig.frame(0)) == ((), Twist2D())
    for tick in (1, 2, 3):
        assert answer_of(rig.odom(tick)) == ((), Twist2D())
    assert rig.frame(4, AHEAD) == []
    heard = rig.odom(4)
    assert answer_of(heard) == (pytest.approx(AHEAD), pytest.approx((0.5, 0.0, 0.0)))
    assert heard[0].stamp == rig.at(4)


def test_without_a_target_no_tick_waits_and_a_frame_without_stamp_and_time_is_of_now():
    rig = OnBus(services=NO_TARGET)
    for tick in range(7):
        rig.odom(tick)
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
    rig = OnBus("kf_cv")
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
    rig = OnBus()
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
    rig = OnBus(estimator)
    rig.odom(0)
    rig.frame(0, AHEAD)
    for sample in rig.put_wrong(wrong):
        if sample.key == "cmd_vel":
            assert max(map(abs, sample.message.to_planar())) <= 2.0
    rig.odom(0, Pose2D(0.1), NEXT_RUN)
    estimate, command = answer_of(rig.frame(0, Pose2D(1.5, 0.2), NEXT_RUN))
    assert estimate == pytest.approx((1.6, 0.2, 0.0))
    assert command == pytest.approx((0.5, 0.2, 0.0))


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("Blind(Node)", "follower: no effect on my.py:Blind, which takes its place; if it reads"),
        ("Blind(FollowerNode)", None),
        ("Blind(Node, section=FollowerConfig)", None),
    ],
)
def test_settings_that_a_follower_of_ones_own_does_not_read_are_refused(
    program, said, tmp_path, monkeypatch
):
    (tmp_path / "my.py").write_text(
        "from mecazen.config import FollowerConfig\n"
        "from mecazen.node import Node as _Node, Row\n"
        "from mecazen_follower.node import FollowerNode\n"
        "class Node(_Node):\n"
        "    ROW = Row('follower')\n"
        "    def __init_subclass__(cls, section=None): cls.SECTION = section\n"
        f"class {program}:\n"
        "    def reset(self, seed): pass\n"
        "    def step(self, tick, inputs): return {}\n"
    )
    scenario = load_scenario(SCENARIOS / "back.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mecazen.programs._loaded", {})
    programs = {"follower": "my.py:Blind"}
    live = LiveParameters(msgspec.structs.replace(scenario, programs=programs), refuse_unsuitable)
    if said is None:
        live.set({"follower.standoff_m": 2})
        assert live.requested.follower.standoff_m == 2.0
    else:
        line = error_of(ConfigError, lambda: live.set({"follower.standoff_m": 2}))
        assert line.startswith(said)
        assert live.requested.follower.standoff_m != 2.0


@pytest.mark.parametrize(
    ("view", "standoff_m", "warns"),
    [("side_left", 1.0, True), ("side_left", 1.2, False), ("back", 1.0, False)],
)
def test_a_camera_too_near_beside_a_person_is_warned_about(caplog, view, standoff_m, warns):
    follower = FollowerConfig(view=view, standoff_m=standoff_m)
    FollowerNode(Scenario(robot=NEXUS, follower=follower, sensor=SensorConfig(kind="fused")))
    assert ("both shoulders" in caplog.text) == warns
