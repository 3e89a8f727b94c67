"""An error of a configuration is one line: file, key and allowed values."""

import pytest
from common.sections import TOY, problem

FAST = "[toy.walk]\nkind = 'fast'\n"


NUMBER_OF_TICKS = "a number >= 0.001 and <= 1"


FILE = "file; allowed: a path to a file"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("seeed = 1", "seeed: unknown key; did you mean seed? allowed: "),
        ("[sim]\ntik_s = 1.0", "sim.tik_s: unknown key; did you mean tick_s? allowed: "),
        ("robot_name = 'a'", "unknown key 'robot_name'"),
        ('[sim]\n"two\\nlines" = 1', r"sim.two\nlines: unknown key; allowed: "),
        ("[sim]\ntick_s = 'fast'", f"sim.tick_s: got 'fast'; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = true", f"sim.tick_s: got true; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = 2020-01-01", f"sim.tick_s: got 2020-01-01; allowed: {NUMBER_OF_TICKS}"),
        ("[sim]\ntick_s = 0.0100000001234", "sim.tick_s = 0.0100000001234 must be whole nanosec"),
        ("[sim]\nduration_s = 0.001", "sim.duration_s = 0.001 must be at least a tick"),
        ("[sim]\nmode = 'fast'", "sim.mode: got 'fast'; allowed: 'lockstep' or 'real_time'"),
        ("sim = 3", "sim: got 3; allowed: a table"),
        ("seed = -1", "seed: got -1; allowed: a whole number >= 0 and <= 4294967295"),
        (f"seed = {'9' * 300}", "seed: got a number of too many digits; allowed: "),
        ("services = 'physics'", "services: got 'physics'; allowed: a list, each a string"),
        ("services = ['physics', 3]", "services.1: got 3; allowed: a string"),
        ("services = ['physics', 'physics']", "services: each at most once"),
        ("[programs]\nfollower = 3", "programs.follower: got 3; allowed: a string"),
        ("programs = ['x']", "programs: got ['x']; allowed: a table, each value a string"),
        (
            "[[world.walls]]\npoints_m = [[0.0, 0.0]]",
            "world.walls.0.points_m: got [[0.0, 0.0]]; allowed: a list of at least 2, each [a num",
        ),
        ("[bus]\nnamespace = '/robot'", "bus.namespace: got '/robot'; allowed: a string that mat"),
        ("[bus]\nzenoh_config = 3", "bus.zenoh_config: got 3; allowed: a path to a file"),
        ("[bus]\nzenoh_config = 'x'", f"bus.zenoh_config: scenarios/x: no such {FILE}"),
        ("[bus]\nkeys = 'x'", f"bus.keys: scenarios/x: no such {FILE.replace('file', 'folder')}"),
        (
            "[viewer]\nweb_port = 80\ndata_port = 80",
            "viewer: web_port and data_port must differ: both are 80",
        ),
        (
            "[sensor]\nocclusions_s = [[1, 2], [3, 'x']]",
            "sensor.occlusions_s.1.1: got 'x'; allowed: ",
        ),
        ("[sensor]\nocclusions_s = [[1.0]]", "sensor.occlusions_s.0: got [1.0]; allowed: [a numb"),
        ("[sensor]\nocclusions_s = [[2.0, 1.0]]", "sensor: occlusions_s: [2.0, 1.0] must end aft"),
        (f"seed = {'9' * 5000}", "not TOML: "),
        (f"seed = {'[' * 5000}", "not TOML: "),
    ],
)
def test_when_a_value_is_wrong_expect_file_key_and_what_is_allowed(write_scenario, text, expected):
    assert problem(write_scenario(text)).startswith(f"scenarios/test.toml: {expected}")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (
            "robot.wheels.raduis_m=1",
            "wheels.raduis_m: unknown key; did you mean radius_m? allowed: ",
        ),
        ("robot.wheels.radius_m=-1", "wheels.radius_m: got -1; allowed: a number > 0 "),
        (
            'robot.rollers.arrangement="O"',
            "rollers.arrangement: robot: rollers.arrangement = 'O': such a robot can hardly turn",
        ),
        (
            "robot.rollers.hull_spheres=10",
            "rollers.hull_spheres: robot: rollers.hull_spheres = 10 must be odd",
        ),
        ("robot.rollers.count=3", "rollers.count: got 3; allowed: a whole number >= 4 and <= 40"),
        ("robot.name=Foo", "name: got 'Foo'; allowed: a string that matches "),
        ("robot.camera={}", "camera: robot.camera.size_m: missing; must be a list, each a number"),
        ("robot.camera.position_m=[0.0,0.0]", "camera.position_m: got [0.0, 0.0]; allowed: [a num"),
        (
            "robot.wheels.radius_m=0.01",
            "wheels.radius_m: robot: rollers.max_radius_m = 0.0095 must be below half of "
            "wheels.radius_m = 0.01",
        ),
        (
            "robot.wheels.radius_m=47.5",
            "wheels.radius_m: got 47.5; allowed: a number > 0 and <= 0.5; 47.5 looks like millimet",
        ),
        (
            "robot.camera.position_m=[-160, 0, 150]",
            "camera.position_m: robot.camera.position_m.0: got -160; allowed: a number >= -5 "
            "and <= 5; -160 looks like millimetres",
        ),
        (
            "robot.base.mass_kg=12000",
            "base.mass_kg: got 12000; allowed: a number > 0 and <= 2000; 12000 looks like grams",
        ),
        # the base of 0.24 m and half a hub of 0.04 m on either side
        (
            "robot.wheels.track_m=0.1",
            "wheels.track_m: robot: wheels.track_m = 0.1: the wheels would be inside the base, "
            "which is between them; with this base.width_m and wheels.hub_width_m it must be at "
            "least 0.28",
        ),
        (
            "robot.wheels.wheelbase_m=0.09",
            "wheels.wheelbase_m: robot: wheels.wheelbase_m = 0.09 must be above 0.1: front",
        ),
        (
            "robot.base.clearance_m=0.06",
            "base.clearance_m: robot: base.clearance_m = 0.06 must be below wheels.radius_m = 0.05",
        ),
        ("robot.lidar.size_m=[1.0]", "lidar.size_m: robot: lidar.size_m must be [radius, height]"),
    ],
)
def test_when_an_override_breaks_the_robot_expect_the_robot_file_named(
    write_scenario, override, expected
):
    start = f"robots/nexus.toml with --set robot.{expected}"
    assert problem(write_scenario(), override).startswith(start)


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        ("", "scenarios/test.toml: robot: missing; must be a robot file, or a table"),
        ('robot = { file = "none.toml" }\n', "scenarios/none.toml: can't be read: No such file"),
        (
            'robot = { file = "../robots/nexus.toml", payload = { mass_kg = 1.0 } }\n',
            "scenarios/test.toml: robot.payload.position_m: missing; must be [a number >= ",
        ),
        (
            'robot = { file = "../robots/nexus.toml", '
            "payload = { mass_kg = 1.0, position_m = [0.0, 0.0, 0.1] } }\n",
            "robots/nexus.toml: robot: payload.position_m: its underside would be 0 m above the ",
        ),
        ("robot = 5\n", "scenarios/test.toml: robot: got 5; allowed: a robot file, or a table"),
        (
            '[robot]\nname = "x"\nbase = { mass_kg = 1.0 }\n',
            "scenarios/test.toml: robot.base.length_m: missing; must be a number > 0 and <= "
            "5; also missing: robot.base.width_m, robot.base.height_m, "
            "robot.base.clearance_m, robot.wheels, robot.rollers, robot.camera, robot.lidar",
        ),
        ('robot = "none.toml"\n', "scenarios/none.toml: can't be read: No such file"),
        ('robot = "none"\n', "scenarios/test.toml: robot: none: no such robot; a path"),
        ('robot = "../robots"\n', "scenarios/../robots: can't be read: Is a directory"),
        ('robot = "a\\u0000b"\n', r"scenarios/a\x00b: can't be read: embedded null byte"),
    ],
)
def test_when_there_is_no_robot_expect_what_is_missing(write_scenario, robot, expected):
    assert problem(write_scenario(robot=robot)).startswith(expected)


