"""Wrong inputs of a user: scenarios, settings, robots, places and programs.

Each is refused with the line that wrong_inputs.json has for it: for the text of a scenario, and for
a setting of the command line after `--set`. This writes the lines again, for a new input, with any
line, or for a change of messages on purpose:
`PYTHONPATH=tests .venv/bin/python tests/common/test_wrong_inputs.py`.
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
LINES = json.loads(FILE.read_text())
NEXUS = 'robot = "../robots/nexus.toml"\n'


def write_files(folder):
    """Write the files that the inputs name; return the path of the scenario."""
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


def problem(folder, case):
    """Return the error of a scenario and its settings, without the folder's path."""
    text, *settings = case.split("--set ")
    path = write_files(folder)
    path.write_text(text if text.startswith("robot =") else NEXUS + text)
    return error_of(ConfigError, lambda: start(path, settings)).replace(f"{folder}/", "")


@pytest.mark.parametrize("case", LINES)
def test_a_wrong_input_has_its_pinned_line(case, tmp_path):
    assert problem(tmp_path, case) == LINES[case]


DIGITS = (
    "Exceeds the limit (4300 digits) for integer string conversion: value has 5000 digits; "
    "use sys.set_int_max_str_digits() to increase the limit"
)


@pytest.mark.parametrize(
    ("value", "reason"), [("9" * 5000, DIGITS), ("[" * 5000, "nested too deep")], ids=["9", "["]
)
def test_a_value_that_is_far_too_long_is_no_toml(value, reason, tmp_path):
    line = f"scenarios/test.toml: not TOML: {reason}"
    assert problem(tmp_path, f"seed = {value}") == line


if __name__ == "__main__":
    for case in LINES:
        with TemporaryDirectory() as folder:
            LINES[case] = problem(Path(folder), case)
    FILE.write_text(json.dumps(LINES, indent=1, ensure_ascii=False) + "\n")
