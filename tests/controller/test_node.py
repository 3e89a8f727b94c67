"""The controller's nodes: wheel speeds and odometry, step by step and on the bus."""

import math

import msgspec
import pytest
from harness import Rig, Steps, load_robot
from hostile import forged, malformed
from mecazen import keys
from mecazen import messages as m
from mecazen.config import ControllerConfig, Scenario, SensorConfig, SimConfig, StartConfig
from mecazen.config import services as c
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import JointState, OdometryRequest, Pose, Twist
from mecazen.programs import graph_of
from mecazen.robot import WHEEL_JOINTS
from mecazen.wire import RefusedError
from mecazen_controller.node import ControllerNode, OdometryNode

# The robot `nexus`: wheels of 0.05 m, half-lengths of 0.15 m each, at most 40 rad/s.
NEXUS = load_robot()

FREE = LinearLimits(math.inf, math.inf)
UNLIMITED = AxisLimits(FREE, FREE, AngularLimits(math.inf, 1e9))
STANDING = (0.0,) * 4
START = StartConfig(x_m=1.0, y_m=2.0, yaw_deg=90.0)


def scenario(tick_s=0.01, **settings):
    config = c.ControllerConfig(**settings)
    return Scenario(robot=NEXUS, start=START, controller=config, sim=SimConfig(tick_s=tick_s))


def joints(speeds, names=WHEEL_JOINTS):
    return {keys.JOINT_STATES: m.JointState(name=names, velocity=tuple(speeds))}


class Controller(Steps):
    def __init__(self, tick_s=0.01, **settings):
        super().__init__(ControllerNode, scenario(tick_s, **settings))

    def drive(self, tick, reference=None, measured=STANDING):
        """Return the wheel speeds [rad/s] that a tick commands."""
        come = {} if reference is None else {keys.CMD_VEL: m.Twist.planar(reference)}
        return self.step(tick, joints(measured) | come)[keys.JOINT_COMMAND].velocity

    def forward(self, ticks, speed=None, measured=STANDING):
        """Return the speed [m/s] along x that each tick commands, all four wheels alike."""
        reference = None if speed is None else Twist2D(speed)
        commands = [self.drive(tick, reference, measured) for tick in ticks]
        assert all(max(speeds) == min(speeds) for speeds in commands)
        return [speeds[0] * 0.05 for speeds in commands]


@pytest.mark.parametrize(
    ("twist", "speeds"),
    [
        (Twist2D(0.2, 0.1, 0.5), (-1.0, 9.0, 3.0, 5.0)),
        # 28, 92, 68, 52 rad/s: over the limit, so all are slower and the direction stays
        (Twist2D(3.0, 1.0, 2.0), (28.0 / 2.3, 40.0, 68.0 / 2.3, 52.0 / 2.3)),
    ],
)
def test_a_reference_becomes_the_wheel_speeds_of_the_published_equations(twist, speeds):
    assert Controller(limits=UNLIMITED).drive(0, twist) == pytest.approx(speeds)


def test_limits_hold_once_a_tick_however_many_references_come_in_it():
    controller = Controller()
    # 2.5 m/s² make 0.025 m/s in a tick; the last reference counts, from the same state
    for speed, expected in ((1.0, 0.025), (1.0, 0.025), (-1.0, -0.025), (1.0, 0.025)):
        assert controller.forward([0], speed) == pytest.approx([expected])
    assert controller.forward([1]) == pytest.approx([0.05])


@pytest.mark.parametrize("tick_s", [0.01, 0.0123])
def test_at_any_period_acceleration_and_timeout_are_in_seconds(tick_s):
    controller = Controller(tick_s, reference_timeout_s=0.1)
    change = 2.5 * tick_s
    rising = [change * n for n in range(1, 21)]
    assert controller.forward(range(20), 1.0) == pytest.approx(rising)
    fresh = math.floor(0.1 / tick_s + 1e-9)
    *_, last, stale = controller.forward(range(20, 21 + fresh))
    assert last == pytest.approx(change * (20 + fresh))
    assert stale == pytest.approx(change * (19 + fresh))
    # three ticks are missed: meanwhile the wheels went on, so they change by one tick's share
    assert controller.forward([24 + fresh]) == pytest.approx([change * (18 + fresh)])


def test_a_stale_reference_brings_the_robot_to_rest_within_its_deceleration_limit():
    limits = AxisLimits(x=LinearLimits(max_acceleration_m_s2=5.0, max_deceleration_m_s2=1.0))
    controller = Controller(limits=limits, reference_timeout_s=0.05)
    assert controller.forward(range(3), 0.1) == pytest.approx([0.05, 0.1, 0.1])
    speeds = controller.forward(range(3, 20))
    assert speeds[:5] == pytest.approx([0.1] * 5)  # as old as the timeout: still good
    assert speeds[5:15] == pytest.approx([0.09 - 0.01 * i for i in range(10)], abs=1e-12)
    assert speeds[14:] == [0.0, 0.0, 0.0]
    # the next good one moves it again
    assert controller.forward(range(20, 22), 0.1) == pytest.approx([0.05, 0.1])


