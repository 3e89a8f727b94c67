"""The sensors as nodes: when they capture, whom they see, and settings that do not fit together."""

import numpy as np
import pytest
from harness import SCENARIOS, Steps
from mecazen import keys
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import (
    NamedPose,
    People,
    Person,
    Point,
    Pose,
    Skeleton,
    Time,
    planar_odometry,
)
from mecazen.parameters import changed
from mecazen_sensors.node import DepthNode, LidarNode, TrackerNode
from people import HEIGHT, body

NO_RETURN = 13.0
CONVOY = load_scenario(SCENARIOS / "convoy.toml", parse_settings(["sensor.kind=fused"])).of("two")
OTHER_ROBOT = NamedPose("one", Pose.planar(Pose2D(0.0, 2.0)))


def joints_at(x, y):
    return tuple(Point(*joint) for joint in body(pose=(x, y, 0.0)).tolist())


class Sensor(Steps):
    """A sensor at the origin, and a followed person 1.5 m ahead."""

    def __init__(self, kind, *settings, scenario=None):
        settings = parse_settings(settings)
        super().__init__(kind, scenario or load_scenario(SCENARIOS / "senses.toml", settings))

    def tick(self, tick, people=None, has_pose=True):
        """Return the outputs of a tick; `people` are the positions of other people, by id."""
        samples = {keys.TARGET_SKELETON: Skeleton(height=HEIGHT, joints=joints_at(1.5, 0.0))}
        if has_pose:
            samples[keys.GROUND_TRUTH] = planar_odometry(Time(), "world", "x", Pose2D(), Twist2D())
        if people is not None:
            persons = [
                Person(name, height=HEIGHT, joints=joints_at(*place))
                for name, place in people.items()
            ]
            samples[keys.PEOPLE] = People(persons=tuple(persons), robots=(OTHER_ROBOT,))
        return self.step(tick, samples)

    def frames(self, people, ticks=range(0, 40, 2)):
        """Return the skeletons of each frame with any; `people` is a function of the tick."""
        outputs = [self.tick(tick, people(tick)).get(keys.SKELETONS) for tick in ticks]
        return [frame.skeletons for frame in outputs if frame is not None and frame.skeletons]


@pytest.mark.parametrize(
    ("kind", "topic", "period"),
    [
        (LidarNode, keys.SCAN, 10),
        (TrackerNode, keys.SKELETONS, 4),
        (DepthNode, keys.DEPTH, 20),
    ],
)
def test_a_sensor_answers_at_its_rate(kind, topic, period):
    sensor = Sensor(kind)
    answered = [tick for tick in range(0, 42, 2) if topic in sensor.tick(tick)]
    assert answered == list(range(0, 42, period))


@pytest.mark.parametrize("stopped", [True, False], ids=["stopped", "without a pose"])
def test_a_missed_capture_loses_its_frame_only(stopped):
    sensor = Sensor(TrackerNode, "sensors.tracker.latency_s=0.08")  # two periods
    frames = {
        tick: sensor.tick(tick, has_pose=tick != 12).get(keys.SKELETONS)
        for tick in range(0, 28, 2)
        if not (stopped and tick == 12)
    }
    stamps = {tick: frame.header.stamp.ns for tick, frame in frames.items() if frame}
    assert (stamps[16], stamps[24]) == (80_000_000, 160_000_000)
    assert frames[20].skeletons == ()  # of the capture at tick 12
    if not stopped:  # the frame in transit arrives
        assert stamps[12] == 40_000_000


def test_lidar_sees_people_and_robots():
    sensor = Sensor(LidarNode, scenario=CONVOY)
    ranges = sensor.tick(0, {"two": (1.5, 0.0), "walker_1": (-2.0, 0.0)})[keys.SCAN].ranges
    # the lidar is 0.13 m behind the robot's middle, legs are 0.15 m from the middle of a person
    assert min(r for r in ranges[:10] if r) == pytest.approx(1.87, abs=0.15)
    assert min(r for r in ranges[350:370] if r) == pytest.approx(1.63, abs=0.15)
    # on the left the lidar of the other robot: at this height, 0.04 m in radius; noise of 0.01 m
    assert min(r for r in ranges[520:550] if r) == pytest.approx(1.96, abs=0.05)
    # without a report a walker stands still; a report without the walker removes them
    assert min(r for r in sensor.tick(10)[keys.SCAN].ranges[:10] if r) < 2.1
    sensor.tick(18, {"two": (1.5, 0.0)})
    ranges = sensor.tick(20)[keys.SCAN].ranges
    assert max(ranges[:10]) == NO_RETURN
    assert min(r for r in ranges[350:370] if r) == pytest.approx(1.63, abs=0.15)


def test_added_box_is_seen_until_removal():
    sensor = Sensor(LidarNode)
    plain = sensor.node.scenario
    crate = {"kind": "box", "size_m": [0.4, 0.4, 0.5], "position_m": [0.0, 1.2]}
    ranges = []
    for tick, settings in ((0, {}), (10, {"world.added.crate": crate}), (20, {})):
        sensor.node.configure(changed(plain, settings))
        ranges.append(np.array(sensor.tick(tick)[keys.SCAN].ranges))
    left = slice(510, 535)  # the lidar is behind the middle
    assert [r[left].max() for r in ranges[::2]] == [NO_RETURN] * 2
    # the face is 1 m to the left of the robot's middle; noise of 0.01 m
    assert ranges[1][left].max() == pytest.approx(1.0, abs=0.05)
    assert min(r for r in ranges[1][350:370] if r) == pytest.approx(
        1.63, abs=0.15
    )  # the person is still there


def test_errors_of_a_person_stay_with_their_id():
    walkers = {"walker_1": (2.5, 0.9), "walker_2": (2.5, -0.9)}

    def without_first_from(tick, leaves):
        return {"walker_2": walkers["walker_2"]} if tick >= leaves else walkers

    leaving, staying, alone = (
        Sensor(TrackerNode).frames(lambda tick, leaves=leaves: without_first_from(tick, leaves))
        for leaves in (20, 1000, 0)
    )
    assert [len(frame) for frame in leaving] == [3] * 5 + [2] * 2
    assert [frame[-1] for frame in leaving] == [frame[-1] for frame in staying]
    # another person does not change the errors of the first
    assert [frame[0] for frame in alone] == [frame[0] for frame in staying]
