"""The guard at its boundary: scans and commands in, limited commands and states out."""

import math

import numpy as np
import pytest
from harness import SCENARIOS, Steps
from mecazen import messages as m
from mecazen.config import GuardConfig
from mecazen.config.sensors import LidarConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Twist2D
from mecazen.keys import CMD_VEL, GUARD_CMD_VEL, GUARD_STATE, ODOM, SCAN
from mecazen.loading import load_scenario, parse_settings
from mecazen_guard.node import GuardNode
from mecazen_guard.surroundings import SPACING_M, Surroundings

LIDAR, CONFIG = LidarConfig(), GuardConfig()
STEP = math.tau / LIDAR.beams
ANGLES = -math.pi + STEP * np.arange(LIDAR.beams)
NO_RETURN = LIDAR.max_range_m + 1.0
FREE = (NO_RETURN,) * LIDAR.beams
FORWARD = m.Twist.planar(Twist2D(x=0.5))
FAST = m.Twist.planar(Twist2D(x=1.0))
REAL = 'services=["hardware","controller"]'


def scan(ranges, seconds=0.0):
    return m.LaserScan(
        header=m.Header(stamp=m.Time.from_ns(round(seconds * 1e9))),
        angle_min=-math.pi,
        angle_increment=STEP,
        range_min=LIDAR.min_range_m,
        range_max=LIDAR.max_range_m,
        ranges=tuple(ranges),
    )


def wall(distance):
    """Return the ranges of a wall ahead, at right angles to the x axis."""
    along = np.cos(ANGLES)
    return np.where(along > 0.2, distance / np.maximum(along, 0.2), NO_RETURN)


def discs(*places, radius=0.05):
    """Return the ranges of upright cylinders, seen from the origin."""
    ranges = np.full(LIDAR.beams, NO_RETURN)
    for x, y in places:
        along = x * np.cos(ANGLES) + y * np.sin(ANGLES)
        across = x * np.sin(ANGLES) - y * np.cos(ANGLES)
        depth = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
        hit = (np.abs(across) < radius) & (along > 0.0)
        ranges = np.where(hit, np.minimum(ranges, along - depth), ranges)
    return ranges


def teleop(*settings):
    return load_scenario(SCENARIOS / "teleop.toml", parse_settings(settings))


class Guard(Steps):
    """A guard whose inputs are made by hand."""

    def __init__(self, *settings):
        super().__init__(GuardNode, teleop(*settings))
        self.tick = -1

    def drive(self, command=None, ranges=None, pose=Pose2D(), again=False, ahead_s=0.0):  # noqa: B008
        """Return the outputs of the next tick, or of the last one again."""
        self.tick += not again
        time = m.Time.from_ns(self.tick * self.tick_ns)
        samples = {
            ODOM: m.planar_odometry(time, "odom", "base_link", pose, Twist2D()),
            CMD_VEL: command,
            SCAN: None if ranges is None else scan(ranges, time.ns / 1e9 + ahead_s),
        }
        outputs = self.step(self.tick, {topic: m for topic, m in samples.items() if m})
        return outputs[GUARD_CMD_VEL], outputs[GUARD_STATE]


def test_nothing_is_let_through_without_scans():
    guard = Guard()
    let_through, state = guard.drive(FORWARD)
    assert (let_through, state.state, state.reason) == (m.Twist(), "blind", "no scan yet")
    let_through, state = guard.drive(FORWARD, FREE)
    assert (let_through, state.state) == (FORWARD, "clear")
    states = [guard.drive(FORWARD)[1] for _ in range(31)]  # three periods of the lidar
    assert [state.state for state in states] == ["clear"] * 30 + ["blind"]
    assert states[-1].reason == "the lidar has been silent for 0.3 s"
    assert guard.drive(FORWARD, FREE)[1].state == "clear"


