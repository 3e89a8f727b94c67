"""Recordings of other programs: bags that rosbags writes, CSV, and ours after a tool changed it."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import ROOT, SCENARIOS, here
from mecazen.loading import load_scenario
from mecazen_recorder.foreign import open_recording
from mecazen_viewer.service import draw
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

ROS = get_typestore(Stores.ROS2_JAZZY)
UNIX_NS = 1_760_000_000 * 10**9
JOINTS = ("front_left", "front_right", "rear_left", "rear_right")
DELAY_NS = 2 * 10**6
"""Time from a stamp of the robot to its reception; the tracker's are received at once."""
TOPICS = "joint_states=/robot/joint_states,ground_truth/odom=/mocap/pose,target/odom=/vicon/subject"
KINDS = {
    "/robot/joint_states": "sensor_msgs/msg/JointState",
    "/mocap/pose": "geometry_msgs/msg/PoseStamped",
    "/vicon/subject": "geometry_msgs/msg/TransformStamped",
    "/tf": "tf2_msgs/msg/TFMessage",
}


def make(kind: str, /, **fields: object) -> Any:
    return ROS.types[kind](**fields)


def header(time_ns: int) -> Any:
    stamp = make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id="mocap")


LEVEL = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)


def transform(time_ns: int, x: float, child: str) -> Any:
    place = make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=1.0)
    motion = make("geometry_msgs/msg/Transform", translation=place, rotation=LEVEL)
    fields = {"header": header(time_ns), "child_frame_id": child, "transform": motion}
    return make(KINDS["/vicon/subject"], **fields)


def messages(time_s: float) -> dict[str, Any]:
    """Return the messages of a robot that drives at 0.5 m/s, 1 m behind a person.

    The clock of the tracker of the person is 1000 s late.
    """
    now_ns, x = UNIX_NS + round(time_s * 1e9), 0.5 * time_s
    joints = {
        "name": [f"{wheel}_wheel_joint" for wheel in JOINTS],
        "position": np.full(4, x / 0.05),
        "velocity": np.full(4, 10.0),
        "effort": np.full(4, np.nan),
    }
    place = make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.1)
    pose = make("geometry_msgs/msg/Pose", position=place, orientation=LEVEL)
    both = [transform(now_ns, x, "robot"), transform(now_ns, x + 1.0, "person")]
    late_ns = now_ns - 1000 * 10**9
    return {
        "/robot/joint_states": make(KINDS["/robot/joint_states"], header=header(now_ns), **joints),
        "/mocap/pose": make(KINDS["/mocap/pose"], header=header(now_ns), pose=pose),
        "/vicon/subject": transform(late_ns, x + 1.0 + 0.5 * DELAY_NS / 1e9, "person"),
        "/tf": make(KINDS["/tf"], transforms=both),
    }


@pytest.fixture(scope="module")
def bag(request, tmp_path_factory) -> Path:
    """Write 4 s of a robot behind a person by rosbags; return the folder."""
    path = tmp_path_factory.mktemp("bag") / "drive"
    storage = getattr(request, "param", StoragePlugin.MCAP)
    with BagWriter(path, version=9, storage_plugin=storage) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=ROS)
            for topic, kind in KINDS.items()
        }
        for step in range(400):
            time_ns = UNIX_NS + step * 10**7 + DELAY_NS
            for topic, message in messages(0.01 * step).items():
                payload = ROS.serialize_cdr(message, KINDS[topic])
                writer.write(connections[topic], time_ns, payload)
    return path


def run(*arguments: object) -> str:
    """Run a command that succeeds; return what it prints."""
    done = here(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def refused(*arguments: object) -> str:
    """Return the line of a command that fails."""
    (line,) = here(*arguments).stderr.splitlines()
    return line


@pytest.mark.parametrize(
    "bag", [StoragePlugin.MCAP, StoragePlugin.SQLITE3], indirect=True, ids=["mcap", "db3"]
)
def test_bags_have_contents_scores_and_poses(bag, tmp_path):
    (file,) = (path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))
    assert "robot/joint_states" in run("info", bag)
    shown = run("info", file, "--topics", TOPICS)
    assert "ground_truth/odom" in shown
    assert "run 1, seed 0: 0 to 3.99" in shown
    back = ("--topics", TOPICS, "--scenario", "back")
    standoff = load_scenario(SCENARIOS / "back.toml").follower.standoff_m
    (score,) = json.loads(run("score", file, *back, "--json")).values()
    assert score["d_err_m"] == pytest.approx(abs(1.0 - standoff), abs=1e-6)
    for reference in ("ground_truth/odom=/mocap/pose", "ground_truth/odom=/tf:robot"):
        samples = open_recording(bag, reference).samples()
        poses = [s.message(s.kind) for s in samples if s.key == "ground_truth/odom"]
        assert len(poses) == 400
        assert poses[0].header.stamp.ns == 0
        assert poses[200].pose.pose.position.x == pytest.approx(1.0)
        assert poses[200].twist.twist.linear.x == pytest.approx(0.5)
    drive = drives(bag, TOPICS)
    assert drive.wheels[-1] == pytest.approx(np.full(4, 0.5 * 3.99 / 0.05))
    assert drive.poses[-1] == pytest.approx([0.5 * 3.99, 0.0, 0.0])


