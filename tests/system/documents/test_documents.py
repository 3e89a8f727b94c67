"""The examples of the documents and the notebook: their files are written, their commands run."""

import re
import shlex
import subprocess
import sys
import tomllib

import nbformat
import pytest
import yaml
from hardware.stand import emulated
from harness import (
    COMMAND_GUARD_S,
    ROOT,
    SCENARIOS,
    Command,
    Newest,
    assert_one_line,
    here,
    load_robot,
    mecazen,
    options,
    tools,
)
from mecazen import Simulation
from mecazen.keys import FOLLOWER_STATE, ODOM
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import Identity
from mecazen_hardware.link import make_board
from mecazen_tools.processes import free_port, private_router

README = (ROOT / "README.md").read_text()
PAGES = {page.stem: page.read_text() for page in (ROOT / "docs").glob("*.md")}
QUICKSTART, EXTEND, HARDWARE = (PAGES[name] for name in ("quickstart", "extend", "hardware"))
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


def pattern(line):
    """Return what matches a shown line, in which … is anything."""
    return re.compile(".*".join(re.escape(part) for part in line.split("…")))


def write_files(page, folder):
    """Write the blocks of a page that begin with a file's name."""
    for name, text in re.findall(r"```\w+\n# (\w+\.\w+)\n(.*?)```", page, re.DOTALL):
        (folder / name).write_text(text)


# templates


def test_the_documents_show_or_link_each_template():
    documents = "".join(PAGES.values())
    for file in (ROOT / "examples" / "new").glob("my_*"):
        shown, link = f"\n{file.read_text()}```", f"(../examples/new/{file.name})"
        assert shown in documents or link in documents, file.name