@pytest.mark.parametrize(
    ("ranges", "ahead_s", "reason"),
    [
        ((2.0,) * 720, 0.05, "the stamp of a scan is 0.05 s ahead"),
        ((2.0,) * 720, -0.01, "a scan is not newer than the last"),
        ((2.0,) * 100, 0.0, "a scan has 100 beams instead of 720"),
        ((2.0,) * 10_000, 0.0, "the beams of a scan are not spread over the field of view"),
        ((0.0,) * 720, 0.0, "100% of the beams are invalid"),
        ((math.nan,) * 720, 0.0, "100% of the beams are invalid"),
        ((2.0, 0.0, 0.0, 0.0, 0.0) * 144, 0.0, "80% of the beams are invalid"),
    ],
)
def test_an_implausible_scan_is_refused_and_stops(ranges, ahead_s, reason):
    guard = Guard()
    guard.drive(FORWARD, FREE)
    let_through, state = guard.drive(FORWARD, ranges, ahead_s=ahead_s)
    assert (let_through, state.state, state.reason) == (m.Twist(), "blind", reason)
    assert guard.refused == [SCAN.key]
    assert guard.drive(FORWARD, FREE)[1].state == "clear"


def test_a_real_lidar_may_send_0_for_no_return():
    outdoors = np.where(discs((1.0, 0.0)) < NO_RETURN, discs((1.0, 0.0)), 0.0)
    _, state = Guard(REAL).drive(FORWARD, outdoors)
    assert state.state == "clear"
    assert state.distance > 0.5  # the disc, and nothing nearer
    assert Guard().drive(FORWARD, outdoors)[1].state == "blind"


def test_a_late_command_corrects_its_tick():
    guard = Guard()
    assert guard.drive(FORWARD, FREE)[0] == FORWARD
    late = m.Twist.planar(Twist2D(y=-0.5))
    assert guard.drive(late, again=True)[0] == late
    assert guard.drive()[0] == late


def stopping_distance(guard):
    """Return the distance of a wall at which the guard begins to brake a robot at 1 m/s [m]."""
    for _ in range(60):
        guard.drive(FAST, FREE)
    for step in range(200):
        distance = 2.0 - 0.01 * step
        if guard.drive(FAST, wall(distance))[1].state != "clear":
            return distance
    raise AssertionError("the robot may drive into the wall")


def test_braking_begins_earlier_if_a_silent_guard_is_obeyed():
    soon, late = (
        stopping_distance(Guard(f"guard.hold_s={hold_s}", "guard.person_margin_m=0.06"))
        for hold_s in (0.0, 0.2)
    )
    # 0.2 s at 1 m/s; the wall comes by steps of 0.01 m
    assert late - soon == pytest.approx(0.2, abs=0.015)


def test_after_a_gap_the_robot_is_taken_to_stand():
    def state_near_a_wall(gap_ticks):
        guard = Guard()
        for _ in range(60):
            guard.drive(FAST, FREE)
        guard.tick += gap_ticks
        return guard.drive(FAST, wall(0.7))[1].state

    assert state_near_a_wall(0) == "slow"  # it moves at 1 m/s
    assert state_near_a_wall(100) == "clear"


@pytest.mark.parametrize("jump", [Pose2D(5.0, 0.0), Pose2D(0.1, 0.0, 1.5)])
def test_a_jump_of_the_odometry_makes_old_scans_useless(jump):
    guard = Guard()
    guard.drive(FORWARD, FREE)
    guard.drive(FORWARD, pose=Pose2D(0.1, 0.0))
    let_through, state = guard.drive(FORWARD, pose=jump)
    assert (let_through, state.state) == (m.Twist(), "blind")
    assert state.reason == "the odometry was set, and there is no scan since"
    assert guard.drive(FORWARD, FREE, pose=jump)[1].state == "clear"


