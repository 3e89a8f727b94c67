"""A recording shows its robots to readers of ROS bags: /robot_description, /tf and /tf_static."""

import math
from collections import defaultdict
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mecazen import Simulation
from mecazen.arrays import chain, turn
from mecazen.messages import JointState, Odometry
from mecazen_recorder.reader import Recording


def frames_of(path):
    """Return the messages of topics for readers of ROS bags, by topic."""
    with path.open("rb") as file:
        decoded = defaultdict(list)
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            if channel.topic.startswith("/"):
                decoded[channel.topic].append(message)
    return decoded


def test_the_frames_place_each_robot_as_it_moved(tmp_path):
    path, prefixes = tmp_path / "run.mcap", ("one/", "two/")
    with Simulation("convoy", duration_s=0.5, record=path) as sim:
        sim.run()
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

        wheel = frames[f"{prefix}front_left_wheel"]
        angle = 2.0 * math.atan2(wheel.transform.rotation.y, wheel.transform.rotation.w)
        stamp = wheel.header.stamp.sec * 10**9 + wheel.header.stamp.nanosec
        (states,) = (
            s.message(JointState)
            for s in samples
            if s.key == f"{prefix}joint_states" and s.time_ns == stamp
        )
        position = states.position[states.name.index("front_left_wheel_joint")]
        assert math.remainder(angle - position, math.tau) == pytest.approx(0.0, abs=1e-9)
