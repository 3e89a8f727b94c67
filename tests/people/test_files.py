"""Motion files: a body walks their recorded cycle."""

import random
import struct
from contextlib import suppress
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

ROW = "0 1 1 1 1 1 1 1\n"
MOT = f"""endheader
time pelvis_tilt hip_flexion_l knee_angle_l ankle_angle_l hip_flexion_r knee_angle_r ankle_angle_r
{ROW}"""


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


def write_mot(file, angles, dt=0.01):
    """Write hip, knee and ankle of the left and of the right leg (n, 6) [deg]."""
    rows = [
        " ".join(f"{x:.5f}" for x in (k * dt, 0.0, hl - 10.0, kl, al, hr - 10.0, kr, ar))
        for k, (hl, kl, al, hr, kr, ar) in enumerate(angles)
    ]
    file.write_text("\n".join(["inDegrees=yes", *MOT.splitlines()[:2], *rows]))


def steps_of(speed, period, seconds):
    """The angles (n, 6) [deg] of a healthy walk, 100 in a second."""
    style = Walker(Body()).style
    phases = np.arange(0.0, seconds, 0.01) / period
    sides = [[style.angles(side, speed, (p + 0.5 * side) % 1.0) for p in phases] for side in (0, 1)]
    return np.degrees(np.concatenate(sides, axis=1))


def test_a_pause_and_a_kick_before_a_recorded_walk_do_not_change_it(tmp_path):
    steps = steps_of(1.1, 1.2, 12.0)
    before = np.tile([10.0, 5.0, 0.0, 10.0, 5.0, 0.0], (400, 1))
    before[100:160, 3] += 90.0 * np.sin(np.linspace(0.0, np.pi, 60))  # the right leg's
    write_mot(tmp_path / "walk.mot", steps)
    write_mot(tmp_path / "kick.mot", np.concatenate([before, steps]))
    walked, kicked = (read_recording(tmp_path / f"{n}.mot", SEGMENTS) for n in ("walk", "kick"))
    # the foot is level in the mean of all frames, those of the pause included
    assert kicked.speed == pytest.approx(walked.speed, rel=0.02)
    assert kicked.stride / kicked.speed == pytest.approx(1.2, rel=0.01)
    assert kicked.offset == pytest.approx(0.5, abs=0.01)
    assert kicked.stance_shares == pytest.approx(walked.stance_shares, abs=0.02)


def test_a_recorded_slow_march_is_walked_at_any_speed(tmp_path):
    lift = np.sin(np.arange(0.0, 30.0, 0.01) / 4.0 * np.pi)  # a stride in 8 s
    leg = np.stack([40 + 40 * lift, 50 + 45 * lift, 5 - 40 * lift])
    write_mot(tmp_path / "march.mot", np.concatenate([leg, np.roll(leg, 400, axis=1)]).T)
    walker = Walker(Body(motion_file=tmp_path / "march.mot"))
    for speed in (0.1, 0.7, 2.0):
        curves = np.degrees([walker.style.angles(0, speed, k / 100) for k in range(100)])
        assert (np.ptp(curves, axis=0) < (85.0, 95.0, 85.0)).all()  # no more than it was
        postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 6.0)
        assert slip(postures) < 0.0005


def write_c3d(file, points, *, scale=-1.0):
    """Write points (frames, n, 4), of which the last numbers are residuals, labelled L0, L1."""
    frames, n, _ = points.shape

    def parameter(name, code, sizes, data):
        body = struct.pack("<bB", code, len(sizes)) + bytes(sizes) + data
        return struct.pack("<bb", len(name), 1) + name + struct.pack("<H", 2 + len(body)) + body

    section = (
        bytes([0, 0, 1, 84]) + struct.pack("<bb", -5, -1) + b"POINT" + struct.pack("<H", 3) + b"\0"
    )
    section += parameter(b"RATE", 4, (), struct.pack("<f", 100.0))
    section += parameter(b"SCALE", 4, (), struct.pack("<f", scale))
    section += parameter(b"FRAMES", 2, (), struct.pack("<H", frames))
    section += parameter(b"DATA_START", 2, (), struct.pack("<H", 3))
    section += parameter(b"LABELS", -1, (4, n), b"".join(b"L%-3d" % i for i in range(n))) + b"\0\0"
    kind = "<f4" if scale < 0.0 else "<i2"
    values = np.concatenate(
        [points.reshape(frames, -1), np.full((frames, 3), 7.0)], axis=1
    )  # analog
    head = struct.pack("<BBHH", 2, 0x50, n, 3)
    file.write_bytes(
        head.ljust(512, b"\0") + section.ljust(512, b"\0") + values.astype(kind).tobytes()
    )


@pytest.mark.parametrize("scale", [-1.0, 0.5])
def test_c3d_is_read_with_its_hidden_points(tmp_path, scale):
    points = np.arange(5 * 2 * 4, dtype=float).reshape(5, 2, 4)
    points[3, 1, 3] = -1.0
    write_c3d(tmp_path / "a.c3d", points, scale=scale)
    track = read(tmp_path / "a.c3d")
    assert (track.rate_hz, list(track.values)) == (100.0, ["L0", "L1"])
    expected = points[..., :3] * abs(scale)
    expected[3, 1] = np.nan
    for i in (0, 1):
        np.testing.assert_array_equal(track.values[f"L{i}"], expected[:, i])


def test_a_damaged_c3d_is_refused_in_one_line(tmp_path):
    write_c3d(tmp_path / "a.c3d", np.ones((50, 3, 4)))
    data, chance = (tmp_path / "a.c3d").read_bytes(), random.Random(1)
    for _ in range(500):
        damaged = bytearray(data[: chance.choice([20, 515, 700, len(data) - 1, len(data)])])
        for _ in range(chance.choice([1, 5, 50])):
            damaged[chance.randrange(min(len(damaged), 700))] = chance.randrange(256)
        (tmp_path / "b.c3d").write_bytes(damaged)
        with suppress(ConfigError):
            read(tmp_path / "b.c3d")


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


