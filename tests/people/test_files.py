"""Motion files: a body walks their recorded cycle."""

import importlib.util
import re
import sys
import warnings

import numpy as np
import pytest
from harness import error_of
from mecazen.config.people import Body, Recorded, Straight
from mecazen.errors import ConfigError
from mecazen.skeleton import SIDES
from mecazen_people.body.files import read
from mecazen_people.body.posture import Segments
from mecazen_people.body.recording import MARKERS, height_of, read_pelvis, read_recording
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.paths import make_path
from people.walks import joint, walk

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


def points_of(postures, system="OpenCap's markers, OpenSim"):
    """Return the points (n, 3) [m] of a walk by their names in a system, x forward and z up."""
    row, (left, right) = MARKERS[system], (joint(postures, f"{side}_hip") for side in SIDES)
    # the front of the pelvis from the hips, against Bell's rule
    width = np.linalg.norm(left - right, axis=1, keepdims=True) / 0.72
    across = (left - right) / width / 0.72
    ahead = np.cross(across, [0.0, 0.0, 1.0])
    front = (left + right) / 2 + width * (0.19 * ahead + [0.0, 0.0, 0.30])
    points = {}
    for side, name, sign in ((side, side[0].upper(), 1 - 2 * n) for n, side in enumerate(SIDES)):
        for marker, j in zip(row[:4], ("hip", "knee", "ankle", "foot"), strict=True):
            points[marker.format(name)] = joint(postures, f"{side}_{j}")
        points[row.pelvis.format(name)] = front + sign * width / 2 * across
    return {name: places for name, places in points.items() if name}


def write(file, points, unit=1.0, axes=(1, 2, 0)):
    """Write points in a unit [m] as TRC or C3D, with `axes` as x, y and z: y up; 100 in a second.

    In C3D the last number of a point is a residual.
    """
    places = np.stack([places[:, axes] / unit for places in points.values()], axis=1)
    if file.suffix == ".c3d":
        content = ezc3d.c3d()
        content["parameters"]["POINT"]["RATE"]["value"] = [100.0]
        content["parameters"]["POINT"]["LABELS"]["value"] = [*points]
        content["data"]["points"] = np.concatenate([places, places[..., :1] * 0.0], axis=2).T
        content.write(str(file))
        return
    names = "\t\t\t".join(points)
    lines = ["PathFileType\t4", "DataRate", "100", f"Frame#\tTime\t{names}", "\t\tX1\tY1\tZ1", ""]
    for k, row in enumerate(places.reshape(len(places), -1)):
        lines.append("\t".join([str(k + 1), f"{k / 100:.5f}", *(f"{x:.6f}" for x in row)]))
    file.write_text("\n".join(lines) + "\n")


def write_mot(file, angles):
    """Write hip, knee and ankle of the left and of the right leg (n, 6) [deg], 100 in a second."""
    rows = [
        " ".join(f"{x:.5f}" for x in (k / 100, 0.0, hl - 10.0, kl, al, hr - 10.0, kr, ar))
        for k, (hl, kl, al, hr, kr, ar) in enumerate(angles)
    ]
    file.write_text("\n".join(["inDegrees=yes", *MOT.splitlines()[:2], *rows]))


def steps_of(speed, period, seconds):
    """The angles (n, 6) [deg] of a healthy walk, 100 in a second."""
    style = WalkingPerson(Body()).style
    phases = np.arange(0.0, seconds, 0.01) / period
    sides = [[style.angles(side, speed, (p + 0.5 * side) % 1.0) for p in phases] for side in (0, 1)]
    return np.degrees(np.concatenate(sides, axis=1))


def test_pause_and_kick_do_not_change_the_gait(tmp_path):
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


def test_recorded_walk_of_a_walker_is_that_walk(tmp_path):
    walker, speed = WalkingPerson(Body()), 1.1
    postures = walk(walker, Straight(speed_m_s=speed, length_m=100.0), 14.0)[600:]
    write(tmp_path / "own.trc", points_of(postures))
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


@pytest.fixture(scope="module")
def short_walk():
    """Postures of a person of 1.6 m who stands, walks 4 m and stands, 100 in a second."""
    person = WalkingPerson(Body(height_m=1.6))
    return walk(person, Straight(speed_m_s=1.1, length_m=4.0, start_after_s=1.0), 6.0)


