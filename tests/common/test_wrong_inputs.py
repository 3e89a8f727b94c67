"""Wrong inputs of a user: scenarios, settings, robots, places and programs.

Each is refused with one line, which wrong_inputs.json pins. This writes it again, for a change of
messages on purpose: `PYTHONPATH=tests .venv/bin/python tests/common/test_wrong_inputs.py`.
"""

import json
import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import toys
from harness import ROBOTS, error_of
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario, parse_settings
from mecazen.programs import classes, graph_of

FILE = Path(__file__).with_name("wrong_inputs.json")
NEXUS = 'robot = "../robots/nexus.toml"\n'
TWO = "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\nstart = {y_m = 1.5}\n"
MINE = "programs.mine = '../my.py:Mine'\n"
BRIDGE = "bus.ros_bridge = ['tcp/localhost:7447']"
WALL = "world.walls = [{ points_m = "
OCCLUSION = "sensor.occlusions_s = [[2, 1]]"

# the text of a scenario, and settings of the command line
CASES = [
    # keys
    ("seeed = 1",),
    ("sim.tik_s = 1.0",),
    ('sim."two\\nlines" = 1',),
    # values
    ("sim.tick_s = 'fast'",),
    ("sim.tick_s = 0.0100000001234",),
    ("sim.duration_s = 0.001",),
    ("sim.mode = 'fast'",),
    (f"seed = {'9' * 5000}",),
    (f"seed = {'[' * 5000}",),
    ("services = 'physics'",),
    ("services = ['physics', 3]",),
    ("services = ['physics', 'physics']",),
    ("services = ['physics', 'target', 'follower']",),
    ("guard.enabled = false\nservices = ['guard']",),
    ("controller.command_key = 'odom'",),
    ("controller.commands = [{ key = 'joy' }, { key = 'joy' }]",),
    ("controller.commands = [{ key = 'cmd_vel', lock = true }]",),
    ("controller.commands = [{ key = 'sim/reset' }]",),
    ("controller.update_rate_hz = 30.0",),
    ("programs.target = 3",),
    ("bus.namespace = '/robot'",),
    ("bus.keys = 'x'",),
    ("bus.ros2 = true\nbus.namespace = '1'",),
    (BRIDGE,),
    (f"{BRIDGE}\nbus.ros_connect = ['tcp/r:1']",),
    ("viewer.web_port = 80\nviewer.data_port = 80",),
    ("sensor.occlusions_s = [[1.0]]",),
    (OCCLUSION,),
    ("sensors.tracker.max_range_m = 0.4",),
    ("sensors.depth.edge_probability = 0.6",),
    # settings of the command line
    ("", "seed="),
    ("", "seed=1\nsim.speed=2"),
    ("", "sim.mode.x=3"),
    ("", "guard.margin_m=0"),
    ("", "target.body.limp={}"),
    ("seed = 1", "seed.x=3"),
    (OCCLUSION, "sensor.fov_deg=30"),
    ("", "=3"),
    ("", "seed=[1,"),
    # the robot
    ("robot = 5",),
    ("robot = 'nexsu'",),
    ("robot = '../robots'",),
    ("robot = '../robots/count.toml'",),
    ("robot = '../robots/broken.toml'",),
    ("robot = { name = 'x', base = { mass_kg = 1.0 } }",),
    ("", "robot.wheels.raduis_m=1"),
    ("", "robot.wheels.radius_m=47.5"),
    ("", "robot.base.mass_kg=12000"),
    # several robots
    ("[[robots]]\nname = 'sim'",),
    (TWO.replace("two", "one"),),
    (TWO.replace("1.5", "0.3"),),
    (TWO, "robots.three.start.x_m=2.0"),
    ("[[robots]]\nname = 'a'\nphysics = {}",),
    ("[[robots]]\nname = 'a'\nsensor.kind = 'body'",),
    # places
    ("world.wals = []",),
    ("world.map = 'none.yaml'",),
    (f"{WALL}[[0, 0], [0, 0]] }}]",),
    (f"{WALL}[[0, 0], [2, 0]], doors = [{{ at_m = 1.9, width_m = 1.0 }}] }}]",),
    ("world.ramps = [{ length_m = 1, width_m = 1, rise_m = 0.1, position_m = [0, 0] }]",),
    # programs
    ("programs.mine = 'physic'",),
    ("programs.mine = 'none.py:Toy'",),
    ("programs.mine = '../wrong.py:Toy'",),
    ("programs.mine = '../fails.py:Toy'",),
    ("programs.mine = '../pipe.py:Toy'",),
    ("programs.mine = 'not_there:Toy'",),
    ("programs.mine = '../my.py:'",),
    ("programs.mine = '../my.py:Lader'",),
    ("programs.mine = '../my.py:Gain'",),
    ("programs.mine = '../my.py:Toy'",),
    ("programs.mine = '../my.py:Untyped'",),
    ("programs.mine = '../my.py:Watcher'",),
    ("programs.mine = ':Toy'",),
    ("programs.follower = '../my.py:Mine'",),
    ("programs.viewer = '../my.py:Leader'\nservices = ['viewer']",),
    ("programs.my-node = '../my.py:Mine'",),
    ("programs.clock = '../my.py:Mine'",),
    # sections of programs
    ("programs.mine = '../my.py:Required'",),
    (f"{MINE}mine.gian = 2.0",),
    (f"{MINE}mine.walk = 3",),
    (f"{MINE}mine.walk.kind = 'fast'",),
    (f"{MINE}mine.walk.kind = 'fast'\nmine.walk.speed = 1",),
    (f"{MINE}mine.weights.b = 'x'",),
    (f"{MINE}mine.mixed = true",),
]