def test_the_commands_of_the_document_run(bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive").symlink_to(bag)
    rows = (f"{0.01 * n:.2f},{n},0,0,{n + 100},0,0\n" for n in range(50))
    names = "t,x_cm,y_cm,yaw_deg,target_x_cm,target_y_cm,target_yaw_deg\n"
    (tmp_path / "drive.csv").write_text(names + "".join(rows))
    section = (ROOT / "docs" / "recording.md").read_text().partition("## Your recordings\n")[2]
    lines = section.partition("```sh\n")[2].partition("```")[0].splitlines()
    assert len(lines) == 6
    for line in lines:
        words = shlex.split(line, comments=True)[1:]
        if words[0] == "view":  # it shows until Ctrl-C
            assert draw(open_recording(Path(words[1]), words[-1], words[3]), tmp_path)
        elif words[0] == "identify":  # straight ahead shows no parameter
            drives(Path(words[1]), words[-1])
        else:
            done = here(*words, folder=tmp_path)
            assert done.returncode == 0, done.stderr


def drives(path: Path, topics: str) -> Any:
    """Return the only run that `mecazen identify` reads."""
    from mecazen_experiments.identify import data

    (drive,), _ = data.read([path], topics)
    return drive


CSV = "{time},x_m,y_cm,yaw_deg,target_x_m,target_y_m,target_yaw_rad\n{rows}"


@pytest.mark.parametrize(
    ("time", "first", "step"),
    [("t", 1.76e9, 0.01), ("timestamp", 1.76e18, 1e7), ("stamp_us", 7.0, 1e4)],
)
def test_times_in_csv_have_any_unit_and_epoch(time, first, step, tmp_path):
    file = tmp_path / "drive.csv"
    rows = [f"{first + n * step!r},{0.005 * n},1,90,{0.005 * n},1.01,1.5708\n" for n in range(100)]
    file.write_text(CSV.format(time=time, rows="".join(rows)))
    (score,) = json.loads(run("score", file, "--scenario", "back", "--json")).values()
    assert score["d_err_m"] == pytest.approx(0.0, abs=1e-4)
    (shown,) = json.loads(run("info", file, "--json"))["runs"]
    assert shown["end_s"] - shown["begin_s"] == pytest.approx(0.99, abs=1e-6)


def test_what_is_missing_is_one_line(bag, tmp_path):
    for command, line in (
        ("score BAG", "without the configuration of run 1; --scenario NAME says which scenario"),
        ("score BAG --scenario back", "nothing on ground_truth/odom in run 1; --topics ground_tr"),
        ("identify BAG", "no joint_states; --topics joint_states=TOPIC takes it from /robot/join"),
        ("gait BAG", "no body in run 0; runs with one: none; no topic has its type"),
        ("replay BAG --through follower", "holds no run with its configuration; --scenario NAME"),
        ("view BAG", "without the configuration of run 1"),
        ("info BAG --topics odm=/odom", "no such key; did you mean odom?"),
        ("info BAG --topics odom", "must be KEY=TOPIC"),
        ("info BAG --topics odom=/robot/joint_states", "is a sensor_msgs/msg/JointState; odom"),
        ("info BAG --topics odom=/tf", "holds the frames robot, person; KEY=TOPIC:FRAME chooses"),
        ("info none.csv", "can't be read: No such file"),
    ):
        words = [str(bag) if word == "BAG" else word for word in command.split()]
        assert line in refused(*words)
    file = tmp_path / "drive.csv"
    for text, line in (
        ("t,x\n0,1\n1,1\n", "column x has no unit: name it x_m or x_cm or x_mm"),
        ("a,x_m\n0,1\n", "no column time_s (ms, us, ns); it has a, x_m"),
        ("t,x_m\n0\n", "Line #2 (got 1 columns instead of 2)"),
        ("t,x_m\n0,1\n0,1\n", "t must increase, but not in row 3"),
        ("t,x_m\n0,1\n1,1\n", "nothing known in t, x_m; needs columns robot_x_m"),
    ):
        file.write_text(text)
        assert line in refused("score", file, "--scenario", "back")
