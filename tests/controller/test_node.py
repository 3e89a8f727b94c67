"""The controller's nodes: wheel speeds, odometry, and the choice among commands."""

import math

import msgspec
import numpy as np
import pytest
from harness import Rig, Steps, forward, load_robot
from hostile import forged
from mecazen import keys
from mecazen import messages as m
from mecazen.config import ControllerConfig, Scenario, SensorConfig, SimConfig, StartConfig
from mecazen.config.services import (
    AngularLimits,
    AxisLimits,
    Command,
    LinearLimits,
    OdometryNoise,
    OdometryScale,
)
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import CMD_VEL, HAND_CMD_VEL, command_topic, lock_topic
from mecazen.robot import WHEEL_JOINTS
from mecazen.wire import RefusedError
from mecazen_controller.node import ControllerNode, OdometryNode

# The robot `nexus`: wheels of 0.05 m, half-lengths of 0.15 m each, at most 40 rad/s.
NEXUS = load_robot()

FREE = LinearLimits(math.inf, math.inf)
UNLIMITED = AxisLimits(FREE, FREE, AngularLimits(math.inf, 1e9))
STANDING = (0.0,) * 4
START = StartConfig(x_m=1.0, y_m=2.0, yaw_deg=90.0)


def scenario(also=(), **settings):
    return Scenario(
        robot=NEXUS,
        start=START,
        controller=ControllerConfig(**settings),
        sensor=SensorConfig(also=also),
    )


def joints(speeds, names=WHEEL_JOINTS):
    return {keys.JOINT_STATES: m.JointState(name=names, velocity=tuple(speeds))}


class Controller(Steps):
    def __init__(self, **settings):
        super().__init__(ControllerNode, scenario(**settings))
        self.command = keys.GUARD_CMD_VEL if settings.get("also") else keys.CMD_VEL

    def drive(self, tick, reference=None, measured=STANDING):
        """Return the wheel speeds [rad/s] that a tick commands."""
        commands = {} if reference is None else {self.command: m.Twist.planar(reference)}
        return self.step(tick, joints(measured) | commands)[keys.JOINT_COMMAND].velocity

    def forward(self, ticks, speed=None, measured=STANDING):
        """Return the speed [m/s] along x that each tick commands, all four wheels alike."""
        reference = None if speed is None else Twist2D(speed)
        commands = [self.drive(tick, reference, measured) for tick in ticks]
        assert all(max(speeds) == min(speeds) for speeds in commands)
        return [speeds[0] * 0.05 for speeds in commands]


def test_a_twist_that_is_too_fast_keeps_its_direction():
    # 28, 92, 68, 52 rad/s by the equations: over the limit, so all are slower
    speeds = (28.0 / 2.3, 40.0, 68.0 / 2.3, 52.0 / 2.3)
    assert Controller(limits=UNLIMITED).drive(0, Twist2D(3.0, 1.0, 2.0)) == pytest.approx(speeds)


def test_limits_hold_once_a_tick():
    controller = Controller()
    # 2.5 m/s² make 0.025 m/s in a tick; the last reference counts, from the same state
    for speed, expected in ((1.0, 0.025), (1.0, 0.025), (-1.0, -0.025), (1.0, 0.025)):
        assert controller.forward([0], speed) == pytest.approx([expected])
    assert controller.forward([1]) == pytest.approx([0.05])


def test_a_stale_reference_brakes_within_the_deceleration_limit():
    limits = AxisLimits(x=LinearLimits(max_acceleration_m_s2=5.0, max_deceleration_m_s2=1.0))
    controller = Controller(limits=limits, reference_timeout_s=0.05)
    assert controller.forward(range(3), 0.1) == pytest.approx([0.05, 0.1, 0.1])
    speeds = controller.forward(range(3, 20))
    assert speeds[:5] == pytest.approx([0.1] * 5)  # as old as the timeout: still good
    assert speeds[5:15] == pytest.approx([0.09 - 0.01 * i for i in range(10)], abs=1e-12)
    assert speeds[14:] == [0.0, 0.0, 0.0]
    # the next command moves it again
    assert controller.forward(range(20, 22), 0.1) == pytest.approx([0.05, 0.1])


