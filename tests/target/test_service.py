"""The target on the bus: the person's truth at every tick, and what the sensor saw of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
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
from hypothesis import given
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import Scenario, SensorConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Odometry, Time, Twist, planar_odometry
from mecazen.wire import Stamp, encode
from mecazen_target.config import Circle, Driven, Gait, Recorded, Standing, Straight, TargetConfig
from mecazen_target.service import TargetService

RUN, NEXT_RUN = 5, 2**32 - 1
TICK_NS = 10_000_000
NEXUS = load_robot()
ORIGIN = Pose2D()
EXACT = SensorConfig(position_std_m=0.0, yaw_std_deg=0.0)
STANDING = TargetConfig(path=Standing(x_m=2.0, y_m=1.0, yaw_deg=90.0))
DRIVEN = TargetConfig(path=Driven(timeout_s=0.05))


class Rig:
    """A target, and the physics that it answers."""

    def __init__(self, config: TargetConfig, sensor: SensorConfig = EXACT, seed: int = 1) -> None:
        self.bus = LocalBus()
        scenario = Scenario(robot=NEXUS, seed=seed, sensor=sensor, sections={"target": config})
        self.service = TargetService(self.bus, scenario)
        self.ground_truth = self.bus.publisher(keys.GROUND_TRUTH)
        self.cmd_vel = self.bus.publisher(keys.TARGET_CMD_VEL)
        self.heard = Listener(self.bus, keys.TARGET_ODOM, keys.OBSERVATION)
        self.health = Listener(self.bus, keys.diagnostics("target"))

    def tick(
        self, tick: int, robot: Pose2D = ORIGIN, run: int = RUN, seed: int = 1
    ) -> list[Sample]:
        """Publish the robot's true pose at a tick; return what comes of it."""
        stamp = Stamp(tick * TICK_NS, run, seed)
        self.ground_truth.put(
            planar_odometry(stamp.time, "world", "base_link", robot, Twist2D()), stamp
        )
        self.bus.spin()
        return self.heard.take()

    def person(self, tick: int, run: int = RUN) -> Odometry:
        """Return the person's truth at a tick."""
        return self.tick(tick, run=run)[0].message

    def command(self, twist: Twist2D, stamp: Any = None) -> None:
        self.cmd_vel.put(Twist.planar(twist), stamp)
        self.bus.spin()

    def seen(self, tick: int, robot: Pose2D = ORIGIN) -> Pose2D | None:
        """Return what the frame of a tick shows."""
        _, observation = self.tick(tick, robot)
        poses = observation.message.poses
        return poses[0].pose.to_planar() if poses else None


def pose_of(message: Any) -> Pose2D:
    return message.pose.pose.to_planar()


def bytes_of(samples: Sequence[Sample]) -> bytes:
    return b"".join(encode(sample.message, "json") for sample in samples)


def test_every_tick_is_answered_by_the_truth_and_each_fourth_by_a_frame():
    rig = Rig(STANDING)
    for tick in range(9):
        odom, *frames = rig.tick(tick)
        assert (odom.key, odom.stamp) == ("target/odom", Stamp(tick * TICK_NS, RUN, 1))
        assert odom.message.header.stamp == Time(nanosec=tick * TICK_NS)
        assert (odom.message.header.frame_id, odom.message.child_frame_id) == ("world", "person")
        assert pose_of(odom.message) == pytest.approx((2.0, 1.0, math.pi / 2))
        assert [frame.key for frame in frames] == ["target/observation"] * (tick % 4 == 0)
        assert [frame.stamp for frame in frames] == [odom.stamp] * (tick % 4 == 0)


def test_a_frame_shows_the_person_from_where_the_robot_truly_is():
    rig = Rig(STANDING)
    observation = rig.tick(0, Pose2D(1.0, 1.0, math.pi))[1].message
    assert observation.header.frame_id == "base_link"
    # the person, at (2, 1) with heading 90°, is 1 m behind a robot that looks back along x
    assert observation.poses[0].pose.to_planar() == pytest.approx((-1.0, 0.0, -math.pi / 2))
    assert observation.poses[0].covariance == (0.0,) * 36


