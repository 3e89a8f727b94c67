"""What sensors say is refused where it is implausible, and is the same in every process."""

import subprocess
import sys
from pathlib import Path

import pytest
from mecazen.limits import refuse_implausible
from mecazen.messages import Point, Skeleton, Skeletons
from mecazen.wire import RefusedError

SAID = """
import sys
sys.path[:0] = [{tests!r}]
from mecazen.geometry import Pose2D
from mecazen.messages import Time
from mecazen.wire import encode
from mecazen.config import WorldConfig
from mecazen.config.world import Box
from mecazen.config.sensors import DepthConfig, LidarConfig, TrackerConfig
from mecazen_sensors.depth import DepthCamera
from mecazen_sensors.lidar import Lidar
from mecazen_sensors.scene import Scene
from mecazen_sensors.tracker import Tracker
from people import HEIGHT, NEXUS, walking
import hashlib

scene = Scene(WorldConfig(obstacles=(Box(size_m=(1, 2, 1), position_m=(3, 1)),)), [NEXUS])
lidar = Lidar(LidarConfig(), NEXUS.lidar, 1)
tracker = Tracker(TrackerConfig(latency_s=0.0), NEXUS.camera, 2, 0.01)
camera = DepthCamera(DepthConfig(width=64, height=48), NEXUS.camera, 3)
said = hashlib.sha256()
for tick in range(0, 80, 4):
    robot, joints = Pose2D(0.01 * tick, 0.0, 0.002 * tick), walking(0.01 * tick, (2.5, 0.0, 0.5))
    scene.place_robot(0, robot)
    scene.place_person(0, joints, HEIGHT)
    said.update(encode(lidar.scan(scene, robot, Time()), "json"))
    said.update(encode(tracker.observe(tick, scene, robot, [joints]), "json"))
    said.update(encode(camera.picture(scene, robot, Time()), "json"))
print(said.hexdigest())
"""


def test_two_processes_say_the_same_to_the_bit():
    program = SAID.format(tests=str(Path(__file__).parents[1]))
    one, other = (
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert len(one.stdout.strip()) == 64
    assert one.stdout == other.stdout


@pytest.mark.parametrize(
    ("skeleton", "message"),
    [
        (Skeleton(joints=(Point(), Point(y=-2e6))), "joint position -2000000.0 is out of range"),
        (Skeleton(std=(0.01, 1e200)), r"deviation of a joint 1e\+200 is out of range"),
    ],
)
def test_a_joint_beyond_the_world_is_refused(skeleton, message):
    for said in (skeleton, Skeletons(skeletons=(Skeleton(), skeleton))):
        with pytest.raises(RefusedError, match=message):
            refuse_implausible("body", said)
    refuse_implausible("body", Skeletons(skeletons=(Skeleton(joints=(Point(x=3.0),)),)))