@pytest.mark.parametrize(
    ("suffix", "unit", "axes", "prefix", "systems"),
    [
        ("trc", 1.0, (1, 2, 0), "", list(MARKERS)),
        ("trc", 0.001, (0, 1, 2), "Sub01:", list(MARKERS)[:1]),
        ("trc", 0.01, (2, 0, 1), "Q_", list(MARKERS)[-1:]),
        pytest.param("c3d", 0.001, (0, 1, 2), "A 1:", list(MARKERS)[:1], marks=needs_ezc3d),
    ],
)
def test_systems_formats_and_axes_give_one_walk(
    suffix, unit, axes, prefix, systems, short_walk, tmp_path
):
    for system in systems:
        file = tmp_path / f"{systems.index(system)}.{suffix}"
        points = {f"{prefix}{name}": p for name, p in points_of(short_walk, system).items()}
        write(file, {f"{prefix}C7": next(iter(points.values())), **points}, unit, axes)
        body = Body(motion_file=file)
        assert height_of(body) == pytest.approx(1.6, abs=0.01), system
        gait = read_recording(file, Segments.from_height(height_of(body)))
        assert gait.speed == pytest.approx(1.1, rel=0.05), system
        path = make_path(Recorded(file=file))
        for t in (0.0, 1.0, 3.0, 5.0):
            # the pelvis turns by 4 deg and sways by 2 cm about the way; 1.2 s round its ends
            x = min(max(1.1 * (t - 1.0), 0.0), 4.0)
            assert path.at(t).pose == pytest.approx((x, 0.0, 0.0), abs=0.08), system


def mapped(change):
    return lambda points: {name: change(places) for name, places in points.items()}


WRONG = {
    "no ankle": (
        lambda points: {name: p for name, p in points.items() if "Ankle" not in name},
        "no point for the left ankle; known: LAnkle, .*has LHJC, LKnee,",
    ),
    "inches": (
        mapped(lambda p: p / 0.0254),
        r"shanks of 0\.20 to 0\.57 m in m, cm or mm, has 15\.5",
    ),
    "short": (mapped(lambda p: p[150:200]), "(gait cycle .* lasts|person for 1 s, shows) 0.5 s"),
    "upside down": (mapped(lambda p: p * [1, -1, -1]), "must have x, y or z point up"),
    "two people": (
        lambda points: {**points, "B:LKnee": points["LKnee"]},
        "LKnee, B:LKnee; export a",
    ),
    "mirrored": (mapped(lambda p: p * [1, -1, 1]), "left and right are swapped, or an axis is"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_motion_is_refused_in_one_line(case, short_walk, tmp_path):
    change, words = WRONG[case]
    file = tmp_path / "walk.trc"
    write(file, change(points_of(short_walk)))
    readers = [lambda: WalkingPerson(Body(motion_file=file)), lambda: read_pelvis(file)]
    for reader in readers[: 1 if case == "mirrored" else 2]:  # it gives no gait, but a path
        error = error_of(ConfigError, reader)
        assert error.startswith(f"{file}: ")
        assert re.search(words, error)


def test_a_person_gets_up_walks_and_sits_down(short_walk, tmp_path):
    """A recording with a chair: who sits is left out, so the track begins standing."""
    points = points_of(short_walk)
    low = np.interp(np.arange(601), [0, 50, 550, 600], [0.5, 0.0, 0.0, 0.5])[:, None]
    for side in "LR":
        for point in ("HJC", "ASIS"):
            points[side + point] = points[side + point] - low * [0.0, 0.0, 1.0]
    write(tmp_path / "tug.trc", points)
    track = read_pelvis(tmp_path / "tug.trc")
    assert (track[0, 0], track[-1, 0]) == pytest.approx((0.28, 5.72), abs=0.05)
    assert read_recording(tmp_path / "tug.trc", SEGMENTS).speed == pytest.approx(1.1, rel=0.1)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.fbx", "", "must end in one of .c3d, .mot, .trc"),
        ("a.trc", "", "no TRC file .it ends early"),
        ("a.mot", "time\n", "no MOT file"),
        ("a.mot", f"{MOT}0.02 1 1\n", "a row has 3 instead of 8 numbers"),
        ("a.mot", f"{MOT}{ROW}", "its times must increase"),
        ("a.mot", f"{MOT}.02{ROW[1:]}".replace("knee_angle_r", "x"), "no point for the left hip"),
        pytest.param("a.c3d", "time", "no C3D file", marks=needs_ezc3d),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    error = error_of(ConfigError, lambda: read_recording(tmp_path / name, SEGMENTS))
    assert re.search(words, error)
    assert name in error


def test_without_ezc3d_a_c3d_file_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "a.c3d").touch()
    with pytest.raises(ConfigError, match=r"C3D needs ezc3d: pip install 'mecazen\[c3d\]'"):
        read(tmp_path / "a.c3d")
