"""Whole runs, recorded in one process and as processes, recomputed, and read by other programs."""

import json
import tomllib
from collections import Counter, defaultdict
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from harness import assert_one_line, here, options
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mecazen import keys
from mecazen.arrays import chain, turn
from mecazen.config import SensorConfig
from mecazen.graph import rows
from mecazen.messages import Odometry
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools.recorded import trajectory_of

HARD = (
    "sensor.dropout_probability=0.2",
    "sensor.latency_s=0.04",
    "target.gait.step_length_m=0.3",
    "target.path.start_after_s=0.5",
)
NODES = ("odometry", "controller", "target", "follower")
EVERY_TICK = {t.key for row in rows(SensorConfig().features) for t in row.outputs} - {
    keys.OBSERVATION.key,
    keys.PEOPLE.key,  # of a crowd
    keys.PARAMETERS.key,  # nothing is changed
}


def simulate(scenario: str, duration_s: float, *more: object) -> str:
    """Simulate from the command line; return the hash of the trajectory."""
    how = ("--duration", duration_s, "--seed", 5, "--json", *options(HARD))
    done = here("simulate", scenario, *how, *more)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["trajectory_sha256"]


def counts(recording: Recording) -> Counter[str]:
    return Counter(sample.key for sample in recording.samples())


def test_a_recorded_run_is_whole_and_computed_anew(tmp_path):
    path = tmp_path / "run.mcap"
    simulate("side", 4, "--record", path)
    recording = Recording(path)
    numbers = counts(recording)
    assert {key: numbers[key] for key in EVERY_TICK} == dict.fromkeys(EVERY_TICK, 400)
    assert numbers["target/observation"] == 100
    assert not recording.is_cut_off
    for node in NODES:
        compared = recompute(recording, node)
        assert compared.difference is None
        assert set(compared.counts.values()) <= {400, 100}
    (text,) = recording.scenarios.values()
    assert tomllib.loads(text)["follower"]["view"] == "side_left"
    same = here("replay", path, "--through", "follower")
    assert (same.returncode, same.stderr) == (0, "")
    assert "identical: 400 of cmd_vel, 400 of follower/state" in same.stdout
    changed = here("replay", path, "--through", "examples/new/my_follower.py:MyFollower")
    assert_one_line(changed, 1, "cmd_vel", "recorded")
    assert_one_line(here("replay", path, "--through", "physics"), 2)


CLOSE = (
    "target.path.speed_m_s=0.4",
    # the second robot starts beside the first, and its person walks across the other's way
    "robots.two.target.path={kind='straight', y_m=-0.6, yaw_deg=60.0, start_after_s=0.2}",
    "robots.two.start={x_m=-1.0, y_m=-0.6}",
    "sensor.kind=fused",
    'crowd.walkers=[{ path = { kind = "goal", x_m = 2.0, goal_m = [-2.0, 0.5] } }]',
)
"""Robots come near each other, among a crowd."""


@pytest.fixture(scope="module")
def convoy(tmp_path_factory):
    """Record robots near each other as processes; return the file and the trajectory's hash."""
    path = tmp_path_factory.mktemp("convoy") / "run.mcap"
    return path, simulate("convoy", 2, "--record", path, "--distributed", *options(CLOSE))


def test_processes_of_robots_in_a_crowd_are_recorded_whole_and_computed_anew(convoy):
    path, sha256 = convoy
    assert simulate("convoy", 2, *options(CLOSE)) == sha256
    recording = Recording(path)
    recorded = trajectory_of(recording)
    assert recorded.sha256() == sha256
    numbers = counts(recording)
    assert numbers["people"] == 100
    for node, robot in (("crowd", ""), ("lidar", "two"), ("tracker", "one")):
        compared = recompute(recording, node, robot)
        assert compared.difference is None
        assert set(compared.counts.values()) <= {100, 50, 20}
    for robot in ("one", "two"):
        assert {numbers[f"{robot}/{key}"] for key in EVERY_TICK} == {200}
        for node in NODES:
            assert recompute(recording, node, robot).difference is None
    assert recording.descriptions().keys() == {"one", "two"}
    anew = "replay", path, "--through", "follower"
    same = here(*anew, "--robot", "two")
    assert "identical: 200 of two/cmd_vel, 200 of two/follower/state" in same.stdout
    assert_one_line(here(*anew), 2, "--robot takes one or two")


def frames_of(path):
    """Return the messages of topics for readers of ROS bags, by topic."""
    with path.open("rb") as file:
        decoded = defaultdict(list)
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            if channel.topic.startswith("/"):
                decoded[channel.topic].append(message)
    return decoded


def test_the_frames_place_each_robot_as_it_moved(convoy):
    (path, _), prefixes = convoy, ("one/", "two/")
    decoded = frames_of(path)
    samples = list(Recording(path).samples())
    assert {topic for topic in decoded if "robot" in topic} == {
        f"/{prefix}robot_description" for prefix in prefixes
    }
    frames = {}  # the newest of each child
    for message in (*decoded["/tf_static"], *decoded["/tf"]):
        frames |= {frame.child_frame_id: frame for frame in message.transforms}
    for prefix in prefixes:
        (text,) = (message.data for message in decoded[f"/{prefix}robot_description"])
        urdf = ET.fromstring(text)  # noqa: S314 - our own
        links = {link.get("name") for link in urdf.iterfind("link")}
        assert links - {f"{prefix}base_link"} <= frames.keys()  # else readers leave links out
        assert not urdf.findall(".//mesh")  # a recording needs no other file

        place, rotation = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        name = f"{prefix}base_link"
        while name != "world":
            transform = frames[name].transform
            moved, turned = (
                np.array([getattr(part, axis) for axis in axes])
                for part, axes in ((transform.translation, "xyz"), (transform.rotation, "xyzw"))
            )
            place, rotation = moved + turn(turned, place), chain(turned, rotation)
            name = frames[name].header.frame_id
        last = {s.key: s for s in samples}
        truth = last[f"{prefix}ground_truth/odom"].message(Odometry).pose.pose
        assert place == pytest.approx([truth.position.x, truth.position.y, truth.position.z])
        assert rotation == pytest.approx([getattr(truth.orientation, axis) for axis in "xyzw"])