NAMINGS = {
    "Plug-in Gait": "LFEP LFEO LTIO LTOO",
    "markers of Plug-in Gait": "LHJC LKNE LANK LTOE",
    "Pose2Sim, OpenCap": "LHip LKnee LAnkle LBigToe",
    "OpenCap, augmented": "LHJC_study L_knee_study L_ankle_study L_toe_study",
    "OpenSim": "L.HJC L.Knee L.Ankle L.Toe",
    "a subject's prefix": "Sub01:LHip Sub01:LKNE Sub01:LANK Sub01:LTOE",
}


def renamed(text, names):
    """Return a TRC file with the names of a left leg, and of the right leg accordingly."""
    for name, own in zip(names.split(), ("HJC", "Knee", "Ankle", "Toe"), strict=True):
        text = text.replace(f"L.{own}", name)
        right = name.replace("L", "R", 1)
        text = text.replace(f"R.{own}", right.replace("R_", "r_"))  # OpenCap has r_knee, L_knee
    return text


def test_names_of_all_systems_and_each_vertical_axis_give_one_gait(tmp_path):
    file = tmp_path / "own.trc"
    postures = walk(Walker(Body()), Straight(speed_m_s=1.1, length_m=100.0), 8.0)[400:]
    write_trc(file, postures, 0.01)
    text, gait = file.read_text(), read_recording(file, SEGMENTS)
    for names in NAMINGS.values():
        file.write_text(renamed(text, names))
        assert read_recording(file, SEGMENTS).speed == gait.speed, names
    *head, body = text.partition("\n\n")
    rows = [line.split("\t") for line in body.splitlines()]
    for axes in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):  # y up, as in OpenSim, then z up, then x up
        turned = [
            [*row[:2], *(row[2 + 3 * (i // 3) + axes[i % 3]] for i in range(len(row) - 2))]
            for row in rows
        ]
        file.write_text("".join(head) + "\n".join("\t".join(row) for row in turned))
        assert read_recording(file, SEGMENTS).speed == pytest.approx(gait.speed, rel=1e-12), axes

    def refused(change):
        lines = [
            [*row[:2], *(f"{x:.5f}" for x in change(np.array(row[2:], float).reshape(-1, 3)).flat)]
            for row in rows
        ]
        file.write_text("".join(head) + "\n".join("\t".join(line) for line in lines))
        with pytest.raises(ConfigError) as error:
            read_recording(file, SEGMENTS)
        return str(error.value)

    assert "must have x, y or z point up; its hips are [" in refused(lambda p: -p)
    lean = np.array([[1, 0, 0], [0, 1, 1], [0, -1, 1]]) / [[1.0], [np.sqrt(2)], [np.sqrt(2)]]
    assert "must have x, y or z point up; its hips are [" in refused(lambda p: p @ lean)
    assert "left and right are swapped, or an axis is mirrored" in refused(lambda p: p * [1, 1, -1])
    assert "must have all markers in some frames" in refused(
        lambda p: p + np.where(np.arange(len(p)) == 3, np.nan, 0.0)[:, None]  # a toe is hidden
    )
    file.write_text(text.replace("R.Heel", "B:L.Heel"))
    with pytest.raises(ConfigError, match=r"two points like 'L\.Heel'; export a single person"):
        read_recording(file, SEGMENTS)


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
        ("a.bvh", BVH[:-30], "2 frames of 12 channels are 24 numbers, not 1[0-9]"),
        ("a.bvh", f"{BVH} 1", "2 frames of 12 channels are 24 numbers, not more"),
        ("a.bvh", BVH.replace("Frames: 2", "Frames: 1000000000"), "1000000000 frames; allowed"),
        ("a.bvh", BVH.replace("Frames: 2", "Frames: -1"), "-1 frames; allowed"),
        ("a.bvh", BVH.replace("Time: 0.01", "Time: 0"), "no BVH file .float division by zero"),
        ("a.bvh", BVH.replace("0 9 0 0", "0 9e307 0 1e400"), "from -1e.09 to 1e.09"),
        ("a.bvh", f"HIERARCHY {'JOINT a { OFFSET 0 0 0 ' * 200_000}", "more than 1000 joints"),
        ("a.mot", f"{MOT}0.02 1 1\n", "a row has 3 instead of 8 numbers"),
        ("a.mot", f"{MOT}{ROW}", "its times must increase"),
        (
            "a.mot",
            f"{MOT}.02{ROW[1:]}".replace("knee_angle_r", "x"),
            "has no point for the left hip",
        ),
        (
            "a.mot",
            f"{MOT}.02{ROW[1:]}".replace("hip_flexion_l", "LHJC"),
            "has no point for the left hip",
        ),
        ("a.c3d", "", "no C3D file .it ends early"),
        ("a.c3d", "\x02\x50" + "\0" * 1000, "Intel"),
        ("a.bvh", BVH.replace("Xposition", "Wposition"), "begin with X, Y or Z"),
        ("a.bvh", BVH.replace("OFFSET 0 0 0", "", 1), "one OFFSET"),
        ("a.mot", "time\n", "no MOT file"),
        ("a.mot", "endheader\ntime x\n0 1\n.1 2\n", "has no point for the left"),
        ("a.trc", "1\n2\n", "no TRC file"),
    ],
)
def test_bad_file_is_refused_in_one_line(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=told) as error:
        read_recording(tmp_path / name, SEGMENTS)
    assert "\n" not in str(error.value)
    assert name in str(error.value)
