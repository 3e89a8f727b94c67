"""The follower's node: from odometry and frames to commands, step by step and on the bus."""

import math

import msgspec
import pytest
from follower.rooms import scan, wall
from follower.stepped import NEXUS, ORIGIN, PERSON, PROPORTIONAL, Follower
from harness import Rig, error_of
from hostile import forged
from mecazen import keys
from mecazen import messages as m
from mecazen.config import FollowerConfig, Scenario, SimConfig
from mecazen.config.follower import PidControl, PlannerConfig, PolarControl
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import diagonal_covariance
from mecazen.parameters import LiveParameters
from mecazen.row import Row
from mecazen_follower.measurement import NO_HEADING
from toys import user_nodes

AHEAD = Pose2D(1.5)
WALL = wall(1.0, 2.0, 1.0)


def estimate_of(state):
    return state.estimate[0].pose.pose.to_planar()


def test_detection_in_base_link_is_placed_in_odom():
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
    report = {"nis": None, "tracking": "following", "distance_error_m": 1.236}
    assert follower.node.diagnostics() == report
    for frame_id in ("world", "odom"):  # both are taken to be odom
        _, state = Follower().tick(0, robot, person, seen_in=frame_id)
        assert estimate_of(state) == pytest.approx(person)


def test_waiting_following_coasting_lost_and_following_again():
    follower = Follower(lost_after_s=0.5)
    assert follower.node.diagnostics() == {"nis": None}
    seen = [AHEAD if 8 <= tick <= 20 or tick >= 100 else None for tick in range(121)]
    steps = [
        follower.tick(tick, person=seen[tick] if tick % 4 == 0 else None) for tick in range(121)
    ]
    tracking = [state.tracking for _, state in steps]
    assert tracking[:8] == ["waiting"] * 8
    assert [(state.estimate, state.goal) for _, state in steps[:8]] == [((), ())] * 8
    assert tracking[8:31] == ["following"] * 23  # last seen at tick 20, and for 0.1 s more
    assert tracking[31:71] == ["coasting"] * 40
    assert tracking[71:100] == ["lost"] * 29
    assert tracking[100:] == ["following"] * 21
    for tick, (command, state) in enumerate(steps):
        is_driven = state.tracking in ("following", "coasting")
        assert command == pytest.approx((0.5 if is_driven else 0.0, 0.0, 0.0)), tick
    assert steps[50][1].last_seen_s == pytest.approx(0.3)
    assert steps[120][1].last_seen_s == 0.0


ELSEWHERE = (m.PoseWithCovariance(m.Pose.planar(Pose2D(4.0, 4.0))),)


@pytest.mark.parametrize(
    ("last", "frame", "reason"),
    [
        (AHEAD, m.Observation(reason=m.Unseen.WALL), "hidden by a wall"),
        (AHEAD, m.Observation(poses=ELSEWHERE, reason=m.Unseen.PERSON), "hidden by another person"),
        (AHEAD, m.Observation(poses=ELSEWHERE), "only implausible detections"),
        (AHEAD, None, "no frames from the sensor"),
        # without a reason of the sensor, by its field of view of 40° and its range of 10 m
        (AHEAD, m.Observation(), "not in the sensor's frames"),
        (Pose2D(1.0, 1.0), m.Observation(), "out of view to the left"),
        (Pose2D(10.5), m.Observation(), "out of range"),
    ],
)
def test_the_state_gives_the_reason_of_a_loss(last, frame, reason):
    follower = Follower(estimator="imm", fov_deg=40.0, lost_after_s=0.5)
    for tick in range(0, 40, 4):
        _, state = follower.tick(tick, person=last, noise=diagonal_covariance((1e-4,) * 6))
    assert (state.tracking, state.reason) == ("following", "")
    for tick in range(40, 100):
        samples = {} if frame is None or tick % 4 else {"observation": frame}
        _, state = follower.tick(tick, topic=keys.LEGS, **samples)  # legs are not this sensor's
        assert state.reason == ("" if state.tracking == "following" else reason), tick
    assert state.tracking == "lost"
    assert follower.node.diagnostics()["reason"] == reason


