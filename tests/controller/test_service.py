"""The controller on the bus: what it answers to joint states and to commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest
from harness import (
    FORGED,
    FUZZ,
    NO_STAMP,
    Listener,
    Put,
    assert_sendable,
    load_robot,
    put_all,
    puts,
)
from hypothesis import given
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import Scenario, SimConfig, StartConfig
from mecazen.errors import BusError, ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import Topic
from mecazen.messages import (
    JointState,
    Odometry,
    OdometryRequest,
    Pose,
    Time,
    Twist,
    Vector3,
    planar_odometry,
)
from mecazen.robot import WHEEL_JOINTS
from mecazen.wire import Stamp
from mecazen_controller.config import (
    AngularLimits,
    AxisLimits,
    ControllerConfig,
    LinearLimits,
    OdometryScale,
)
from mecazen_controller.service import ControllerService

# The robot `nexus`: wheels of 0.05 m, half-lengths of 0.15 m each, at most 40 rad/s.
NEXUS = load_robot()
RUN, NEXT_RUN = 5, 2**32 - 1
TICK_NS = 10_000_000
ALONE = ("physics", "controller")
LED = ("physics", "controller", "follower")
UNLIMITED = AxisLimits(
    LinearLimits(math.inf, math.inf), LinearLimits(math.inf, math.inf), AngularLimits(math.inf, 1e9)
)
AT_ONCE = ControllerConfig(limits=UNLIMITED)
STANDING = (0.0,) * 4


class Rig:
    """A controller, and the physics and the follower that it talks to."""

    def __init__(
        self,
        config: ControllerConfig | None = None,
        *,
        services: Sequence[str] = ALONE,
        mode: Any = "lockstep",
        start: StartConfig | None = None,
    ) -> None:
        config = config or ControllerConfig()
        self.bus = LocalBus()
        self.service = ControllerService(
            self.bus,
            Scenario(
                robot=NEXUS,
                services=tuple(services),
                sim=SimConfig(mode=mode),
                start=start or StartConfig(),
                sections={"controller": config},
            ),
        )
        self.joints = config.wheel_joints
        self.odom = Topic(config.odometry_key, Odometry, "", "", "")
        self.cmd_vel = self.bus.publisher(Topic(config.command_key, Twist, "", "", ""))
        self.joint_states = self.bus.publisher(keys.JOINT_STATES)
        self.ground_truth = self.bus.publisher(keys.GROUND_TRUTH)
        self.heard = Listener(self.bus, self.odom, keys.JOINT_COMMAND)
        self.health = Listener(self.bus, keys.diagnostics("controller"))

    def stamp(self, tick: int, run: int = RUN) -> Stamp:
        return Stamp(tick * TICK_NS, run, 0)

    def tick(self, tick: int, speeds: Sequence[float] = STANDING, run: int = RUN) -> list[Any]:
        """Publish the measured wheel speeds of a tick; return what comes of it."""
        joints = JointState(name=self.joints, velocity=tuple(speeds))
        self.joint_states.put(joints, self.stamp(tick, run))
        return self.listen()

    def command(self, twist: Twist2D, tick: int | None = None, run: int = RUN) -> list[Any]:
        """Publish a reference, of a tick or of an outsider; return what comes of it."""
        stamp: Any = None if tick is None else self.stamp(tick, run)
        self.cmd_vel.put(Twist.planar(twist), stamp)
        return self.listen()

    def listen(self) -> list[Any]:
        self.bus.spin()
        return self.heard.take()

    def drive(self, ticks: range, twist: Twist2D | None = None) -> list[Sequence[float]]:
        """Let ticks pass, each with a reference if one is given; return the last commands."""
        commands = []
        for tick in ticks:
            heard = self.tick(tick)
            if twist is not None:
                heard += self.command(twist, tick)
            commands.append(heard[-1].message.velocity)
        return commands


def names(heard: Sequence[Any]) -> list[str]:
    return [sample.key for sample in heard]


def pose_of(sample: Any) -> Pose2D:
    return sample.message.pose.pose.to_planar()


def forward(commands: Sequence[Sequence[float]]) -> list[float]:
    """The speeds along x [m/s] that wheel commands stand for, all four wheels alike."""
    assert all(max(speeds) == min(speeds) for speeds in commands)
    return [speeds[0] * 0.05 for speeds in commands]


def test_joint_states_are_answered_by_odom_and_at_once_by_the_command_where_nobody_leads():
    rig = Rig()
    odom, command = rig.tick(7)
    assert (odom.key, command.key) == ("odom", "joint_command")
    assert odom.stamp == command.stamp == rig.stamp(7)
    assert odom.message.header.stamp == command.message.header.stamp == Time(nanosec=70_000_000)
    assert (odom.message.header.frame_id, odom.message.child_frame_id) == ("odom", "base_link")
    assert command.message.name == WHEEL_JOINTS
    assert command.message.velocity == STANDING


def test_where_a_follower_leads_the_command_waits_for_its_cmd_vel():
    rig = Rig(AT_ONCE, services=LED)
    assert names(rig.tick(0)) == ["odom"]
    (command,) = rig.command(Twist2D(x=0.1), 0)
    assert (command.key, command.stamp) == ("joint_command", rig.stamp(0))
    assert command.message.velocity == (2.0, 2.0, 2.0, 2.0)


@pytest.mark.parametrize(
    ("twist", "speeds"),
    [
        (Twist2D(x=0.5), (10.0, 10.0, 10.0, 10.0)),
        (Twist2D(y=0.5), (-10.0, 10.0, 10.0, -10.0)),
        (Twist2D(yaw=1.0), (-6.0, 6.0, -6.0, 6.0)),
        (Twist2D(0.2, 0.1, 0.5), (-1.0, 9.0, 3.0, 5.0)),
    ],
)
def test_a_reference_becomes_the_wheel_speeds_of_the_published_equations(twist, speeds):
    rig = Rig(AT_ONCE)
    rig.tick(0)
    (command,) = rig.command(twist)
    assert command.message.velocity == pytest.approx(speeds)


def test_a_wheel_over_its_limit_slows_all_four_so_the_direction_stays():
    rig = Rig(AT_ONCE)
    rig.tick(0)
    (command,) = rig.command(Twist2D(3.0, 1.0, 2.0))
    wanted = (28.0, 92.0, 68.0, 52.0)
    assert command.message.velocity == pytest.approx([w * 40.0 / 92.0 for w in wanted])
    assert max(command.message.velocity) == 40.0


def test_limits_hold_once_a_tick_however_many_references_come_in_it():
    rig = Rig()
    rig.tick(0)
    for _ in range(3):  # 2.5 m/s² make 0.025 m/s in a tick
        (command,) = rig.command(Twist2D(x=1.0))
        assert command.message.velocity == pytest.approx([0.5] * 4)
    (command,) = rig.command(Twist2D(x=-1.0))  # the last one counts, from the same state
    assert command.message.velocity == pytest.approx([-0.5] * 4)
    (command,) = rig.command(Twist2D(x=1.0))
    assert rig.tick(1)[-1].message.velocity == pytest.approx([1.0] * 4)


def test_a_stale_reference_brings_the_robot_to_rest_within_its_deceleration_limit():
    limits = AxisLimits(x=LinearLimits(max_acceleration_m_s2=5.0, max_deceleration_m_s2=1.0))
    rig = Rig(ControllerConfig(limits=limits, reference_timeout_s=0.05))
    speeds = forward(rig.drive(range(3), Twist2D(x=0.1)))
    assert speeds == pytest.approx([0.05, 0.1, 0.1])
    speeds = forward(rig.drive(range(3, 20)))
    assert speeds[:5] == pytest.approx([0.1] * 5)  # as old as the timeout: still good
    assert speeds[5:15] == pytest.approx([0.09 - 0.01 * i for i in range(10)], abs=1e-12)
    assert speeds[14:] == [0.0, 0.0, 0.0]
    speeds = forward(rig.drive(range(20, 22), Twist2D(x=0.1)))
    assert speeds == pytest.approx([0.05, 0.1])  # the next good one moves it again


def test_every_change_on_the_way_is_within_the_limits_in_all_axes():
    limits = AxisLimits(
        LinearLimits(1.0, 1.0, 2.0), LinearLimits(0.5, 1.0, 1.5), AngularLimits(1.0, 3.0, 4.0)
    )
    rig = Rig(ControllerConfig(limits=limits, reference_timeout_s=0.1))
    commands = rig.drive(range(60), Twist2D(0.4, -0.3, 0.9))
    commands += rig.drive(range(60, 130))
    kinematics = rig.service.kinematics
    twists = [kinematics.forward(kinematics.inverse(Twist2D())._make(c)) for c in commands]
    assert twists[59] == pytest.approx(Twist2D(0.4, -0.3, 0.9))
    assert twists[-1] == pytest.approx(Twist2D())
    for before, after in pairwise(twists):
        changes = [abs(b - a) for a, b in zip(before, after, strict=True)]
        for axis, (rise, fall) in enumerate(((0.01, 0.02), (0.01, 0.015), (0.03, 0.04))):
            slower = abs(after[axis]) < abs(before[axis])
            assert changes[axis] <= (fall if slower else rise) + 1e-12


@pytest.mark.parametrize(
    "payload",
    [b"", b"{", b'{"linear":{"x":NaN}}', b'{"linear":"fast"}', b'{"linear":{"x":1e308}}', b"\x93"],
)
def test_a_refused_command_leaves_the_last_good_one_until_that_is_stale(payload):
    rig = Rig(ControllerConfig(limits=UNLIMITED, reference_timeout_s=0.03))
    rig.drive(range(1), Twist2D(x=0.1))
    speeds = []
    for tick in range(1, 6):
        rig.bus.put_bytes("cmd_vel", payload)
        rig.listen()
        speeds += forward([rig.tick(tick)[-1].message.velocity])
    assert speeds == pytest.approx([0.1, 0.1, 0.1, 0.0, 0.0])
    assert rig.bus.refused == {"cmd_vel": 5}
    assert forward(rig.drive(range(6, 7), Twist2D(x=0.2))) == pytest.approx([0.2])


def test_a_refused_command_of_the_follower_still_ends_its_tick():
    rig = Rig(AT_ONCE, services=LED)
    rig.tick(0)
    rig.command(Twist2D(x=0.1), 0)
    rig.tick(1)
    (command,) = rig.command(Twist2D(x=1e300), 1)
    assert (command.stamp, forward([command.message.velocity])) == (rig.stamp(1), [0.1])


def test_a_tick_without_the_followers_cmd_vel_is_closed_with_the_last_one():
    rig = Rig(AT_ONCE, services=LED, mode="real_time")
    rig.tick(0)
    rig.command(Twist2D(x=0.1), 0)
    assert names(rig.tick(1)) == ["odom"]
    closing, odom = rig.tick(2)
    assert (closing.key, closing.stamp) == ("joint_command", rig.stamp(1))
    assert forward([closing.message.velocity]) == [0.1]
    assert (odom.key, odom.stamp) == ("odom", rig.stamp(2))


def test_ticks_that_were_missed_are_driven_with_the_last_measured_speeds():
    rig = Rig(mode="real_time")
    rig.tick(0)
    rig.tick(3)
    odom, command = rig.tick(8, (2.0,) * 4)  # 0.1 m/s over 5 ticks
    assert pose_of(odom).x == pytest.approx(0.005)
    assert command.stamp == rig.stamp(8)


def test_each_tick_is_answered_once_and_none_of_the_past():
    rig = Rig()
    assert len(rig.tick(4)) == 2
    assert rig.tick(4) == rig.tick(3) == []


def test_lockstep_with_a_follower_hears_no_outsider():
    rig = Rig(AT_ONCE, services=LED)
    rig.tick(0)
    assert rig.command(Twist2D(x=1.0)) == []
    (command,) = rig.command(Twist2D(x=0.1), 0)
    assert forward([command.message.velocity]) == [0.1]


@pytest.mark.parametrize(("services", "mode"), [(LED, "real_time"), (ALONE, "lockstep")])
def test_elsewhere_an_outsider_without_a_stamp_drives_the_robot(services, mode):
    rig = Rig(AT_ONCE, services=services, mode=mode)
    assert rig.command(Twist2D(x=0.1)) == []  # there is no tick yet
    rig.tick(0)
    rig.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.1}}')
    (command,) = rig.listen()
    assert forward([command.message.velocity]) == [0.1]


def test_a_driven_circle_gives_the_exact_pose():
    rig = Rig(start=StartConfig(x_m=1.0, y_m=2.0, yaw_deg=90.0))
    speeds = rig.service.kinematics.inverse(Twist2D(x=0.5, yaw=0.5))  # a radius of 1 m
    for tick in range(301):
        odom = rig.tick(tick, speeds)[0]
        angle = 0.5 * 0.01 * tick
        exact = Pose2D(1.0, 2.0, math.pi / 2).compose(
            Pose2D(math.sin(angle), 1.0 - math.cos(angle), angle)
        )
        assert pose_of(odom) == pytest.approx(exact, abs=1e-12)
    assert odom.message.twist.twist.to_planar() == pytest.approx(Twist2D(0.5, 0.0, 0.5))


def test_odometry_is_scaled_and_says_how_certain_it_is():
    variances = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    rig = Rig(
        ControllerConfig(
            odometry_scale=OdometryScale(y=0.9),
            pose_covariance_diagonal=variances,
            twist_covariance_diagonal=variances[::-1],
        )
    )
    rig.tick(0)
    message = rig.tick(1, (-10.0, 10.0, 10.0, -10.0))[0].message
    assert message.twist.twist.linear.y == pytest.approx(0.45)
    assert message.pose.pose.position.y == pytest.approx(0.0045)
    assert message.pose.covariance[::7] == variances
    assert message.twist.covariance[::7] == variances[::-1]


def test_ground_truth_mode_publishes_the_truth_in_the_frame_of_the_odometry():
    rig = Rig(ControllerConfig(odometry="ground_truth", odom_frame_id="map"), services=LED)
    assert rig.tick(0) == []  # the wheels say nothing here
    truth = planar_odometry(
        Time(), "world", "x", Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3), tuple(range(36))
    )
    rig.ground_truth.put(truth, rig.stamp(0))
    (odom,) = rig.listen()
    assert (odom.message.pose, odom.message.twist) == (truth.pose, truth.twist)
    assert (odom.message.header.frame_id, odom.message.child_frame_id) == ("map", "base_link")
    with pytest.raises(BusError, match="nothing to set"):
        rig.bus.call(keys.SET_ODOMETRY, OdometryRequest())


def test_update_rate_thins_out_odom_but_not_the_commands():
    rig = Rig(
        ControllerConfig(update_rate_hz=25.0, limits=UNLIMITED), services=LED, mode="real_time"
    )
    heard = [names(rig.tick(tick, (2.0,) * 4)) for tick in range(4)]
    rig.command(Twist2D(x=0.1), 4)
    heard.append(names(rig.tick(4, (2.0,) * 4)))
    assert heard[0] == ["odom"]
    # the follower is not asked in between, so the command does not wait for it
    assert heard[1:] == [["joint_command", "joint_command"], *[["joint_command"]] * 2, ["odom"]]
    odom = [rig.tick(tick, (2.0,) * 4) for tick in range(5, 9)][-1][-1]
    assert pose_of(odom).x == pytest.approx(0.1 * 0.08)  # no tick is left out of the way


def test_an_update_rate_that_does_not_divide_the_tick_rate_is_one_clear_error():
    with pytest.raises(ConfigError, match=r"^controller.update_rate_hz = 30 must divide .*$"):
        Rig(ControllerConfig(update_rate_hz=30.0))


def test_keys_frames_joints_and_lengths_are_the_users():
    config = ControllerConfig(
        command_key="base/cmd",
        odometry_key="base/odom",
        odom_frame_id="o",
        base_frame_id="b",
        wheel_joints=("fl", "fr", "rl", "rr"),
        wheel_radius_m=0.1,
        half_track_m=0.35,
        limits=UNLIMITED,
    )
    rig = Rig(config)
    odom, _ = rig.tick(0)
    assert odom.key == "base/odom"
    assert (odom.message.header.frame_id, odom.message.child_frame_id) == ("o", "b")
    (command,) = rig.command(Twist2D(yaw=1.0))
    assert command.message.name == ("fl", "fr", "rl", "rr")
    assert command.message.velocity == pytest.approx((-5.0, 5.0, -5.0, 5.0))
    rig.bus.publisher(keys.CMD_VEL).put(Twist(linear=Vector3(x=1.0)), rig.stamp(0))
    assert rig.listen() == []  # not its key


def test_wheels_are_found_by_name_among_other_joints():
    rig = Rig()
    rig.tick(0)
    joints = JointState(name=("arm", *WHEEL_JOINTS[::-1]), velocity=(9.0, 8.0, 2.0, 6.0, 4.0))
    rig.joint_states.put(joints, rig.stamp(1))
    twist = rig.listen()[0].message.twist.twist.to_planar()
    # front left 4, front right 6, rear left 2, rear right 8 rad/s
    assert twist == pytest.approx((0.25, -0.05, 8.0 * 0.05 / 4 / 0.3))


@pytest.mark.parametrize(
    "joints",
    [
        JointState(name=WHEEL_JOINTS[:3], velocity=(1.0,) * 3),
        JointState(name=WHEEL_JOINTS, velocity=(1.0,) * 3),
        JointState(name=WHEEL_JOINTS),
    ],
)
def test_a_missing_wheel_is_an_error_at_first_and_refused_later(joints):
    problem = "controller.wheel_joints: joint_states has no velocity of '.*_wheel_joint'"
    fresh = Rig()
    fresh.joint_states.put(joints, fresh.stamp(0))
    with pytest.raises(ConfigError, match=problem):
        fresh.bus.spin()
    rig = Rig()
    rig.tick(0)
    rig.joint_states.put(joints, rig.stamp(1))
    assert rig.listen() == []
    assert rig.bus.refused == {"joint_states": 1}
    assert names(rig.tick(2)) == ["odom", "joint_command"]


def test_set_odometry_moves_the_pose_and_odometry_goes_on_from_there():
    rig = Rig()
    rig.tick(0)
    rig.tick(1, (2.0,) * 4)
    answer = rig.bus.call(
        keys.SET_ODOMETRY, OdometryRequest(pose=Pose.planar(Pose2D(5.0, 6.0, math.pi / 2)))
    )
    assert answer.pose.pose.to_planar() == pytest.approx((5.0, 6.0, math.pi / 2))
    assert answer.header.stamp == Time(nanosec=10_000_000)
    odom = rig.tick(2, (2.0,) * 4)[0]
    assert pose_of(odom) == pytest.approx((5.0, 6.001, math.pi / 2))


@pytest.mark.parametrize(
    "request_json",
    [
        b'{"pose":{"position":{"x":1e308}}}',
        b'{"pose":{"position":{"y":"far"}}}',
        b'{"pose":{"position":{"y":NaN}}}',
    ],
)
def test_set_odometry_refuses_what_is_no_pose(request_json):
    rig = Rig()
    rig.tick(0)
    with pytest.raises(BusError, match="set_odometry: "):
        rig.bus.call_bytes(keys.SET_ODOMETRY, request_json)
    assert pose_of(rig.tick(1)[0]) == Pose2D()


def test_set_odometry_takes_a_quaternion_of_any_length():
    rig = Rig()
    turned = b'{"pose":{"orientation":{"z":1e200,"w":1e200}}}'
    answer = rig.bus.call_bytes(keys.SET_ODOMETRY, turned)
    assert answer.pose.pose.to_planar().yaw == pytest.approx(math.pi / 2)


def test_a_new_run_starts_from_the_start_without_a_reference():
    rig = Rig(AT_ONCE, start=StartConfig(x_m=-1.0))
    first = rig.tick(0)
    rig.command(Twist2D(x=0.1))
    assert rig.tick(1, (2.0,) * 4)[1].message.velocity == (2.0,) * 4
    assert rig.tick(0, run=RUN + 1)[0].message == first[0].message
    assert pose_of(first[0]) == (-1.0, 0.0, 0.0)
    assert rig.tick(1, run=RUN + 1)[1].message.velocity == STANDING
    assert rig.tick(2, (2.0,) * 4) == []  # still on its way from before the reset


def test_a_command_of_another_run_is_dropped():
    rig = Rig(AT_ONCE)
    rig.tick(0)
    assert rig.command(Twist2D(x=1.0), 0, run=RUN + 1) == []
    assert names(rig.tick(1)) == ["odom", "joint_command"]


def test_diagnostics_come_once_a_second_with_the_references_age_and_what_was_refused():
    rig = Rig()
    for tick in range(201):
        rig.tick(tick)
        if tick == 50:
            rig.command(Twist2D(x=0.1))
            rig.bus.put_bytes("cmd_vel", b"?")
    health = [sample.message.status[0] for sample in rig.health.take()]
    values = [{value.key: value.value for value in status.values} for status in health]
    assert [status.level for status in health] == [0, 1, 1]
    assert values[0] == {"reference": "none yet", "missed_ticks": "0", "refused_payloads": "0"}
    assert values[2] == {
        "reference_age_s": "1.49",
        "missed_ticks": "0",
        "hz/joint_states": "100.0",
        "age_s/joint_states": "0.01",
        "hz/cmd_vel": "0.0",
        "age_s/cmd_vel": "1.5",
        "refused_payloads": "1",
        "refused/cmd_vel": "1",
    }


@pytest.mark.parametrize("odometry", ["wheel", "ground_truth"])
def test_who_takes_over_a_robot_that_moves_slows_it_down_within_the_limit(odometry):
    rig = Rig(ControllerConfig(odometry=odometry))
    if odometry == "wheel":
        heard = rig.tick(500, (20.0,) * 4)  # 1 m/s
    else:
        truth = planar_odometry(Time(5), "world", "base_link", Pose2D(3.0), Twist2D(x=1.0))
        rig.ground_truth.put(truth, rig.stamp(500))
        heard = rig.listen()
    (speed,) = forward([heard[-1].message.velocity])
    assert speed == pytest.approx(1.0 - 2.5 * 0.01)


def test_who_was_held_up_goes_on_from_how_the_robot_moves_by_then():
    rig = Rig(services=LED)
    rig.drive(range(100), Twist2D(x=0.5))
    rig.tick(251)
    (command,) = rig.command(Twist2D(x=0.5), 251)
    (speed,) = forward([command.message.velocity])
    assert speed == pytest.approx(2.5 * 0.01)


def test_a_run_that_begins_begins_at_rest():
    rig = Rig()
    assert rig.tick(0, (20.0,) * 4)[-1].message.velocity == STANDING


GOOD = {
    "joint_states": [JointState(name=WHEEL_JOINTS, velocity=(1.0, 2.0, 3.0, 4.0))],
    "cmd_vel": [Twist.planar(Twist2D(0.1, 0.2, 0.3))],
}


@FUZZ
@given(puts(GOOD, NO_STAMP))
def test_malformed_payloads_change_nothing_for_the_run(wrong: list[Put]):
    rig = Rig(AT_ONCE, services=LED)
    rig.tick(0)
    rig.command(Twist2D(x=0.1), 0)
    put_all(rig.bus, wrong)
    rig.heard.take()
    (odom,) = rig.tick(1, (2.0,) * 4)
    assert pose_of(odom) == (0.1 * 0.01, 0.0, 0.0)
    (command,) = rig.command(Twist2D(0.2, 0.1, 0.5), 1)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))


@FUZZ
@given(puts(GOOD, FORGED))
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(
    wrong: list[Put],
):
    rig = Rig(AT_ONCE)
    rig.tick(0)
    put_all(rig.bus, wrong)
    for sample in rig.heard.take() + rig.health.take():
        assert_sendable(sample)
        if sample.key == "joint_command":
            assert max(map(abs, sample.message.velocity)) <= 40.0
    odom, _ = rig.tick(0, run=NEXT_RUN)
    assert pose_of(odom) == Pose2D()
    rig.command(Twist2D(0.2, 0.1, 0.5), 0, NEXT_RUN)
    odom, command = rig.tick(1, (2.0,) * 4, NEXT_RUN)
    assert pose_of(odom) == (0.1 * 0.01, 0.0, 0.0)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))