def test_a_guard_that_has_fallen_silent_is_obeyed_only_as_long_as_it_counts_on():
    guarded = Scenario(robot=NEXUS, sensor=SensorConfig(also=("lidar",)))
    controller = Steps(ControllerNode, guarded)
    forward = {keys.GUARD_CMD_VEL: m.Twist.planar(Twist2D(0.5))}
    speeds = []
    for tick in range(60):
        samples = joints(STANDING) | (forward if tick < 40 else {})
        speeds.append(controller.step(tick, samples)[keys.JOINT_COMMAND].velocity[0] * 0.05)
    braking = [0.5 - 0.025 * n for n in range(1, 16)]
    # 0.05 s are five ticks more; then it brakes by 2.5 m/s²
    assert speeds[39:] == pytest.approx([0.5] * 6 + braking)


def test_a_controller_that_was_held_up_goes_on_from_the_motion_once_the_wheels_gave_it_up():
    guarded = Scenario(robot=NEXUS, sensor=SensorConfig(also=("lidar",)))
    forward = {keys.GUARD_CMD_VEL: m.Twist.planar(Twist2D(0.5))}
    for missed, expected in ((4, 0.5), (5, 0.025)):  # 0.05 s, and more: the robot stands
        controller = Steps(ControllerNode, guarded)
        for tick in range(40):
            controller.step(tick, joints(STANDING) | forward)
        outputs = controller.step(40 + missed, joints(STANDING) | forward)
        assert outputs[keys.JOINT_COMMAND].velocity[0] * 0.05 == pytest.approx(expected)


def test_a_controller_that_joins_late_or_was_held_up_goes_on_from_how_the_robot_moves():
    slower = 1.0 - 2.5 * 0.01
    assert Controller().forward([500], measured=(20.0,) * 4) == pytest.approx([slower])
    controller = Controller()
    controller.forward(range(100), 0.5)
    assert controller.forward([251], 0.5) == pytest.approx([2.5 * 0.01])


def test_a_run_begins_at_rest_and_without_a_reference():
    controller = Controller(limits=UNLIMITED)
    controller.forward(range(150), 0.5)
    controller.drive(162)
    assert controller.node.diagnostics() == {"reference_age_s": 0.13, "expired_ticks": 0}
    controller.reset(1)
    assert controller.node.diagnostics() == {"reference": "none yet"}
    assert controller.drive(0, measured=(20.0,) * 4) == controller.drive(1) == STANDING


def test_frames_joints_and_lengths_are_the_users():
    names = ("fl", "fr", "rl", "rr")
    users = {"odom_frame_id": "o", "base_frame_id": "b"}
    seen = scenario(wheel_radius_m=0.1, half_track_m=0.35, limits=UNLIMITED, **users)
    wheels = msgspec.structs.replace(seen.robot.wheels, joints=names)
    robot = msgspec.structs.replace(seen.robot, wheels=wheels)
    seen = msgspec.structs.replace(seen, robot=robot)
    measured = joints(STANDING, names)
    reference = {keys.CMD_VEL: m.Twist.planar(Twist2D(yaw=1.0))}
    command = Steps(ControllerNode, seen).step(7, measured | reference)[keys.JOINT_COMMAND]
    assert (command.header.stamp, command.name) == (m.Time(nanosec=70_000_000), names)
    assert command.velocity == pytest.approx((-5.0, 5.0, -5.0, 5.0))
    odom = Steps(OdometryNode, seen).step(7, measured)[keys.ODOM]
    assert odom.header == m.Header(m.Time(nanosec=70_000_000), "o")
    assert odom.child_frame_id == "b"


class Wheels(Steps):
    def __init__(self, tick_s=None, **settings):
        super().__init__(OdometryNode, scenario(**settings), tick_s)

    def measure(self, tick, speeds, names=WHEEL_JOINTS):
        """Return the odometry of a tick; None where it brings none."""
        return self.step(tick, joints(speeds, names)).get(keys.ODOM)


def moved(odom):
    """Return the pose as seen from the start."""
    return START.pose.between(odom.pose.pose.to_planar())