def test_a_silent_guard_is_obeyed_until_its_command_expires():
    controller = Controller(also=("lidar",))
    controller.forward(range(40), 0.5)
    braking = [0.5 - 0.025 * n for n in range(1, 16)]
    # 0.05 s are five ticks more; then it brakes by 2.5 m/s²
    assert controller.forward(range(40, 60)) == pytest.approx([0.5] * 5 + braking)


@pytest.mark.parametrize(
    ("also", "ticks", "tick", "measured", "expected"),
    [
        ((), 0, 500, 20.0, 1.0 - 0.025),  # it joins late: from the measured 1 m/s
        ((), 100, 251, 0.0, 0.025),  # longer than the wheels hold a command: they stand
        (("lidar",), 40, 43, 0.0, 0.5),  # 0.04 s: the wheels still hold the guard's command
        (("lidar",), 40, 45, 0.0, 0.025),
    ],
)
def test_after_missed_ticks_the_speed_continues_from_the_motion(
    also, ticks, tick, measured, expected
):
    controller = Controller(also=also)
    controller.forward(range(ticks), 0.5)
    speed = 0.5 if ticks else None
    assert controller.forward([tick], speed, (measured,) * 4) == pytest.approx([expected])


def test_a_run_begins_at_rest_and_without_a_reference():
    controller = Controller(limits=UNLIMITED)
    controller.forward(range(150), 0.5)
    controller.drive(162)
    reference = {"reference_age_s": 0.13, "expired_ticks": 0}
    assert controller.node.diagnostics() == reference | {"drives": "follower"}
    controller.reset(1)
    assert controller.node.diagnostics() == {"drives": "", "reference": "none yet"}
    assert controller.drive(0, measured=(20.0,) * 4) == controller.drive(1) == STANDING


def test_changed_limits_apply_from_the_next_tick():
    controller = Controller(limits=AxisLimits(LinearLimits(max_acceleration_m_s2=1.0)))
    assert controller.forward(range(10), 2.0)[-1] == pytest.approx(0.1)
    controller.node.configure(scenario(limits=AxisLimits(LinearLimits(0.15, 4.0))))
    assert controller.forward(range(10, 13), 2.0) == pytest.approx([0.14, 0.15, 0.15])


def test_frames_joints_and_lengths_are_the_users():
    names = ("fl", "fr", "rl", "rr")
    frames = {"odom_frame_id": "o", "base_frame_id": "b"}
    users = scenario(wheel_radius_m=0.1, half_track_m=0.35, limits=UNLIMITED, **frames)
    wheels = msgspec.structs.replace(NEXUS.wheels, joints=names)
    robot = msgspec.structs.replace(NEXUS, wheels=wheels)
    users = msgspec.structs.replace(users, robot=robot)
    samples = joints(STANDING, names) | {keys.CMD_VEL: m.Twist.planar(Twist2D(yaw=1.0))}
    command = Steps(ControllerNode, users).step(7, samples)[keys.JOINT_COMMAND]
    assert (command.header.stamp, command.name) == (m.Time(nanosec=70_000_000), names)
    assert command.velocity == pytest.approx((-5.0, 5.0, -5.0, 5.0))
    odom = Steps(OdometryNode, users).step(7, samples)[keys.ODOM]
    assert odom.header == m.Header(m.Time(nanosec=70_000_000), "o")
    assert odom.child_frame_id == "b"