@pytest.mark.parametrize(
    ("kind", "search_s", "tracking", "plan"),
    [
        ("fused", 60.0, "searching", "searching"),
        ("fused", 5.0, "lost", "waiting"),
        ("fused", 0.0, "lost", ""),
        ("body", 60.0, "lost", ""),  # no lidar
    ],
)
def test_a_robot_with_lidar_and_camera_searches(kind, search_s, tracking, plan):
    follower = Follower(kind=kind, estimator="imm", lost_after_s=1.0, search_s=search_s)
    gone, end = 50, 650
    for tick in range(end):
        person = AHEAD if tick < gone and tick % 4 == 0 else None
        samples = {}
        if tick % 10 == 0 and kind == "fused":
            header = m.Header(m.Time.from_ns(tick * follower.tick_ns), "laser")
            samples["scan"] = msgspec.structs.replace(scan(ORIGIN, WALL), header=header)
        twist, state = follower.tick(tick, person=person, **samples)
    assert (state.tracking, state.plan) == (tracking, plan)
    assert (twist.x != 0.0) == (tracking == "searching")
    assert bool(state.plan_reason) == bool(plan)


@pytest.mark.parametrize("latency", [3, 600])  # 6 s: longer than odometry is kept otherwise
def test_late_frame_uses_the_pose_at_capture(latency):
    follower = Follower(latency_s=0.01 * latency)
    for tick in range(20, latency + 20):
        robot = Pose2D(0.01 * tick)
        follower.tick(tick, robot)
    _, state = follower.tick(latency + 20, robot, Pose2D(2.0), captured=19)
    assert (state.tracking, follower.refused) == ("waiting", ["target/observation"])
    _, state = follower.tick(latency + 21, robot, Pose2D(2.0), captured=21)
    assert estimate_of(state) == pytest.approx((2.21, 0.0, 0.0))


def test_refused_frame_changes_nothing():
    refusing, unseeing = Follower(estimator="imm"), Follower(estimator="imm")
    for follower in (refusing, unseeing):
        follower.tick(0, person=AHEAD)
    asymmetric = (0.0, 1.0, *(0.0,) * 34)
    for tick, noise in ((1, diagonal_covariance((-1.0,) * 6)), (2, asymmetric)):
        refused = refusing.tick(tick, person=Pose2D(7.0), noise=noise)
        assert refused == unseeing.tick(tick)
    assert refusing.refused == ["target/observation"] * 2
    assert refusing.tick(4, person=AHEAD) == unseeing.tick(4, person=AHEAD)


@pytest.mark.parametrize("jump", [Pose2D(5.0, 5.0, 0.0), Pose2D(0.0, 0.0, math.pi / 2)])
def test_odometry_jump_resets_the_track(jump):
    follower = Follower(estimator="imm")
    for tick in range(0, 41, 4):
        follower.tick(tick, person=AHEAD)
    command, state = follower.tick(41, jump)
    assert (command, state.tracking, state.estimate) == (Twist2D(), "waiting", ())
    _, state = follower.tick(42, jump, AHEAD, captured=39)  # where the robot was is unknown now
    assert (state.estimate, follower.refused) == ((), ["target/observation"])
    _, state = follower.tick(44, jump, AHEAD)
    assert estimate_of(state) == pytest.approx(jump.compose(AHEAD))
    assert state.estimate[0].twist.twist.to_planar() == pytest.approx((0.0, 0.0, 0.0))
    _, state = follower.tick(84, Pose2D(jump.x + 0.4, jump.y, jump.yaw))
    assert state.estimate  # motion in missed ticks is no jump


@pytest.mark.parametrize(("kind", "tracking"), [("legs", "following"), ("fused", "waiting")])
def test_legs_start_a_track_only_without_a_camera(kind, tracking):
    follower = Follower(kind=kind, estimator="imm")
    noise = diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, NO_HEADING))
    for tick in range(0, 40, 4):
        _, state = follower.tick(tick, person=AHEAD, noise=noise, topic=keys.LEGS)
    assert state.tracking == tracking


@pytest.mark.parametrize(
    ("services", "is_open"),
    [(("hardware", "controller"), True), (("physics", "sensors", "controller"), False)],
)
def test_0_is_no_return_of_a_real_lidar(services, is_open):
    planner = PlannerConfig(samples=100)
    follower = Follower(estimator="imm", control=PolarControl(), planner=planner, services=services)
    near = scan(ORIGIN, [(0.4, 0.25, 0.1)])
    zeros = (0.0,) * (len(near.ranges) - 1)
    free = msgspec.structs.replace(near, ranges=(*zeros, 2.0))
    for tick in range(0, 40, 4):
        header = m.Header(m.Time.from_ns(tick * follower.tick_ns))
        seen = msgspec.structs.replace(near if tick < 20 else free, header=header)
        _, state = follower.tick(tick, person=AHEAD, scan=seen)
        if tick == 16:
            assert state.plan != "open"
    assert (state.plan == "open") is is_open