def name_of(case):
    """Return the text and settings of a case, shortened."""
    text, *settings = case
    name = " ".join([text, *(f"--set {setting}" for setting in settings)]).strip()
    return name if len(name) <= 120 else f"{name[:20]}… ({len(name)})"


def write_files(folder):
    """Write the files that the cases name; return the path of the scenario."""
    for name in ("robots", "scenarios"):
        (folder / name).mkdir()
    nexus = (ROBOTS / "nexus.toml").read_text()
    (folder / "robots" / "nexus.toml").write_text(nexus)
    (folder / "robots" / "count.toml").write_text(nexus.replace("count = 9", "count = 'nine'"))
    (folder / "robots" / "broken.toml").write_text("name = ")
    shutil.copy(toys.__file__, folder / "my.py")
    (folder / "wrong.py").write_text("class Toy(")
    (folder / "fails.py").write_text("1 / 0")
    os.mkfifo(folder / "pipe.py")
    return folder / "scenarios" / "test.toml"


def start(path, settings):
    """Load a scenario and the classes of its nodes."""
    scenario = load_scenario(path, parse_settings(settings))
    graph_of(scenario)
    for service in scenario.services:
        classes(service, scenario)


def problem(folder, text, *settings):
    """Return the error of a scenario without the folder's path."""
    path = write_files(folder)
    path.write_text(text if text.startswith("robot =") else NEXUS + text)
    return error_of(ConfigError, lambda: start(path, settings)).replace(f"{folder}/", "")


def test_each_case_has_its_own_name():
    assert json.loads(FILE.read_text()).keys() == {name_of(case) for case in CASES}
    assert len({name_of(case) for case in CASES}) == len(CASES)


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_a_wrong_input_has_its_pinned_line(case, tmp_path):
    assert problem(tmp_path, *case) == json.loads(FILE.read_text())[name_of(case)]


def lines():
    """Return the line of each case by its name."""
    for case in CASES:
        with TemporaryDirectory() as folder:
            yield name_of(case), problem(Path(folder), *case)


if __name__ == "__main__":
    FILE.write_text(json.dumps(dict(lines()), indent=1, ensure_ascii=False) + "\n")
