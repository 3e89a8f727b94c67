"""Files for gait laboratories, read by the project itself and by the laboratories' programs."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from experiments.walks import person
from mecazen.config.people import Body
from mecazen.skeleton import JOINTS
from mecazen_experiments.capture import angles
from mecazen_experiments.gait.events import planted
from mecazen_experiments.gait.formats import MARKERS, c3d, marker, mot, trc, y_up
from mecazen_people.body.files import read

MISSING = 3


@pytest.fixture(scope="module")
def walk():
    """A walk in which one frame has no body."""
    t, joints, _ = person(1.0, duration_s=6.0, rate_hz=50.0)
    events = planted(t, joints)
    gap = joints.copy()
    gap[MISSING] = np.nan
    return t, gap, joints, events


def test_joints_have_the_names_of_pose2sim():
    assert [marker(joint) for joint in ("pelvis", "left_hip", "right_heel", "left_foot")] == [
        *("Hip", "LHip", "RHeel", "LBall")
    ]
    assert len(set(MARKERS)) == len(JOINTS)


def test_z_becomes_y_and_the_left_becomes_the_far_side():
    assert y_up(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, 3.0, -2.0]


def test_a_trc_file_has_the_lines_that_opensim_checks(walk):
    t, gap, joints, _ = walk
    lines = trc("walk.trc", t, gap).decode().split("\n")
    assert lines[0] == "PathFileType\t4\t(X/Y/Z)\twalk.trc"
    assert lines[2].split("\t") == [
        "50.00",
        "50.00",
        str(len(t)),
        "20",
        "m",
        "50.00",
        "1",
        str(len(t)),
    ]
    assert lines[3].split("\t")[2:9] == ["Hip", "", "", "Spine", "", "", "Neck"]
    assert lines[4].split("\t")[:5] == ["", "", "X1", "Y1", "Z1"]
    assert lines[5] == ""
    row = lines[6].split("\t")
    assert row[0] == "1"
    assert list(map(float, row[2:5])) == pytest.approx(y_up(joints[0, 0]), abs=1e-6)
    assert set(lines[6 + MISSING].split("\t")[2:]) == {"nan"}


def test_our_own_readers_read_what_is_written(walk, tmp_path):
    t, gap, joints, events = walk
    file = tmp_path / "walk.mot"
    file.write_bytes(mot(t, joints, angles(joints)))
    assert read(file) is not None
    if importlib.util.find_spec("ezc3d") is None:
        pytest.skip("pip install ezc3d")
    file = tmp_path / "walk.c3d"
    file.write_bytes(c3d(t, gap, events))
    motion = read(file)
    assert motion.rate_hz == pytest.approx(50.0)
    for n, name in enumerate(MARKERS):
        # floats of 32 bits hold 5 m in steps of 0.5 µm
        assert motion.values[name] / 1e3 == pytest.approx(gap[:, n], abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("suffix", ["trc", "mot", "c3d"])
def test_a_person_walks_a_walk_that_was_exported(walk, suffix, tmp_path):
    """Tables of strides and curves (CSV) and summaries have no reader: they are no motion."""
    if suffix == "c3d" and importlib.util.find_spec("ezc3d") is None:
        pytest.skip("pip install ezc3d")
    t, gap, joints, events = walk
    file = tmp_path / f"walk.{suffix}"
    contents = {
        "trc": lambda: trc(file.name, t, gap),
        "mot": lambda: mot(t, joints, angles(joints)),
        "c3d": lambda: c3d(t, gap, events),
    }
    file.write_bytes(contents[suffix]())
    _, again, _ = person(1.0, duration_s=6.0, rate_hz=50.0, body=Body(motion_file=file))
    for name in ("head", "pelvis", "left_knee"):
        heights = [places[:, JOINTS.index(name), 2] for places in (joints, again)]
        assert heights[1].mean() == pytest.approx(heights[0].mean(), abs=0.01)
        assert heights[1].max() == pytest.approx(heights[0].max(), abs=0.01)


def test_a_pelvis_that_faces_left_is_turned_by_90_deg():
    joints = np.zeros((1, len(JOINTS), 3))
    joints[0, JOINTS.index("spine"), 2] = 0.3
    # who faces +y has the left hip at -x
    joints[0, JOINTS.index("left_hip"), 0] = -0.1
    joints[0, JOINTS.index("right_hip"), 0] = 0.1
    last = mot(np.zeros(1), joints, np.zeros((1, 6))).decode().splitlines()[-1].split("\t")
    _, _, _, _, tilt, lean, turn, *_ = map(float, last)
    # in the order of OpenSim, tilt and list are about the ground's axes
    assert (abs(tilt), abs(lean), turn) == pytest.approx((0.0, 10.0, 90.0), abs=1e-4)


READ_BACK = """
import sys
import numpy as np
folder = sys.argv[1]
joints = np.load(folder + "/joints.npy")
angles = np.load(folder + "/angles.npy")
names = sys.argv[3].split()
if sys.argv[2] == "ezc3d":
    import ezc3d
    c3d = ezc3d.c3d(folder + "/walk.c3d")
    assert c3d["parameters"]["POINT"]["LABELS"]["value"] == names
    assert c3d["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    points = c3d["data"]["points"][:3].transpose(2, 1, 0) / 1e3
    np.testing.assert_allclose(points, joints, atol=1e-5, rtol=0)
    events = c3d["parameters"]["EVENT"]
    labels, sides = events["LABELS"]["value"], events["CONTEXTS"]["value"]
    assert set(zip(sides, labels)) == {
        (side, label) for side in ("Left", "Right") for label in ("Foot Strike", "Foot Off")
    }
    times = np.load(folder + "/times.npy")
    np.testing.assert_allclose(events["TIMES"]["value"][1], times, atol=1e-5)
else:
    import opensim
    table = opensim.TimeSeriesTableVec3(folder + "/walk.trc")
    assert list(table.getColumnLabels()) == names
    assert opensim.MarkerData(folder + "/walk.trc").getUnits().getLabel() == "meters"
    for n, name in enumerate(names):
        column = table.getDependentColumn(name)
        read = [[column[i][k] for k in range(3)] for i in range(column.size())]
        x, y, z = joints[:, n].T
        np.testing.assert_allclose(read, np.stack((x, z, -y), axis=1), atol=1e-5, rtol=0)
    table = opensim.TimeSeriesTable(folder + "/walk.mot")
    coordinates = "hip_flexion", "knee_angle", "ankle_angle"
    sides = [f"{name}_{side}" for side in "lr" for name in coordinates]
    for column, name in zip(angles.T, sides):
        np.testing.assert_allclose(
            table.getDependentColumn(name).to_numpy(), column, atol=1e-5, rtol=0
        )
"""


@pytest.mark.parametrize("program", ["ezc3d", "opensim"])
def test_programs_of_laboratories_read_every_joint_by_its_name(walk, tmp_path, program):
    """In a process of its own: the programs' modules warn when they are imported."""
    found = subprocess.run(
        [sys.executable, "-c", f"import {program}"], capture_output=True, check=False
    )
    if found.returncode:
        pytest.skip(f"pip install {program}")
    t, gap, joints, events = walk
    (tmp_path / "walk.trc").write_bytes(trc("walk.trc", t, gap))
    (tmp_path / "walk.c3d").write_bytes(c3d(t, gap, events))
    (tmp_path / "walk.mot").write_bytes(mot(t, joints, angles(joints)))
    np.save(tmp_path / "joints.npy", gap)
    np.save(tmp_path / "angles.npy", angles(joints))
    times = np.sort(np.concatenate([*events.strikes, *events.offs])) - t[0]
    assert times.max() < 60.0
    np.save(tmp_path / "times.npy", times)
    arguments = [sys.executable, "-c", READ_BACK, str(tmp_path), program, " ".join(MARKERS)]
    read = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert read.returncode == 0, read.stderr


def test_an_event_after_a_minute_has_minutes_and_seconds(walk):
    t, _, joints, events = walk
    late = events._replace(strikes=tuple(one + 60.0 for one in events.strikes))
    first = min(float(one[0]) for one in events.strikes) - float(t[0])
    assert np.array([1.0, first], "<f4").tobytes() in c3d(t, joints, late)