def test_in_the_world_frame_the_robots_place_does_not_matter():
    rig = Rig(STANDING, SensorConfig(frame="world", position_std_m=0.0, yaw_std_deg=0.0))
    observation = rig.tick(0, Pose2D(1.0, 1.0, math.pi))[1].message
    assert observation.header.frame_id == "world"
    assert observation.poses[0].pose.to_planar() == pytest.approx((2.0, 1.0, math.pi / 2))


def test_a_frame_tells_the_covariance_of_its_noise():
    rig = Rig(STANDING, SensorConfig(position_std_m=0.1, yaw_std_deg=math.degrees(0.2)))
    covariance = rig.tick(0)[1].message.poses[0].covariance
    assert covariance[::7] == pytest.approx((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))


def test_a_frame_in_which_nothing_was_seen_is_sent_empty():
    occluded = Rig(
        STANDING,
        SensorConfig(position_std_m=0.0, yaw_std_deg=0.0, occlusions_s=((0.04, 0.08),)),
    )
    assert [occluded.seen(tick) is None for tick in (0, 4, 8)] == [False, True, False]
    dropped = Rig(STANDING, SensorConfig(dropout_probability=1.0))
    assert [dropped.seen(tick) for tick in (0, 4, 8)] == [None] * 3
    short = Rig(STANDING, SensorConfig(max_range_m=2.0, position_std_m=0.0))
    assert short.seen(0) is None
    assert short.seen(4, Pose2D(1.0, 1.0)) is not None
    narrow = Rig(STANDING, SensorConfig(fov_deg=90.0, position_std_m=0.0))
    assert narrow.seen(0) is not None  # at 27°
    assert narrow.seen(4, Pose2D(yaw=-math.pi / 4)) is None


def test_a_late_frame_is_stamped_with_its_capture_and_shows_the_poses_of_then():
    rig = Rig(
        TargetConfig(path=Straight(speed_m_s=1.0)),
        SensorConfig(position_std_m=0.0, yaw_std_deg=0.0, latency_s=0.03),
    )
    frames = {}
    for tick in range(9):
        odom, *seen = rig.tick(tick, Pose2D(x=-0.5 * tick))
        if seen:
            frames[tick] = seen[0]
        assert pose_of(odom.message).x == pytest.approx(0.01 * tick)
    assert frames[0].message.poses == ()  # taken before anything was
    for tick in (4, 8):
        message, stamp = frames[tick].message, frames[tick].stamp
        captured = tick - 3
        assert message.header.stamp == Time(nanosec=captured * TICK_NS)
        assert stamp is not None
        assert stamp.time_ns == tick * TICK_NS
        assert message.poses[0].pose.position.x == pytest.approx(0.51 * captured)


def test_a_latency_or_a_rate_that_is_not_in_whole_ticks_is_one_clear_error():
    with pytest.raises(ConfigError, match=r"^sensor.latency_s: 0.015 s is not a whole .*$"):
        Rig(STANDING, SensorConfig(latency_s=0.015))
    with pytest.raises(ConfigError, match=r"^sensor.rate_hz: .* not a whole number of ticks .*$"):
        Rig(STANDING, SensorConfig(rate_hz=30.0))


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    config = TargetConfig(path=Circle(), gait=Gait())
    sensor = SensorConfig(dropout_probability=0.2)

    def run(seed: int) -> bytes:
        rig = Rig(config, sensor, seed)
        return bytes_of([s for k in range(200) for s in rig.tick(k, seed=seed)])

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_a_new_run_walks_the_path_anew_with_the_noise_of_its_own_seed():
    config = TargetConfig(path=Circle(speed_m_s=1.0))
    rig = Rig(config, SensorConfig())
    first = bytes_of([sample for k in range(50) for sample in rig.tick(k)])
    again = bytes_of([sample for k in range(50) for sample in rig.tick(k, run=RUN + 1)])
    other = bytes_of([sample for k in range(50) for sample in rig.tick(k, run=RUN + 2, seed=2)])
    fresh = Rig(config, SensorConfig(), seed=2)
    assert first == again
    assert first != other
    assert other == bytes_of([sample for k in range(50) for sample in fresh.tick(k, seed=2)])
    assert rig.tick(50) == []  # still on its way from before the reset