def test_a_changed_margin_counts_from_the_next_scan():
    guard, near = Guard(), (0.5,) * LIDAR.beams
    for _ in range(50):
        let_through, state = guard.drive(FORWARD, near)
    assert let_through.linear.x > 0.1
    guard.node.configure(teleop("guard.margin_m=0.3"))
    assert guard.drive(FORWARD)[1].state == state.state != "blind"
    for _ in range(50):
        let_through, state = guard.drive(FORWARD, near)
    assert (let_through, state.state) == (m.Twist(), "stop")
    assert guard.node.diagnostics()["reason"] == state.reason


class Points:
    """The points of scans from a lidar 0.1 m behind base_link, which is at poses in odom."""

    def __init__(self):
        self.surroundings = Surroundings(CONFIG, LIDAR, Pose2D(-0.1, 0.0))
        self.poses = PoseHistory(10**9)

    def update(self, ranges, seconds=0.0, pose=Pose2D()):  # noqa: B008
        """Update with a scan and return the points in base_link."""
        self.poses.add(round(seconds * 1e9), pose)
        self.surroundings.update(scan(ranges, seconds), seconds, self.poses)
        return self.surroundings.seen_from(pose)


def test_points_stay_in_odom_while_the_robot_moves():
    points, pose = Points(), Pose2D(2.0, 1.0, math.pi / 2)
    seen = points.update(discs((1.0, 0.0)), pose=pose)
    nearest = seen.xy[np.argmin(np.hypot(*seen.xy.T))]
    assert nearest == pytest.approx((0.85, 0.0), abs=SPACING_M)  # the front of the disc
    closer = points.surroundings.seen_from(Pose2D(2.0, 1.5, math.pi / 2)).xy
    assert np.min(np.hypot(*closer.T)) == pytest.approx(0.35, abs=0.005)


def test_legs_have_a_larger_margin_than_walls():
    behind = np.where(np.cos(ANGLES) < -0.7, 2.0 / np.maximum(-np.cos(ANGLES), 0.7), NO_RETURN)
    seen = Points().update(np.minimum(behind, discs((1.0, 0.1), (1.0, -0.1))))
    assert set(seen.margin[seen.xy[:, 0] > 0.0]) == {CONFIG.person_margin_m}
    assert set(seen.margin[seen.xy[:, 0] < 0.0]) == {CONFIG.margin_m}


@pytest.mark.parametrize("speed", [1.2, -1.2])
def test_a_walking_person_has_a_velocity_and_may_stop(speed):
    points = Points()
    for k in range(8):
        x = 2.5 + speed * 0.1 * k
        swing = 0.1 * math.sin(k)  # one leg ahead of the other
        seen = points.update(discs((x + swing, 0.1), (x - swing, -0.1)), 0.1 * k)
    # the legs hide parts of each other
    assert np.mean(seen.velocity[~seen.stops][:, 0]) == pytest.approx(speed, abs=0.15)
    assert np.all(np.abs(seen.velocity[seen.stops][:, 0]) < abs(speed) + 0.1)


def test_a_standing_object_has_no_velocity():
    points = Points()
    for k in range(8):
        pose = Pose2D(0.1 * k)
        seen = points.update(discs((2.0 - pose.x, 0.3)), 0.1 * k, pose)
    assert len(seen.xy)
    assert not seen.velocity.any()


def test_neighbouring_beams_without_measurement_are_something_near():
    points, ranges = Points(), np.full(LIDAR.beams, NO_RETURN)
    ranges[100] = ranges[300] = 0.0  # dropouts
    assert not len(points.update(ranges).xy)
    ranges[355:365] = 0.0
    x, y = points.update(ranges, 0.1).xy.mean(axis=0)
    assert (x, y) == pytest.approx((-0.1 + LIDAR.min_range_m, 0.0), abs=0.01)


def test_a_scan_without_a_known_pose_is_refused():
    points = Points()
    points.update(FREE, 0.5)
    with pytest.raises(RefusedError, match=r"no pose is known of 0\.6 s"):
        points.surroundings.update(scan(FREE, 0.6), 0.7, points.poses)