class Wheels(Steps):
    def __init__(self, tick_s=None, **settings):
        super().__init__(OdometryNode, scenario(**settings), tick_s)

    def measure(self, tick, speeds, names=WHEEL_JOINTS, position=()):
        """Return the odometry of a tick; None where it brings none."""
        state = m.JointState(name=names, position=position, velocity=tuple(speeds))
        return self.step(tick, {keys.JOINT_STATES: state}).get(keys.ODOM)


def moved(odom):
    """Return the pose as seen from the start."""
    return START.pose.between(odom.pose.pose.to_planar())


def test_a_driven_circle_gives_the_exact_pose():
    tick_s = 0.0123
    wheels = Wheels(tick_s)
    speeds = wheels.node.kinematics.inverse(Twist2D(x=0.5, yaw=0.5))  # a radius of 1 m
    for tick in range(301):
        odom = wheels.measure(tick, speeds)
        angle = 0.5 * tick_s * tick
        exact = Pose2D(math.sin(angle), 1.0 - math.cos(angle), angle)
        assert moved(odom) == pytest.approx(exact, abs=1e-12)
    assert odom.twist.twist.to_planar() == pytest.approx(Twist2D(0.5, 0.0, 0.5))


@pytest.mark.parametrize(
    ("speeds", "names"), [((1.0,) * 3, WHEEL_JOINTS[:3]), ((1.0,) * 3, WHEEL_JOINTS), ((), ())]
)
def test_a_missing_wheel_is_an_error_at_first(speeds, names):
    problem = "robot.wheels.joints: joint_states has no velocity of '.*_wheel_joint'"
    with pytest.raises(ConfigError, match=problem):
        Wheels().measure(0, speeds, names)
    wheels = Wheels()
    wheels.measure(0, STANDING)
    assert wheels.measure(1, speeds, names) is None
    assert wheels.refused == ["joint_states"]
    # the next measured speeds cover refused and missed ticks: 0.1 m/s
    assert moved(wheels.measure(2, (2.0,) * 4)).x == pytest.approx(0.002)
    assert moved(wheels.measure(7, (2.0,) * 4)).x == pytest.approx(0.007)


# At 20 rad/s² from rest the wheels turn ½ 20 t² = 0.001 rad in the first tick of 10 ms, and
# the speed at its end, 0.2 rad/s, would mean 0.002. The wheels turn at most 40 rad/s.
@pytest.mark.parametrize(
    ("measured", "turned"),
    [
        ([(0, 0.0, 0.0), (1, 0.2, 0.001), (2, 0.4, 0.004)], 0.004),
        ([(0, 2.0, 0.0), (1, 2.0, 0.02), (51, 0.0, 0.52)], 0.52),  # they stand now
        ([(0, 2.0, 3.13), (1, 2.0, 3.15 - math.tau), (2, 2.0, 3.17 - math.tau)], 0.04),
        ([(0, 2.0, 700.0), (1, 2.0, 0.0), (2, 2.0, 0.02)], 0.04),  # the counter started again
        ([(0, 2.0, 0.0), (1, 2.0, None), (2, 2.0, 0.04), (3, 2.0, 0.05)], 0.05),
    ],
    ids=["speeding up", "missed ticks", "wrapped", "restarted", "without angles"],
)
def test_the_pose_follows_the_angles_of_the_wheels(measured, turned):
    wheels = Wheels()
    for tick, speed, angle in measured:
        position = () if angle is None else (angle,) * 4
        odom = wheels.measure(tick, (speed,) * 4, position=position)
    assert moved(odom).x == pytest.approx(turned * 0.05)
    assert odom.twist.twist.to_planar() == pytest.approx(Twist2D(speed * 0.05))


def test_odometry_is_scaled_and_has_covariances():
    variances = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    wheels = Wheels(
        odometry_scale=OdometryScale(y=0.9),
        pose_covariance_diagonal=variances,
        twist_covariance_diagonal=variances[::-1],
    )
    wheels.measure(0, STANDING)
    # 10 rad/s of the wheels to the left, found by name among those of an arm: 0.5 m/s
    odom = wheels.measure(1, (9.0, -10.0, 10.0, 10.0, -10.0), ("arm", *WHEEL_JOINTS[::-1]))
    assert odom.twist.twist.linear.y == pytest.approx(0.45)
    assert moved(odom).y == pytest.approx(0.0045)
    assert odom.pose.covariance[::7] == variances
    assert odom.twist.covariance[::7] == variances[::-1]


