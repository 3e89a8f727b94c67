"""The sensors as nodes: when they look, what of, and settings that do not go together."""

import pytest
from harness import SCENARIOS, Steps
from mecazen import keys
from mecazen.config.sensors import DepthConfig, LidarConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import (
    Header,
    NamedPose,
    People,
    Person,
    Point,
    Pose,
    Skeleton,
    Time,
    planar_odometry,
)
from mecazen_sensors.node import DepthNode, LidarNode, TrackerNode
from people import HEIGHT, body

SENSES = SCENARIOS / "senses.toml"


class Sensor(Steps):
    """A sensor beside a robot at the origin and a person 1.5 m ahead."""

    def __init__(self, kind, *settings: str) -> None:
        super().__init__(kind, load_scenario(SENSES, parse_settings(settings)))

    def tick(self, tick: int, *missing: keys.Topic):
        """Return the outputs of a tick."""
        joints = tuple(Point(*joint) for joint in body(pose=(1.5, 0.0, 0.0)).tolist())
        samples = {
            keys.GROUND_TRUTH: planar_odometry(Time(), "world", "x", Pose2D(), Twist2D()),
            keys.TARGET_SKELETON: Skeleton(header=Header(), height=HEIGHT, joints=joints),
        }
        return self.step(tick, {of: one for of, one in samples.items() if of not in missing})


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


@pytest.mark.parametrize(
    ("kind", "captured", "due"), [(LidarNode, 20, 40), (TrackerNode, 22, 24), (DepthNode, 20, 40)]
)
def test_a_sensor_skips_a_frame_if_the_pose_of_the_robot_is_late(kind, captured, due):
    sensor = Sensor(kind)
    assert sensor.tick(captured, keys.GROUND_TRUTH) == {}
    assert sensor.tick(due) != {}


def test_a_frame_of_the_tracker_is_of_the_time_at_which_it_was_taken():
    sensor = Sensor(TrackerNode)
    frames = {tick: sensor.tick(tick).get(keys.SKELETONS) for tick in range(0, 20, 2)}
    assert frames[12].header.stamp.ns == 20_000_000
    assert len(frames[12].skeletons) == 1
    # a frame with a time before the start shows no person
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


class Among(Sensor):
    """A sensor of the robot `two`, among another robot ahead and two other people."""

    def __init__(self, kind, others):
        Steps.__init__(
            self, kind, load_scenario(SCENARIOS / "convoy.toml", parse_settings((FUSED,))).of("two")
        )
        self.people = People(
            persons=tuple(
                Person(name, height=HEIGHT, joints=points(body(pose=(*place, 0.0))))
                for name, place in {"two": (1.5, 0.0), **others}.items()
            ),
            robots=(
                NamedPose("one", Pose.planar(Pose2D(0.0, 2.0))),
                NamedPose("two", Pose.planar(Pose2D())),
            ),
        )

    def tick(self, tick):
        skeleton = Skeleton(height=HEIGHT, joints=self.people.persons[0].joints)
        truth = planar_odometry(Time(), "world", "x", Pose2D(), Twist2D())
        inputs = {keys.GROUND_TRUTH: truth, keys.TARGET_SKELETON: skeleton}
        return self.step(tick, {**inputs, keys.PEOPLE: self.people})


FUSED = "sensor.kind=fused"
OTHERS = {"one": (2.5, 0.9), "walker_1": (-2.0, 0.0)}


def points(joints):
    return tuple(Point(*joint) for joint in joints.tolist())


def test_the_lidar_sees_everybody_and_other_robots():
    ranges = Among(LidarNode, OTHERS).tick(0)[keys.SCAN].ranges
    # the lidar is 0.13 m behind the robot's middle, legs are 0.15 m from the middle of a person
    assert min(ranges[:10]) == pytest.approx(1.87, abs=0.15)  # behind: the walker
    assert min(r for r in ranges[350:370] if r) == pytest.approx(1.63, abs=0.15)
    # on the left the other robot's lidar: at this height, 0.04 m in radius; noise of 0.01 m
    assert min(r for r in ranges[520:550] if r) == pytest.approx(1.96, abs=0.05)
    assert max(Sensor(LidarNode).tick(0)[keys.SCAN].ranges[:10]) == 13.0


def test_the_tracker_names_everybody_in_view_and_draws_nobodys_errors_from_anothers():
    sensors = Among(TrackerNode, {}), Among(TrackerNode, OTHERS)
    alone, among = (
        [sensor.tick(tick).get(keys.SKELETONS) for tick in range(0, 30, 2)] for sensor in sensors
    )
    frames = [frame for frame in among if frame is not None and frame.skeletons]
    assert {tuple(one.id for one in frame.skeletons) for frame in frames} == {("1", "2")}
    first = [f and f.skeletons[:1] for f in among]
    assert first == [f and f.skeletons for f in alone]


@pytest.mark.parametrize(
    ("config", "settings", "message"),
    [
        (LidarConfig, {"min_range_m": 2.0, "max_range_m": 1.0}, "must be below max_range_m = 1.0"),
        (DepthConfig, {"edge_probability": 0.6}, "at most 0"),
    ],
)
def test_wrong_settings_are_refused(config, settings, message):
    with pytest.raises(ValueError, match=message):
        config(**settings)
