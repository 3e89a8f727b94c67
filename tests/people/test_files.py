"""Motion files: a body walks their recorded cycle."""

import importlib.util
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from mecazen.config.people import Body, Straight
from mecazen.errors import ConfigError
from mecazen.skeleton import SIDES
from mecazen_people.body.files import read
from mecazen_people.body.posture import Segments
from mecazen_people.body.recording import read_recording
from mecazen_people.body.walker import WalkingPerson
from people.walks import curve_errors, joint, slip, walk

MOCAP = Path(__file__).parents[2].parent / "shared" / "data" / "mocap"
needs_recordings = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no recordings in {MOCAP}")
HAS_EZC3D = importlib.util.find_spec("ezc3d") is not None
needs_ezc3d = pytest.mark.skipif(not HAS_EZC3D, reason="pip install ezc3d")
if HAS_EZC3D:
    with warnings.catch_warnings(action="ignore"):  # of SWIG, on Python 3.12 and later
        import ezc3d
SEGMENTS = Segments.from_height(1.75)

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
    style = WalkingPerson(Body()).style
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
    walker = WalkingPerson(Body(motion_file=tmp_path / "march.mot"))
    for speed in (0.1, 0.7, 2.0):
        curves = np.degrees([walker.style.angles(0, speed, k / 100) for k in range(100)])
        assert (np.ptp(curves, axis=0) < (85.0, 95.0, 85.0)).all()  # no more than it was
        postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 6.0)
        assert slip(postures) < 0.0005


def write_c3d(file, points):
    """Write points (n, 4, frames), of which the last numbers are residuals, labelled L0, L1."""
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    labels = tuple(f"L{n}" for n in range(points.shape[1]))
    content["parameters"]["POINT"]["LABELS"]["value"] = labels
    content["data"]["points"] = points
    content.write(str(file))


@needs_ezc3d
def test_c3d_is_read_with_its_hidden_points(tmp_path):
    points = np.zeros((4, 2, 5))
    points[:3] = np.arange(30.0).reshape(3, 2, 5)
    points[:3, 1, 3] = np.nan
    write_c3d(tmp_path / "a.c3d", points)
    motion = read(tmp_path / "a.c3d")
    assert (motion.rate_hz, list(motion.values)) == (100.0, ["L0", "L1"])
    for n, places in enumerate(motion.values.values()):
        np.testing.assert_array_equal(places, points[:3, n].T)


def test_without_ezc3d_a_c3d_file_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "a.c3d").touch()
    with pytest.raises(ConfigError, match=r"C3D needs ezc3d: pip install 'mecazen\[c3d\]'"):
        read(tmp_path / "a.c3d")


def test_recorded_walk_of_a_walker_is_that_walk(tmp_path):
    walker, speed = WalkingPerson(Body()), 1.1
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
    postures = walk(WalkingPerson(Body()), Straight(speed_m_s=1.1, length_m=100.0), 8.0)[400:]
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


@needs_recordings
@pytest.mark.parametrize(
    ("name", "speed", "period", "most"),
    [
        # a treadmill at 1.1 m/s, stride time 1.217 s; of another height than this person
        ("opensim/subject01_walk1_ik.mot", 1.1, 1.217, 7.5),
        ("opensim/motion_capture_walk.trc", 1.2, 1.14, 14.0),
        pytest.param(
            "ktk/walk.c3d", 1.05, 1.11, 4.0, marks=needs_ezc3d
        ),  # 0.89 m/s, on legs of 0.73 instead of 0.86 m
    ],
)
def test_recorded_people_are_walked_along_a_path(name, speed, period, most):
    walker = WalkingPerson(Body(motion_file=MOCAP / name))
    gait = read_recording(MOCAP / name, SEGMENTS)
    assert gait.speed == pytest.approx(speed, rel=0.1)
    assert gait.stride / gait.speed == pytest.approx(period, rel=0.03)
    postures = walk(walker, Straight(speed_m_s=gait.speed, length_m=100.0), 12.0)
    assert slip(postures) < 0.0005
    rms = np.sqrt((curve_errors(walker, postures[600:], gait.speed) ** 2).mean(axis=0))
    # their segments and feet are others, markers are beside the joints, and pelves tilt
    assert rms.max() < most


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.fbx", "", "must end in one of .c3d, .mot, .trc"),
        ("a.trc", "", "no TRC file .it ends early"),
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
        pytest.param("a.c3d", "", "no C3D file", marks=needs_ezc3d),
        pytest.param("a.c3d", "time", "no C3D file", marks=needs_ezc3d),
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