def test_odometry_noise_has_the_configured_deviation_and_repeats():
    noise = OdometryNoise(x_m_s=0.1, yaw_rad_s=0.01)
    runs = []
    for _ in range(2):
        wheels = Wheels(odometry_noise=noise)
        runs.append(
            [wheels.measure(tick, STANDING).twist.twist.to_planar() for tick in range(2000)]
        )
    assert runs[0] == runs[1]
    # 2000 samples give a standard deviation within 1.6 %; 5 % are three of these
    assert np.std(runs[0], axis=0) == pytest.approx((0.1, 0.0, 0.01), rel=0.05)
    assert wheels.node.pose != START.pose


def test_a_lower_rate_skips_odometry_but_no_motion():
    wheels = Wheels(update_rate_hz=25.0)
    odoms = [wheels.measure(tick, (2.0,) * 4) for tick in range(9)]
    assert [tick for tick, odom in enumerate(odoms) if odom is not None] == [0, 4, 8]
    assert moved(odoms[8]).x == pytest.approx(0.1 * 0.08)


def test_ground_truth_is_published_in_the_odometry_frame():
    exact = scenario(odometry="ground_truth", odom_frame_id="map")
    pose, twist = Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3)
    truth = m.planar_odometry(m.Time(), "world", "x", pose, twist, tuple(range(36)))
    steps = Steps(OdometryNode, exact)
    odom = steps.step(0, {keys.GROUND_TRUTH: truth})[keys.ODOM]
    assert (odom.pose, odom.twist) == (truth.pose, truth.twist)
    assert (odom.header.frame_id, odom.child_frame_id) == ("map", "base_link")
    with pytest.raises(RefusedError, match="nothing to set"):
        steps.node.answer(keys.SET_ODOMETRY, m.OdometryRequest())


class OnBus(Rig):
    """A controller that obeys at once."""

    def __init__(self):
        config, lockstep = ControllerConfig(limits=UNLIMITED), SimConfig(mode="lockstep")
        services = ("physics", "controller")
        scenario = Scenario(NEXUS, services=services, sim=lockstep, controller=config)
        super().__init__("controller", scenario, keys.ODOM, keys.JOINT_COMMAND)

    def tick(self, tick, speeds=STANDING, run=1):
        return self.put(*joints(speeds).popitem(), self.at(tick, run))


def test_later_commands_of_a_tick_replace_the_first():
    rig = OnBus()
    odom, command = rig.tick(7)
    assert (odom.key, command.key) == ("odom", "joint_command")
    assert odom.stamp == command.stamp == rig.at(7)
    assert command.message.velocity == STANDING
    for speed in (0.1, 0.2):  # from outside, without a stamp
        rig.bus.put_bytes("cmd_vel", b'{"linear":{"x":%f}}' % speed)
        (again,) = rig.take()
        assert (again.key, again.stamp) == ("joint_command", rig.at(7))
        assert again.message.velocity == pytest.approx([speed / 0.05] * 4)


def test_set_odometry_moves_the_pose_until_the_next_run():
    rig = OnBus()
    rig.tick(0)
    rig.tick(1, (2.0,) * 4)
    request = m.OdometryRequest(pose=m.Pose.planar(Pose2D(5.0, 6.0, math.pi / 2)))
    odom = rig.bus.call(keys.SET_ODOMETRY, request)
    assert odom.pose.pose.to_planar() == pytest.approx((5.0, 6.0, math.pi / 2))
    assert odom.twist.twist.to_planar() == pytest.approx((0.1, 0.0, 0.0))  # as before
    assert odom.header.stamp == m.Time(nanosec=10_000_000)
    odom, _ = rig.tick(2, (2.0,) * 4)
    assert odom.message.pose.pose.to_planar() == pytest.approx((5.0, 6.001, math.pi / 2))
    odom, _ = rig.tick(0, run=2)
    assert odom.message.pose.pose.to_planar() == Pose2D()


