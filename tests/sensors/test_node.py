"""The sensors as nodes: when they look, what of, and settings that do not go together."""

import pytest
from harness import SCENARIOS, Steps
from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario
from mecazen.messages import Header, Point, Skeleton, Time, planar_odometry
from mecazen_sensors.node import DepthNode, LidarNode, TrackerNode
from people import HEIGHT, body

SENSES = SCENARIOS / "senses.toml"


class Sensor(Steps):
    """A sensor beside a robot at the origin and a person 1.5 m ahead."""

    def __init__(self, kind, *settings: str) -> None:
        super().__init__(kind, load_scenario(SENSES, settings))

    def tick(self, tick: int):
        """Return the outputs of a tick."""
        joints = tuple(Point(*joint) for joint in body(pose=(1.5, 0.0, 0.0)).tolist())
        return self.step(
            tick,
            {
                keys.GROUND_TRUTH: planar_odometry(Time(), "world", "x", Pose2D(), Twist2D()),
                keys.TARGET_SKELETON: Skeleton(header=Header(), height=HEIGHT, joints=joints),
            },
        )


@pytest.mark.parametrize(
    ("kind", "topic", "first", "period"),
    [
        (LidarNode, keys.SCAN, 0, 10),
        (TrackerNode, keys.SKELETONS, 0, 4),
        (DepthNode, keys.DEPTH, 0, 20),
    ],
)
def test_a_sensor_answers_at_its_rate_and_at_no_other_tick(kind, topic, first, period):
    sensor = Sensor(kind)
    answered = [tick for tick in range(0, 42, 2) if topic in sensor.tick(tick)]
    assert answered == list(range(first, 42, period))


def test_a_frame_of_the_tracker_is_of_the_time_at_which_it_was_taken():
    sensor = Sensor(TrackerNode)
    frames = {tick: sensor.tick(tick).get(keys.SKELETONS) for tick in range(0, 20, 2)}
    assert frames[12].header.stamp.ns == 20_000_000
    assert len(frames[12].skeletons) == 1
    # what is said to be of before the start shows nobody
    assert frames[8].skeletons == ()


def test_a_frame_whose_capture_was_missed_shows_nobody_and_the_next_one_is_right():
    sensor = Sensor(TrackerNode)
    missed = {6, 8}  # as by a process that was stopped: 6 takes the frame of 16
    frames = {
        tick: sensor.tick(tick).get(keys.SKELETONS)
        for tick in range(0, 24, 2)
        if tick not in missed
    }
    assert frames[16].skeletons == ()
    assert frames[20].header.stamp.ns == 100_000_000


def test_the_lidar_sees_the_legs_of_the_person_where_they_are():
    scan = Sensor(LidarNode).tick(0)[keys.SCAN]
    # the lidar is 0.13 m behind the robot's middle, the person 1.5 m ahead of it
    assert min(r for r in scan.ranges[340:380] if r > 0.0) == pytest.approx(1.6, abs=0.15)


@pytest.mark.parametrize(
    ("kind", "setting", "named"),
    [
        (LidarNode, "sensors.lidar.rate_hz=20", "sensors.lidar"),
        (TrackerNode, "sensors.tracker.latency_s=0.11", "sensors.tracker"),
        (DepthNode, "sensors.depth.rate_hz=4", "sensors.depth"),
    ],
)
def test_a_capture_between_two_postures_of_the_skeleton_is_refused(kind, setting, named):
    with pytest.raises(ConfigError, match=f"{named}: period and latency must be whole multiples"):
        Sensor(kind, "sensors.skeleton_rate_hz=50", setting)


def test_the_same_seed_sees_the_same_and_another_one_other_noise():
    first, again = (Sensor(LidarNode).tick(0)[keys.SCAN] for _ in range(2))
    assert first == again
    assert Sensor(LidarNode, "seed=2").tick(0)[keys.SCAN] != first