@pytest.mark.parametrize("tick_s", [0.01, 0.0123])
def test_a_driven_circle_gives_the_exact_pose_at_any_period(tick_s):
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
def test_a_missing_wheel_is_an_error_at_first_and_refused_later(speeds, names):
    problem = "robot.wheels.joints: joint_states has no velocity of '.*_wheel_joint'"
    with pytest.raises(ConfigError, match=problem):
        Wheels().measure(0, speeds, names)
    wheels = Wheels()
    wheels.measure(0, STANDING)
    assert wheels.measure(1, speeds, names) is None
    assert wheels.refused == ["joint_states"]
    # ticks refused and missed are driven with the speeds measured next: 0.1 m/s
    assert moved(wheels.measure(2, (2.0,) * 4)).x == pytest.approx(0.002)
    assert moved(wheels.measure(7, (2.0,) * 4)).x == pytest.approx(0.007)


# At 20 rad/s² from rest the wheels turn ½ 20 t² = 0.001 rad in the first tick of 10 ms, and
# the speed at its end, 0.2 rad/s, would say 0.002. The wheels turn at most 40 rad/s.
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
def test_the_angles_of_the_wheels_say_how_far_they_went(measured, turned):
    wheels = Wheels()
    for tick, speed, angle in measured:
        position = () if angle is None else (angle,) * 4
        state = m.JointState(name=WHEEL_JOINTS, position=position, velocity=(speed,) * 4)
        odom = wheels.step(tick, {keys.JOINT_STATES: state})[keys.ODOM]
    assert moved(odom).x == pytest.approx(turned * 0.05)
    assert odom.twist.twist.to_planar() == pytest.approx(Twist2D(speed * 0.05))


def test_odometry_is_scaled_and_says_how_certain_it_is():
    variances = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    wheels = Wheels(
        odometry_scale=c.OdometryScale(y=0.9),
        pose_covariance_diagonal=variances,
        twist_covariance_diagonal=variances[::-1],
    )
    wheels.measure(0, STANDING)
    odom = wheels.measure(1, (-10.0, 10.0, 10.0, -10.0))
    assert odom.twist.twist.linear.y == pytest.approx(0.45)
    assert moved(odom).y == pytest.approx(0.0045)
    assert odom.pose.covariance[::7] == variances
    assert odom.twist.covariance[::7] == variances[::-1]


def test_wheels_are_found_by_name_among_other_joints():
    odom = Wheels().measure(0, (9.0, 8.0, 2.0, 6.0, 4.0), ("arm", *WHEEL_JOINTS[::-1]))
    # front left 4, front right 6, rear left 2, rear right 8 rad/s
    twist = (0.25, -0.05, 8.0 * 0.05 / 4 / 0.3)
    assert odom.twist.twist.to_planar() == pytest.approx(twist)


def test_update_rate_thins_out_odom_and_leaves_out_nothing_of_the_way():
    wheels = Wheels(update_rate_hz=25.0)
    odoms = [wheels.measure(tick, (2.0,) * 4) for tick in range(9)]
    assert [tick for tick, odom in enumerate(odoms) if odom is not None] == [0, 4, 8]
    assert moved(odoms[8]).x == pytest.approx(0.1 * 0.08)
    assert Wheels(update_rate_hz=100.0).node.ticks_per_sample == 1
    for rate in (30.0, 200.0):
        problem = rf"^controller.update_rate_hz = {rate:g} must divide the tick rate of 100 Hz"
        with pytest.raises(ConfigError, match=problem):
            Wheels(update_rate_hz=rate)


def test_ground_truth_mode_publishes_the_truth_in_the_frame_of_the_odometry():
    seen = scenario(odometry="ground_truth", odom_frame_id="map")
    assert keys.GROUND_TRUTH in [i.topic for i in graph_of(seen).row("odometry").inputs]
    pose, twist = Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3)
    truth = m.planar_odometry(m.Time(), "world", "x", pose, twist, tuple(range(36)))
    steps = Steps(OdometryNode, seen)
    odom = steps.step(0, {keys.GROUND_TRUTH: truth})[keys.ODOM]
    assert (odom.pose, odom.twist) == (truth.pose, truth.twist)
    assert (odom.header.frame_id, odom.child_frame_id) == ("map", "base_link")
    with pytest.raises(RefusedError, match="nothing to set"):
        steps.node.answer(keys.SET_ODOMETRY, m.OdometryRequest())


def test_set_odometry_moves_the_pose_and_odometry_goes_on_from_there_until_the_next_run():
    wheels = Wheels()
    first = wheels.measure(0, STANDING)
    wheels.measure(1, (2.0,) * 4)
    request = m.OdometryRequest(pose=m.Pose.planar(Pose2D(5.0, 6.0, math.pi / 2)))
    answer = wheels.node.answer(keys.SET_ODOMETRY, request)
    assert answer.pose.pose.to_planar() == pytest.approx((5.0, 6.0, math.pi / 2))
    assert answer.twist.twist.to_planar() == pytest.approx((0.1, 0.0, 0.0))  # as before
    assert answer.header.stamp == m.Time(nanosec=10_000_000)
    odom = wheels.measure(2, (2.0,) * 4)
    assert odom.pose.pose.to_planar() == pytest.approx((5.0, 6.001, math.pi / 2))
    wheels.reset(1)
    assert wheels.measure(0, STANDING) == first
    assert moved(first) == pytest.approx(Pose2D(), abs=1e-15)