def test_a_driven_person_moves_by_the_commands_and_stops_when_they_end():
    rig = Rig(DRIVEN)
    assert pose_of(rig.person(0)) == Pose2D()
    rig.bus.put_bytes("target/cmd_vel", b'{"linear":{"x":1.0}}')
    rig.bus.spin()
    walked = [rig.person(tick) for tick in range(1, 9)]
    # 5 ticks of 10 mm, then the timeout
    expected = [0.01, 0.02, 0.03, 0.04, 0.05, 0.05, 0.05, 0.05]
    assert [pose_of(odom).x for odom in walked] == pytest.approx(expected)
    speeds = [odom.twist.twist.linear.x for odom in walked]
    assert speeds == [1.0] * 5 + [0.0] * 3
    rig.command(Twist2D(y=1.0, yaw=2.0))
    turned = rig.person(9)
    assert pose_of(turned) == pytest.approx(Pose2D(0.05).integrate(Twist2D(0.0, 1.0, 2.0), 0.01))


def test_a_driven_person_makes_up_for_missed_ticks_but_not_beyond_the_timeout():
    rig = Rig(DRIVEN)
    rig.person(0)
    rig.command(Twist2D(x=1.0))
    assert pose_of(rig.person(3)).x == pytest.approx(0.03)
    odom = rig.person(100)
    assert pose_of(odom).x == pytest.approx(0.05)
    assert odom.twist.twist.linear.x == 0.0
    assert pose_of(rig.person(200_000_000)).x == pytest.approx(0.05)  # 23 days later, at once


def test_a_person_on_a_path_misses_nothing_either():
    rig = Rig(TargetConfig(path=Straight(speed_m_s=1.0, length_m=3.0)))
    assert pose_of(rig.person(100)).x == pytest.approx(1.0)
    assert pose_of(rig.person(1000)).x == pytest.approx(3.0)


def test_a_person_on_a_path_hears_no_commands():
    rig = Rig(STANDING)
    rig.command(Twist2D(x=1.0))
    assert pose_of(rig.person(10)) == pytest.approx((2.0, 1.0, math.pi / 2))


@pytest.mark.parametrize(
    "payload",
    [b"", b"{", b'{"linear":{"x":NaN}}', b'{"angular":{"z":[]}}', b'{"linear":{"x":1e308}}'],
)
def test_a_refused_command_leaves_the_last_good_one(payload: bytes):
    rig = Rig(DRIVEN)
    rig.person(0)
    rig.command(Twist2D(x=1.0))
    rig.bus.put_bytes("target/cmd_vel", payload)
    rig.bus.spin()
    assert rig.bus.refused == {"target/cmd_vel": 1}
    assert pose_of(rig.person(9)).x == pytest.approx(0.05)


def test_a_command_of_another_run_neither_moves_nor_resets():
    rig = Rig(DRIVEN)
    rig.person(0)
    rig.command(Twist2D(x=1.0))
    rig.person(2)
    rig.command(Twist2D(x=-1.0), Stamp(0, RUN + 1, 0))
    assert pose_of(rig.person(3)).x == pytest.approx(0.03)


def test_each_tick_is_answered_once_and_only_with_a_stamp():
    rig = Rig(STANDING)
    assert rig.tick(4)
    assert rig.tick(4) == rig.tick(3) == []
    rig.bus.put_bytes("ground_truth/odom", b"{}")
    rig.bus.spin()
    assert rig.heard.take() == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "line 1: must name the columns t_s,x_m,y_m; t_s,x_m,y_m missing"),
        ("t_s,x_m\n0,0\n", "line 1: must name the columns t_s,x_m,y_m; y_m missing"),
        ("t_s,x_m,y_m\n0,0,0\n", "must have at least 2 rows below its header, has 1"),
        ("t_s,x_m,y_m\n0,0,0\n1,east,0\n", "line 3: x_m must be a number .* is 'east'"),
        ("t_s,x_m,y_m\n0,0,0\n0,1,0\n", "line 3: t_s must grow by at least 0.001 s, .*"),
        ("t_s,x_m,y_m\n0,0,0\n1,nan,0\n", "line 3: x_m must be a number .* is 'nan'"),
    ],
)
def test_a_recorded_track_that_cant_be_used_is_one_line_with_file_and_place(
    tmp_path: Path, text: str, problem: str
):
    file = tmp_path / "walk.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=rf"^target.path: .*walk.csv: {problem}$") as error:
        Rig(TargetConfig(path=Recorded(file=file)))
    assert "\n" not in str(error.value)
    with pytest.raises(ConfigError, match=r"^target.path: .*none.csv: can't be read: No such"):
        Rig(TargetConfig(path=Recorded(file=tmp_path / "none.csv")))