def test_an_unknown_robot_of_an_override_is_not_blamed_on_the_file_alone(write_scenario):
    expected = "scenarios/test.toml with --set robot: robot: none: no such robot; "
    assert problem(write_scenario(), "robot=none").startswith(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[toy]\nwolk = 1", "toy.wolk: unknown key; did you mean walk? allowed: limit, mixed, wal"),
        ("toy = 1", "toy: got 1; allowed: a table"),
        ("[toy.walk]\nkind = 'fst'", "toy.walk.kind: got 'fst'; allowed: 'slow' or 'fast'"),
        ("[toy.walk]\nspeed_m_s = 1.0", "toy.walk.kind: missing; must be 'slow' or 'fast'"),
        ("[toy]\nwalk = 3", "toy.walk: got 3; allowed: "),
        (FAST, "toy.walk.speed_m_s: missing; must be a number > 0"),
        (f"{FAST}speed_m_s = 0.0", "toy.walk.speed_m_s: got 0.0; allowed: a number > 0"),
        (
            f"{FAST}speed = 1.0",
            "toy.walk.speed: unknown key; did you mean speed_m_s? allowed: kind, sp",
        ),
        ("[toy.weights]\na = 1.0\nb = 'x'", "toy.weights.b: got 'x'; allowed: a number"),
        ("[toy]\nlimit = 0.0", "toy.limit: got 0.0; allowed: a number > 0"),
        ("[toy]\nlimit = 'none'", "toy.limit: got 'none'; allowed: a number > 0"),
        ("[toy]\nmixed = true", "toy.mixed: got true; allowed: a number or a string"),
    ],
)
def test_when_the_section_of_a_user_node_is_wrong_expect_the_same_care(
    write_scenario, tmp_path, text, expected
):
    (tmp_path / "toy.py").write_text(TOY)
    path = write_scenario(f"programs.toy = '../toy.py:ToyNode'\n{text}")
    assert problem(path).startswith(f"scenarios/test.toml: {expected}")