@pytest.mark.parametrize("kind", ["follower", "sensor", "robot", "study"])
def test_a_new_file_runs_by_the_commands_that_are_printed(kind, tmp_path):
    done = here("new", kind, f"lead_{kind}", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    (file,) = tmp_path.iterdir()
    assert not re.search(rf"my_{kind}|My{kind.title()}", file.read_text())
    first, *commands = done.stdout.splitlines()
    assert first == f"{file.name}: written; next:"
    for command in commands:
        words = shlex.split(command.replace("mecazen up", "mecazen simulate"))[1:]
        if words[0] == "experiment":
            words += ["--jobs", "1", "--seeds", "1", "--only", "case=circle"]
            words += ["--set", "sim.duration_s=2.0"]
        elif words[0] == "simulate":
            words += ["--duration", "2"]
        else:
            assert words[0] == "compare"  # which a section of the quick start runs
            continue
        ran = here(*words, folder=tmp_path)
        assert ran.returncode == 0, ran.stderr
    again = here("new", kind, f"lead_{kind}", folder=tmp_path)
    assert_one_line(again, 2, file.name, "exists already")


# README


@pytest.mark.parametrize("page", ["README.md", "docs/api/simulation.md"])
def test_the_python_of_a_page_runs_as_it_stands(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first = "from mecazen import Simulation\n"
    code = (ROOT / page).read_text().partition(f"```python\n{first}")[2].partition("```")[0]
    for _ in range(2):  # the second time beside what the first has left
        exec(first + code, {})  # noqa: S102 - our own text
        assert "d_err_m=0.0" in capsys.readouterr().out


def test_names_and_links_of_the_readme_exist():
    targets = [part.partition(")")[0] for part in README.split("](")[1:]]
    files = [name.partition("#")[0] for name in targets if "://" not in name]
    assert not [name for name in files if not (ROOT / name).exists()]
    listed = here("scenarios").stdout
    for scenario in SCENARIOS.glob("*.toml"):
        assert f"`{scenario.stem}`" in README
        assert re.search(rf"│ {scenario.stem} +│ [A-Z]\w* ", listed), scenario
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert mecazen("--version").stdout.split()[-1] == citation["version"]


def test_every_extra_that_is_named_exists():
    patterns = ("*/mecazen*/**/*.py", "services/*/mecazen*/**/*.py", "*.md", "docs/*.md")
    texts = [file.read_text() for pattern in patterns for file in ROOT.glob(pattern)]
    extras = {extra for text in texts for extra in re.findall(r"mecazen\[(\w+)\]", text)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "gamepad" in extras
    assert extras <= project["optional-dependencies"].keys()


# quickstart.md

SECTIONS = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", QUICKSTART, re.MULTILINE | re.DOTALL))


@pytest.fixture(scope="module")
def quickstart(tmp_path_factory):
    """The files of the page."""
    folder = tmp_path_factory.mktemp("quickstart")
    ((commands, shown), *_) = steps("Write a follower")
    assert_shown(run(commands, folder), shown)
    return folder


def steps(section):
    """Return the commands of each block of a section, and the output that is expected of them."""
    blocks = [block for block in BLOCK.findall(SECTIONS[section]) if block[0] in {"sh", "text"}]
    assert [kind for kind, _ in blocks] == ["sh", "text"] * (len(blocks) // 2)
    return [
        ([shlex.split(line) for line in run.splitlines()], shown.splitlines())
        for (_, run), (_, shown) in zip(blocks[::2], blocks[1::2], strict=True)
    ]


def assert_shown(output, lines):
    """Each line is in the output, in order."""
    printed = iter(output.splitlines())
    for line in lines:
        assert any(pattern(line).search(shown) for shown in printed), f"{line!r} is not in {output}"


def run(commands, folder, *options, **variables):
    """Run commands to their ends; return what they print."""
    printed = ""
    for words in commands:
        assert words[0] == "mecazen"
        done = here(*options, *words[1:], folder=folder, **variables)
        assert (done.returncode, done.stderr) == (0, ""), words
        printed += done.stdout
    return printed


@pytest.mark.parametrize("section", ["Watch", "Drive"])
def test_a_scenario_starts_and_answers_the_commands_of_another_terminal(section, quickstart):
    ((((_, *start),), started), (asked, shown)) = steps(section)
    settings = private_router("tcp")
    running = Command(*start, "--no-viewer", *options(settings))
    running.read_until("robot (")
    assert_shown(running.text, started)
    bus = load_scenario(scenario_path(start[1]), parse_settings(settings)).bus
    assert_shown(run(asked, quickstart, *tools(bus)), shown)
    code, _, _ = running.end()
    assert code == 0


@pytest.mark.parametrize(
    ("section", "variables"),
    [
        ("Install", {}),
        # twenty runs, without rollers
        ("Compare it", {"MECAZEN_SET": "programs.physics=mecazen_tools.plane:Plane"}),
        ("Record and replay", {}),
    ],
)
def test_the_commands_of_a_section_print_what_it_shows(section, variables, quickstart):
    ((commands, shown),) = steps(section)
    ours = [words for words in commands if words[0] == "mecazen"]
    assert_shown(run(ours, quickstart, **variables), shown)


# troubleshooting.md

LINES = re.findall(r"^\| `((?:error|warning): .*?)` \|", PAGES["troubleshooting"], re.MULTILINE)
UNUSED = f"tcp/127.0.0.1:{free_port()}"
BRIEF = ("simulate", "back", "--duration", "0.1", "--set")
MISTAKES = {
    "stands inside the person": ("simulate", "back", "--set", "start.x_m=0"),
    "beyond loopback": ("run", "physics", "back", "--set", 'bus.listen=["tcp/0.0.0.0:0"]'),
    "nothing answers": ("--connect", UNUSED, "echo", "odom", "--count", "1"),
    "shoulders": (*BRIEF, "sensor.kind=body", "--set", "robot.camera.pitch_deg=0"),
    "faster than the robot": (*BRIEF, "target.path.speed_m_s=2.5"),
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_prints_a_line_of_the_page(words, tmp_path):
    (line,) = (line for line in LINES if words in line)
    done = here(*MISTAKES[words], folder=tmp_path)
    printed = done.stderr.replace("`", "").splitlines()
    assert any(pattern(line).fullmatch(shown) for shown in printed), done.stderr


# other pages


def run_page(page, folder, first_s=2):
    """Run the commands of a page that end, for some seconds the first simulation, the others 2."""
    seconds, printed = first_s, ""
    for kind, block in BLOCK.findall(page):
        if kind == "text":
            assert_shown(printed, block.splitlines())
        for line in block.splitlines() if kind == "sh" else ():
            words = shlex.split(line, comments=True)
            if not words or words[1] in {"up", "experiment"}:
                continue
            short = []
            if words[1] == "simulate":
                short, seconds = ["--set", f"sim.duration_s={seconds}.0"], 2
            printed += run([[*words, *short]], folder)


@pytest.fixture(scope="module")
def extend(tmp_path_factory):
    """The files of the page."""
    folder = tmp_path_factory.mktemp("extend")
    write_files(EXTEND, folder)
    return folder


def test_the_commands_of_extend_work(extend):
    run_page(EXTEND, extend)


def test_the_board_of_the_page_takes_speeds_and_reports_angles(extend):
    scenario = extend / "board.toml"
    scenario.write_text('robot = "nexus"\n[hardware]\nboard = "my_board.py:MyBoard"\n')
    board = make_board(load_scenario(scenario).hardware, load_robot())
    sent, made = board.drive(WheelSpeeds(1.0, 2.0, 3.0, 400.0))
    assert max(made) == load_robot().wheels.max_speed_rad_s
    name, wheels = board.feed(b"mine 1\n0.5 1 1.5 2\nno number\n1 2 3")
    assert (name, board.frames, board.refused) == (Identity("mine 1"), 1, 1)
    assert wheels.angles == (0.5, 1.0, 1.5, 2.0)
    assert sent == b"%.3f %.3f %.3f %.3f\n" % made


def test_the_driver_of_a_robot_moves_it_and_stops_when_nobody_commands(extend):
    assert "mecazen up my_hardware.toml" in EXTEND
    moved = []
    with Simulation(load_scenario(extend / "my_hardware.toml")) as sim:
        for tick, _ in enumerate(sim.ticks(3.0)):
            moved.append(sim.latest("odom").pose.pose.position.x)
            if tick < 100:
                sim.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    # 0.2 m/s for 1 s, and on until the command is stale, less what starting takes
    assert 0.2 < moved[-1] < 0.35
    assert moved[-1] == moved[-50]


def test_a_robot_is_imported_and_follows_as_on_the_page(tmp_path):
    pytest.importorskip("xacrodoc")
    for file in (ROOT / "tests" / "system" / "robots").iterdir():
        text = re.sub(r'name="(Fixed-Wheels|turning)"', 'name="my_robot"', file.read_text())
        suffix = file.name.partition(".")[2]
        name = file.name if suffix == "yaml" else f"my_robot.{suffix}"
        (tmp_path / name).write_text(text)
    run_page(PAGES["robot"], tmp_path)


def test_a_motion_file_is_walked_as_on_the_page(tmp_path):
    write_files(PAGES["motion"], tmp_path)
    run_page(PAGES["motion"], tmp_path, first_s=8)


def test_a_map_and_recorded_people_work_as_on_the_page(tmp_path):
    sections = re.compile(r"## (?:Maps of Nav2|Recorded people)\n.*?(?=\n## )", re.DOTALL)
    maps, people = sections.findall(PAGES["world"])
    walls = bytearray(b"\xfe" * 400 * 400)
    walls[: 400 * 10] = bytes(400 * 10)
    (tmp_path / "floor.pgm").write_bytes(b"P5 400 400 255\n" + walls)
    (tmp_path / "floor.yaml").write_text(
        "image: floor.pgm\nresolution: 0.05\norigin: [-10, -10, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    rows = [f"{6 * n} {i} {n / 4} 0 {i / 50} 0 0 0\n" for n in range(20) for i in (100, 171)]
    (tmp_path / "obsmat.txt").write_text("".join(rows))
    run_page(maps + people, tmp_path)


# hardware.md


def test_a_robot_follows_the_person_of_the_converter(stack, tmp_path):
    write_files(HARDWARE, tmp_path)
    endpoint, key = "tcp/127.0.0.1:7447", '"target/observation"'
    text = (tmp_path / "detector.py").read_text()
    assert endpoint in text
    assert key in text
    with emulated() as emulator:
        running = stack(tmp_path / "my_x3.toml", f"hardware.port={emulator.line.name}")
        bus = running.scenario.bus
        text = text.replace(endpoint, bus.connect[0])
        text = text.replace(key, f'"{bus.namespace}/target/observation"')
        (tmp_path / "detector_of_run.py").write_text(text)
        state, odom = Newest(running.bus, FOLLOWER_STATE), Newest(running.bus, ODOM)
        running.start()
        running.wait(lambda: state.message and odom.message)
        assert state.message.tracking == "waiting"
        converter = subprocess.Popen([sys.executable, tmp_path / "detector_of_run.py"])
        try:
            running.wait(lambda: state.message.tracking == "following")
            # the person stays 1.5 m ahead, more than the standoff of 1 m
            running.wait(lambda: odom.pose.x > 0.1)
        finally:
            converter.terminate()
            converter.wait(COMMAND_GUARD_S)
        assert abs(odom.pose.y) < 0.02  # straight ahead


NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
NOTEBOOK = ROOT / "examples" / "notebook.ipynb"


def test_the_notebook_prints_the_numbers_that_it_shows(tmp_path):
    copy = tmp_path / "notebook.ipynb"
    copy.write_bytes(NOTEBOOK.read_bytes())
    make = [sys.executable, str(ROOT / "docs" / "make_notebook.py"), str(copy)]
    subprocess.run(make, check=True, timeout=COMMAND_GUARD_S, capture_output=True)
    stored, made = printed(NOTEBOOK), printed(copy)
    assert NUMBER.sub("#", stored) == NUMBER.sub("#", made)
    numbers = [float(number) for number in NUMBER.findall(stored)]
    assert len(numbers) > 40
    assert [float(number) for number in NUMBER.findall(made)] == numbers


def printed(file):
    """The text that all cells show."""
    cells = nbformat.read(file, as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    return "\n".join(output.get("text") or output.data["text/plain"] for output in outputs)