GOOD = {
    "joint_states": [m.JointState(name=WHEEL_JOINTS, velocity=(1.0, 2.0, 3.0, 4.0))],
    "cmd_vel": [m.Twist.planar(Twist2D(0.1, 0.2, 0.3))],
}


@forged(GOOD)
def test_wrong_payloads_with_forged_stamps_do_no_lasting_harm(wrong):
    rig = OnBus()
    rig.tick(0)
    for sample in rig.put_wrong(wrong):
        if sample.key == "joint_command":
            assert max(map(abs, sample.message.velocity)) <= 40.0
    run = 2**32 - 1
    odom, _ = rig.tick(0, run=run)
    assert odom.message.pose.pose.to_planar() == Pose2D()
    rig.put(CMD_VEL, m.Twist.planar(Twist2D(0.2, 0.1, 0.5)), rig.at(0, run))
    odom, command = rig.tick(1, (2.0,) * 4, run=run)
    assert odom.message.pose.pose.to_planar() == (0.1 * 0.01, 0.0, 0.0)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))


JOY, PAUSE = Command("joy", 200, 0.1), Command("pause", 50, lock=True)
NODE, HAND, TOPIC = CMD_VEL, HAND_CMD_VEL, command_topic("joy")
LOCK = lock_topic("pause")


def drivers(commands, *samples, ticks=(0,)):
    """Return who drives at each of the ticks; the samples come with the ticks before their own."""
    controller, drives = Controller(commands=commands), []
    for tick in range(max(ticks) + 1):
        came = {topic: message for at, topic, message in samples if at == tick}
        controller.step(tick, joints(STANDING) | came)
        drives.append(controller.node.diagnostics()["drives"])
    return [drives[tick] for tick in ticks]


def test_a_program_takes_over_until_it_is_silent():
    samples = (0, NODE, forward(1.0)), (5, HAND, forward(0.2))
    assert drivers((), samples[0], ticks=(0, 50, 51)) == ["follower", "follower", ""]
    commands = (Command("cmd_vel", timeout_s=0.2),)
    expected = ["follower", "cmd_vel", "cmd_vel", "follower"]
    assert drivers(commands, *samples, ticks=(4, 5, 25, 26)) == expected
    assert drivers((JOY,), *samples, ticks=(5,)) == ["follower"]  # a key that is left out


def test_the_highest_priority_drives():
    samples = (0, HAND, forward(0.2)), (0, TOPIC, forward(0.1))
    drives = drivers((Command("cmd_vel"), JOY), *samples, ticks=(0, 10, 11))
    assert drives == ["joy", "joy", "cmd_vel"]


def test_a_lock_holds_its_priority_until_released():
    samples = (
        (0, NODE, forward(1.0)),
        (2, LOCK, m.Bool(data=True)),
        (4, HAND, forward(0.2)),
        (60, LOCK, m.Bool(data=False)),
        (60, NODE, forward(1.0)),
    )
    drives = drivers((Command("cmd_vel"), PAUSE), *samples, ticks=(1, 2, 4, 55, 60))
    assert drives == ["follower", "locked by pause", "cmd_vel", "locked by pause", "follower"]


def test_a_lock_with_a_timeout_must_be_refreshed():
    samples = (0, NODE, forward(1.0)), (1, LOCK, m.Bool())
    drives = drivers((Command("pause", 50, 0.1, lock=True),), *samples, ticks=(0, 1, 11, 12))
    assert drives == ["locked by pause", "follower", "follower", "locked by pause"]