def test_a_recorded_track_is_walked_from_the_start_pose(tmp_path: Path):
    file = tmp_path / "walk.csv"
    rows = [f"{5 + 0.1 * i},{100 + 0.1 * i},7" for i in range(41)]
    file.write_text("\n".join(["t_s,x_m,y_m", *rows]))
    rig = Rig(TargetConfig(path=Recorded(file=file, x_m=1.0, yaw_deg=90.0)))
    assert pose_of(rig.person(0)) == pytest.approx((1.0, 0.0, math.pi / 2))
    assert pose_of(rig.person(200)) == pytest.approx((1.0, 2.0, math.pi / 2))
    assert pose_of(rig.person(9000)) == pytest.approx((1.0, 4.0, math.pi / 2))


def test_diagnostics_tell_the_way_walked():
    rig = Rig(TargetConfig(path=Straight(speed_m_s=1.0)))
    for tick in range(201):
        rig.tick(tick)
    health = [sample.message.status[0] for sample in rig.health.take()]
    values = [{value.key: value.value for value in status.values} for status in health]
    assert [value["time_s"] for value in values] == ["0.0", "1.0", "2.0"]
    assert [value["walked_m"] for value in values] == ["0.0", "0.99", "1.99"]
    assert [value["refused_payloads"] for value in values] == ["0"] * 3


GOOD = {
    "ground_truth/odom": [
        planar_odometry(Time(1), "world", "base_link", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1))
    ],
    "target/cmd_vel": [Twist.planar(Twist2D(0.1, 0.2, 0.3))],
}


@FUZZ
@given(puts({key: GOOD[key] for key in GOOD if key != "target/cmd_vel"}, NO_STAMP))
def test_malformed_payloads_change_nothing_for_the_run(wrong: list[Put]):
    rig = Rig(DRIVEN)
    rig.person(0)
    put_all(rig.bus, wrong)
    rig.command(Twist2D(x=1.0))
    for tick in range(1, 4):
        odom = rig.tick(tick)[0]
        assert pose_of(odom.message).x == pytest.approx(0.01 * tick)
    odom, observation = rig.tick(4, Pose2D(y=1.0))
    assert observation.message.poses[0].pose.to_planar() == pytest.approx((0.04, -1.0, 0.0))


@FUZZ
@given(puts(GOOD, FORGED))
def test_even_forged_stamps_bring_no_number_that_is_not_finite_and_no_lasting_harm(
    wrong: list[Put],
):
    rig = Rig(DRIVEN)
    rig.person(0)
    put_all(rig.bus, wrong)
    for sample in rig.tick(5) + rig.health.take():  # and all since the last
        assert_sendable(sample)
    assert pose_of(rig.person(0, NEXT_RUN)) == Pose2D()
    rig.command(Twist2D(x=1.0))
    assert pose_of(rig.person(3, NEXT_RUN)).x == pytest.approx(0.03)
    observation = rig.tick(4, Pose2D(y=1.0), NEXT_RUN)[1].message
    assert observation.poses[0].pose.to_planar() == pytest.approx((0.04, -1.0, 0.0))


@pytest.mark.parametrize("frame", ["base_link", "world"])
@pytest.mark.parametrize("x", [1e155, -1e308, 1.797e308])
def test_a_robot_far_beyond_the_world_sees_nobody(frame: Any, x: float):
    rig = Rig(STANDING, SensorConfig(frame=frame))
    for sample in rig.tick(0, Pose2D(x, x, 1.0)):
        assert_sendable(sample)
    assert rig.seen(4, Pose2D(x, -x, 1.0)) is None
    assert rig.seen(8) is not None
