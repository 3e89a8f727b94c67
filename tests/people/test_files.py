"""Motion files: what is in them is walked."""

from pathlib import Path

import numpy as np
import pytest
from mecazen.config.people import Body, Straight
from mecazen.errors import ConfigError
from mecazen.skeleton import SIDES
from mecazen_people.body.files import read
from mecazen_people.body.recording import read_recording
from mecazen_people.body.segments import Segments
from mecazen_people.body.walker import Walker
from people.walks import curve_errors, joint, slip, walk

MOCAP = Path(__file__).parents[2].parent / "shared" / "data" / "mocap"
needs_recordings = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no recordings in {MOCAP}")
SEGMENTS = Segments.of(1.75)

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT LeftHip
  {
    OFFSET 1 0 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    JOINT LeftKnee
    {
      OFFSET 0 -4 0 CHANNELS 3 Zrotation Yrotation Xrotation
      End Site { OFFSET 0 -4 0 }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0 9 0 0 0 0   0 0 0   0 0 0
5 9 0 0 90 0   0 0 -90   0 0 90
"""


def write_trc(file, postures, dt):
    """Write the joints of a walk as markers, x forward and y up as OpenSim has them."""
    names = {"hip": "HJC", "knee": "Knee", "ankle": "Ankle", "foot": "Toe", "heel": "Heel"}
    markers = [
        (f"{side[0].upper()}.{m}", f"{side}_{j}") for side in SIDES for j, m in names.items()
    ]
    places = [joint(postures, name)[:, [0, 2, 1]] * [1, 1, -1] for _, name in markers]
    rows = np.concatenate(places, axis=1) * 1000.0
    lines = ["PathFileType\t4", "DataRate", "100", "Frame#\tTime\t"]
    lines[3] += "\t\t\t".join(marker for marker, _ in markers)
    lines += ["\t\tX1\tY1\tZ1", ""]
    for k, row in enumerate(rows):
        lines.append("\t".join([str(k + 1), f"{k * dt:.5f}", *(f"{x:.5f}" for x in row)]))
    file.write_text("\n".join(lines) + "\n")


def test_recorded_walk_of_a_walker_is_that_walk(tmp_path):
    walker, speed = Walker(Body()), 1.1
    write_trc(
        tmp_path / "own.trc",
        walk(walker, Straight(speed_m_s=speed, length_m=100.0), 14.0)[600:],
        0.01,
    )
    gait = read_recording(tmp_path / "own.trc", SEGMENTS)
    # the standing foot's ankle rises and the pelvis turns: 4 % of the speed
    assert gait.speed == pytest.approx(speed, rel=0.04)
    assert gait.offset == pytest.approx(0.5, abs=0.015)
    assert gait.stance_shares == pytest.approx([walker.style.stance_share(0, speed)] * 2, abs=0.04)
    # toe-off is seen a little late, as with markers
    for own, share in zip(gait.curves, gait.stance_shares, strict=True):
        assert 0.52 <= share <= 0.85
        wanted = [walker.style.angles(0, speed, k / 100) for k in range(100)]
        found = [[curve.at(k / 100) for curve in own] for k in range(100)]
        rms = np.degrees(np.sqrt(np.mean(np.subtract(found, wanted) ** 2, axis=0)))
        # the walker's own residuals, up to 1.6 deg, and heel strikes that are seen 20 ms off
        assert (rms < (2.5, 4.5, 3.0)).all(), rms


def test_bvh_is_read_by_its_hierarchy(tmp_path):
    (tmp_path / "two.bvh").write_text(BVH)
    track = read(tmp_path / "two.bvh")
    assert track.rate_hz == pytest.approx(100.0)
    assert sorted(track.values) == ["Hips", "LeftHip", "LeftKnee"]
    assert track.values["LeftKnee"][0] == pytest.approx([1.0, 5.0, 0.0])
    # yaw of 90 deg brings x to -z; the thigh, turned by -90 deg about x, points to z, then to x
    assert track.values["LeftHip"][1] == pytest.approx([5.0, 9.0, -1.0])
    assert track.values["LeftKnee"][1] == pytest.approx([9.0, 9.0, -1.0])


@needs_recordings
@pytest.mark.parametrize(
    ("name", "speed", "period", "most"),
    [
        # a treadmill at 1.1 m/s, stride time 1.217 s; of another height than this person
        ("opensim/subject01_walk1_ik.mot", 1.1, 1.217, 7.5),
        ("opensim/motion_capture_walk.trc", 1.2, 1.14, 14.0),
        ("ktk/walk.c3d", 1.05, 1.11, 4.0),  # 0.89 m/s, on legs of 0.73 instead of 0.86 m
    ],
)
def test_recorded_people_are_walked_along_a_path(name, speed, period, most):
    if name.endswith("c3d"):
        pytest.importorskip("ezc3d")
    walker = Walker(Body(motion_file=MOCAP / name))
    gait = read_recording(MOCAP / name, SEGMENTS)
    assert gait.speed == pytest.approx(speed, rel=0.1)
    assert gait.stride / gait.speed == pytest.approx(period, rel=0.03)
    postures = walk(walker, Straight(speed_m_s=gait.speed, length_m=100.0), 12.0)
    assert slip(postures) < 0.0005
    rms = np.sqrt((curve_errors(walker, postures[600:], gait.speed) ** 2).mean(axis=0))
    # their segments and feet are others, markers are beside the joints, and pelves tilt
    assert rms.max() < most


@needs_recordings
def test_bones_of_a_recorded_bvh_keep_their_lengths():
    values = read(MOCAP / "cmu_131_01_walk.bvh").values
    for a, b in (("LeftHip", "LeftKnee"), ("RightKnee", "RightAnkle"), ("Hips", "LeftHip")):
        assert np.ptp(np.linalg.norm(values[a] - values[b], axis=1)) < 1e-9


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.fbx", "", "must end in one of .bvh, .c3d, .mot, .trc"),
        ("a.bvh", "HIERARCHY ROOT Hips {", "no BVH file .it ends early"),
        ("a.trc", "", "no TRC file .it ends early"),
        ("a.bvh", "nothing", "no BVH file .HIERARCHY must come where 'nothing' is"),
        ("a.bvh", BVH, "has no point for the right hip"),
        ("a.bvh", BVH.replace("Xposition", "Wposition"), "begin with X, Y or Z"),
        ("a.bvh", BVH.replace("OFFSET 0 0 0", "", 1), "one OFFSET"),
        ("a.mot", "time\n", "no MOT file"),
        ("a.mot", "endheader\ntime x\n0 1\n1 2\n", "has no point for the left"),
        ("a.trc", "1\n2\n", "no TRC file"),
    ],
)
def test_bad_file_is_refused_in_one_line(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=told) as error:
        read_recording(tmp_path / name, SEGMENTS)
    assert "\n" not in str(error.value)
    assert name in str(error.value)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"none.trc: can't be read: No such file"):
        read_recording(tmp_path / "none.trc", SEGMENTS)