def test_long_gap_and_new_run_reset_all_state():
    planner = PlannerConfig(samples=100)
    used, new = (Follower(estimator="imm", control=PolarControl(), planner=planner) for _ in "ab")
    late = 2**31 * 100 - 60  # near the latest time: no estimator may go there step by step
    obstacle = scan(ORIGIN, [(0.4, 0.25, 0.1)])

    def outputs(follower):
        follower.tick(late, person=AHEAD)
        header = m.Header(m.Time.from_ns((late + 1) * follower.tick_ns))
        follower.tick(late + 1, scan=msgspec.structs.replace(obstacle, header=header))
        steps = [follower.tick(late + tick, person=AHEAD) for tick in range(2, 14)]
        assert (steps[-1][1].plan not in ("", "open"), follower.refused) == (True, [])
        return steps

    used.reset(7)
    used.tick(0, person=Pose2D(1.2, 0.4))
    new.reset(7)
    for follower in (used, new):
        _, state = follower.tick(late - 1)
        assert (state.tracking, state.estimate) == ("waiting", ())
    expected = outputs(new)
    assert outputs(used) == expected
    used.reset(7)
    used.tick(late - 1)
    assert outputs(used) == expected


@pytest.mark.parametrize(
    "settings",
    [
        {"control": PolarControl(), "estimator": "imm", "planner": PlannerConfig(samples=100)},
        {"control": PidControl(), "response_s": 0.05},
    ],
    ids=["polar", "pid"],
)
def test_a_change_that_changes_nothing_changes_no_bit(settings):
    configured, kept = Follower(**settings), Follower(**settings)
    assert configured.drive(range(30)) == kept.drive(range(30))
    configured.configure()
    assert configured.drive(range(30, 60)) == kept.drive(range(30, 60))


def test_a_changed_standoff_keeps_the_person():
    follower = Follower(estimator="imm")
    _, before = follower.drive(range(20))[-1]
    follower.configure(standoff_m=1.5, view="front")
    command, after = follower.tick(20, Pose2D(0.04))
    assert after.tracking == before.tracking == "following"
    assert estimate_of(after) == pytest.approx(PERSON, abs=1e-3)
    # by 1.5 m ahead of the person instead of 1 m behind, and looking back
    forward = PERSON.compose(Pose2D(1.5))
    assert after.goal[0].to_planar()[:2] == pytest.approx(forward[:2], abs=2e-3)
    assert command.x == PROPORTIONAL.x.limit  # more than 2 m are missing


def test_settings_without_effect_are_refused():
    with user_nodes(Row("follower")) as programs:
        live = LiveParameters(Scenario(NEXUS, programs=programs), lambda _: None)
        error = error_of(ConfigError, lambda: live.set({"follower.standoff_m": 2}))
    assert error.startswith("follower: no effect on user:follower, which takes its place")
    assert live.requested.follower.standoff_m != 2.0


ON_BUS = Scenario(
    NEXUS,
    services=("physics", "controller", "target", "follower"),
    sim=SimConfig(mode="lockstep"),
    follower=FollowerConfig(estimator="imm", control=PROPORTIONAL),
)


def answers(rig, robot, person, run=1):
    """Publish odometry and a frame of a run's first tick; return what the follower answers."""
    stamp = rig.at(0, run)
    odom = m.planar_odometry(stamp.time, "odom", "base_link", robot, Twist2D())
    rig.put(keys.ODOM, odom, stamp)
    poses = (m.PoseWithCovariance(m.Pose.planar(person)),)
    frame = m.Observation(m.Header(stamp.time, "base_link"), poses)
    return rig.put(keys.OBSERVATION, frame, stamp)


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


@forged(GOOD)
def test_hostile_samples_do_no_lasting_harm(wrong):
    rig, next_run = Rig("follower", ON_BUS, keys.FOLLOWER_STATE, keys.CMD_VEL), 2**32 - 1
    answers(rig, ORIGIN, AHEAD)
    for sample in rig.put_wrong(wrong):
        if sample.key == "cmd_vel":
            assert max(map(abs, sample.message.to_planar())) <= 2.0
    state, command = answers(rig, Pose2D(0.1), Pose2D(1.5, 0.2), next_run)
    assert (state.key, command.key) == ("follower/state", "cmd_vel")
    assert command.stamp == state.stamp
    assert estimate_of(state.message) == pytest.approx((1.6, 0.2, 0.0))
    assert command.message.to_planar() == pytest.approx((0.5, 0.2, 0.0))
