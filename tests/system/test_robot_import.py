"""`mecazen robot`: a robot file from descriptions of four kinds, and what is wrong with others."""

import re
from pathlib import Path

import pytest
from harness import assert_one_line, here
from mecazen.errors import ConfigError
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen_tools.simulation import Simulation

DESCRIPTIONS = Path(__file__).parent / "robots"
FIXED, XACRO, SDF, MJCF = (
    DESCRIPTIONS / name
    for name in ("fixed.urdf", "turning.urdf.xacro", "plugin.sdf", "rolling.xml")
)
CONTROLLERS = DESCRIPTIONS / "controllers.yaml"


@pytest.fixture
def robot_import(tmp_path):
    """Run `mecazen robot import`; return the path of the file that it writes and the output."""

    def run(*arguments):
        file = tmp_path / "robot.toml"
        file.unlink(missing_ok=True)
        done = here("robot", "import", *arguments, "-o", file)
        assert bool(done.returncode) != file.exists()
        return file, done

    return run


def test_a_urdf_with_fixed_wheels(robot_import):
    file, done = robot_import(FIXED)
    robot = load_table(file, Robot)
    assert robot.name == "fixed_wheels"
    assert robot.wheels.joints == ("fl_joint", "fr_joint", "rl_joint", "rr_joint")
    wheels = robot.wheels
    assert (wheels.radius_m, wheels.wheelbase_m, wheels.track_m) == (0.05, 0.32, 0.3)
    assert (wheels.max_torque_nm, wheels.max_speed_rad_s) == (3.0, 25.0)
    assert wheels.hub_mass_kg + robot.rollers.count * robot.rollers.mass_kg == pytest.approx(0.5)
    base = robot.base
    assert (base.length_m, base.width_m, base.height_m, base.clearance_m, base.mass_kg) == (
        *(0.45, 0.24, 0.12),
        *(0.02, 9.0),
    )
    assert robot.lidar.position_m == pytest.approx((0.1, 0.0, 0.17))
    assert robot.lidar.frame == "laser_frame"
    assert "assumed: as on wheels of 100 mm; N = 9: strafes 2.0 % less" in file.read_text()
    # an optical frame is not a camera
    assert robot.camera is None
    assert "no camera: scenarios" in done.stdout
    with pytest.raises(
        ConfigError, match=r"fixed_wheels has no camera, which sensor.kind = 'body'"
    ):
        Simulation("back", {"robot": file, "sensor.kind": "body"})


def test_a_xacro_with_its_controller(robot_import):
    pytest.importorskip("xacrodoc")
    file, done = robot_import(XACRO, "--controller", CONTROLLERS, "--set", "rollers.count=10")
    robot = load_table(file, Robot)
    assert (robot.wheels.radius_m, robot.rollers.count) == (0.0762, 10)
    assert robot.camera.pitch_deg == pytest.approx(22.918)
    assert (robot.camera.optical_frame, robot.lidar) == ("camera_depth_frame_optical", None)
    assert "half of the wheel's width: the robot turns 6.2 % less" in done.stdout
    assert "base_frame_offset puts the wheels' centre at (0.2, 0.0) m in base_link" in done.stdout
    assert 'controller.base_frame_id = "base_footprint"' in file.read_text()
    file, _ = robot_import(XACRO, "--arg", "radius:=0.06")
    assert load_table(file, Robot).wheels.radius_m == 0.06


def test_an_sdf_with_its_plugin(robot_import):
    file, done = robot_import(SDF)
    robot = load_table(file, Robot)
    assert robot.wheels.joints == ("fl", "fr", "bl", "br")
    assert (robot.wheels.wheelbase_m, robot.wheels.track_m) == (0.4, 0.4)
    assert robot.wheels.centre_m == (-0.1, 0.0)
    assert robot.lidar.position_m == pytest.approx((-0.2, 0.0, 0.2))
    assert robot.lidar.frame == "head"
    assert "the robot moves 2.0 % less than commanded" in done.stdout


def test_an_mjcf_with_rollers_is_drawn_and_follows(robot_import, tmp_path):
    file, _ = robot_import(MJCF)
    robot = load_table(file, Robot)
    rollers = robot.rollers
    assert (rollers.count, rollers.angle_deg, rollers.arrangement) == (9, 45.0, "X")
    assert (rollers.max_radius_m, rollers.mass_kg) == (0.0095, 0.02)
    assert (robot.wheels.max_torque_nm, robot.wheels.max_speed_rad_s) == (3.0, 40.0)
    assert robot.camera.position_m == pytest.approx((0.16, 0.0, 0.15))
    assert robot.camera.frame == "rgb"
    assert 'controller.base_frame_id = "chassis"' in file.read_text()
    report = here("robot", "show", file, folder=tmp_path).stdout
    assert (tmp_path / report.split(":")[0]).stat().st_size
    rows = re.findall(r"(\w+) +│ (\d\.\d+) +│ (\d\.\d+)", report)
    assert [name for name, _, _ in rows] == ["forward", "left", "turn", "diagonal"]
    for name, measured, formula in rows:
        # the phases of the wheels change only the gain of turning
        assert float(measured) == pytest.approx(
            float(formula), rel=2e-2 if name == "turn" else 1e-3
        )
    with Simulation("back", {"robot": file}, duration_s=10.0) as simulation:
        simulation.run()
        assert simulation.scores().d_err_m < 0.05


WRONG = [
    ({"rr_wheel": "rr_post"}, (), "3 wheels: fl_wheel, fr_wheel, rl_wheel; a mecanum robot has"),
    ({' effort="3"': ""}, (), "wheels.max_torque_nm (no effort limit); give what you know"),
    ({'<cylinder radius="0.05" length="0.04"/>': '<mesh filename="w.stl"/>'}, (), "only meshes"),
    ({"0.16 ": "160 ", "0.15 ": "150 "}, (), "320 m apart: is the file in millimetres?"),
    ({'rpy="-1.5707963 0 0"': 'rpy="0 0 0"'}, (), "fl_joint: its axis is [0.0, 0.0, 1.0]"),
    ({'"-0.16 -0.15': '"-0.26 -0.15'}, (), "no level rectangle: "),
    ({"</robot>": ""}, (), "not XML"),
    ({'effort="3"': 'effort="three"'}, (), "could not convert string to float: 'three'"),
    ({"</robot>": "<xacro:if/></robot>", "<robot": "<robot xmlns:xacro='x'"}, (), ".xacro"),
    ({'link="base_footprint"': 'link="nothing"'}, (), "parent"),
    ({}, ("--controller", CONTROLLERS), "has no joint fl_wheel_joint, "),
    ({}, ("--controller", FIXED), "no settings of a mecanum controller"),
    ({}, ("--set", "rollers.number=3"), "rollers.number"),
    ({}, ("--set", "rollers.count=many"), "rollers.count: got 'many'; must be a number"),
    ({}, ("--set", "wheels.radius_m=0"), "wheels.radius_m"),
    ({}, ("--arg", "radius=3"), "name:=value"),
]


@pytest.mark.parametrize(("changes", "options", "words"), WRONG)
def test_a_broken_description_gets_one_line(changes, options, words, robot_import, tmp_path):
    text = FIXED.read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (broken := tmp_path / "broken.urdf").write_text(text)
    _, done = robot_import(broken, *options)
    assert_one_line(done, done.returncode, "error: ", words)
    assert done.stdout == ""