def test_other_limits_count_from_the_next_tick_on_and_the_speed_goes_on_from_there():
    limits = AxisLimits(LinearLimits(max_acceleration_m_s2=1.0))
    controller = Controller(limits=limits)
    assert controller.forward(range(10), 2.0)[-1] == pytest.approx(0.1)
    controller.node.configure(scenario(limits=AxisLimits(LinearLimits(0.15, 4.0))))
    assert controller.forward(range(10, 13), 2.0) == pytest.approx([0.14, 0.15, 0.15])


NEXT_RUN = 2**32 - 1
ISOLATED = ("physics", "controller")
FOLLOWER_ACTIVE = (*ISOLATED, "follower")


class OnBus(Rig):
    """A controller that obeys at once, unless told otherwise."""

    def __init__(self, services=ISOLATED, **settings):
        config = ControllerConfig(limits=UNLIMITED, **settings)
        lockstep = SimConfig(mode="lockstep")
        scenario = Scenario(load_robot(), services=services, sim=lockstep, controller=config)
        super().__init__("controller", scenario, keys.ODOM, keys.JOINT_COMMAND)

    def tick(self, tick, speeds=STANDING, run=1):
        joints = JointState(name=WHEEL_JOINTS, velocity=speeds)
        return self.put(keys.JOINT_STATES, joints, self.at(tick, run))

    def command(self, tick, *twist, run=1):
        return self.put(keys.CMD_VEL, Twist.planar(Twist2D(*twist)), self.at(tick, run))


def test_where_nobody_leads_joint_states_are_answered_at_once_and_later_commands_replace_that():
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


def test_where_a_follower_leads_the_command_waits_for_its_cmd_vel():
    rig = OnBus(FOLLOWER_ACTIVE)
    (odom,) = rig.tick(0)
    (command,) = rig.command(0, 0.1)
    assert (odom.key, command.key, command.stamp) == ("odom", "joint_command", rig.at(0))
    assert command.message.velocity == pytest.approx([2.0] * 4)


def test_a_tick_in_which_no_odometry_comes_does_not_wait_for_the_follower():
    rig = OnBus(FOLLOWER_ACTIVE, update_rate_hz=25.0)
    assert [sample.key for sample in rig.tick(0)] == ["odom"]
    rig.command(0, 0.1)
    for tick in (1, 2, 3):
        (command,) = rig.tick(tick)
        assert (command.key, command.stamp) == ("joint_command", rig.at(tick))
    assert [sample.key for sample in rig.tick(4)] == ["odom"]


def test_set_odometry_is_answered_on_the_bus():
    rig = OnBus()
    rig.tick(0)
    answer = rig.bus.call(keys.SET_ODOMETRY, OdometryRequest(pose=Pose.planar(Pose2D(5.0))))
    assert answer.pose.pose == rig.tick(1)[0].message.pose.pose == Pose.planar(Pose2D(5.0))


GOOD = {
    "joint_states": [JointState(name=WHEEL_JOINTS, velocity=(1.0, 2.0, 3.0, 4.0))],
    "cmd_vel": [Twist.planar(Twist2D(0.1, 0.2, 0.3))],
}


@malformed(GOOD)
def test_malformed_payloads_change_nothing_for_the_run(wrong):
    rig = OnBus(FOLLOWER_ACTIVE)
    rig.tick(0)
    rig.command(0, 0.1)
    rig.put_wrong(wrong)
    (odom,) = rig.tick(1, (2.0,) * 4)
    assert odom.message.pose.pose.to_planar() == (0.1 * 0.01, 0.0, 0.0)
    (command,) = rig.command(1, 0.2, 0.1, 0.5)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))


@forged(GOOD)
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(wrong):
    rig = OnBus()
    rig.tick(0)
    for sample in rig.put_wrong(wrong):
        if sample.key == "joint_command":
            assert max(map(abs, sample.message.velocity)) <= 40.0
    odom, _ = rig.tick(0, run=NEXT_RUN)
    assert odom.message.pose.pose.to_planar() == Pose2D()
    rig.command(0, 0.2, 0.1, 0.5, run=NEXT_RUN)
    odom, command = rig.tick(1, (2.0,) * 4, run=NEXT_RUN)
    assert odom.message.pose.pose.to_planar() == (0.1 * 0.01, 0.0, 0.0)
    assert command.message.velocity == pytest.approx((-1.0, 9.0, 3.0, 5.0))
