"""What docs/quickstart.md shows is what a user sees: its files are written, its commands run."""

import re
import shlex
import time

import pytest
from harness import COMMAND_GUARD_S, ROOT, Command, endpoint_of, mecazen, options
from mecazen_tools.processes import private_router

TEXT = (ROOT / "docs" / "quickstart.md").read_text()
SECTIONS = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL))
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
ASKS_A_RUNNING_SCENARIO = {"echo", "status", "pub", "sim"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the page."""
    made = tmp_path_factory.mktemp("quickstart")
    blocks = dict(BLOCK.findall(SECTIONS["Write a follower"]))
    (made / "my_follower.py").write_text(blocks["python"])
    (made / "my_follower.toml").write_text(blocks["toml"])
    return made


def steps(section):
    """Return the commands of each block of a section, and the output that is expected of them."""
    blocks = [block for block in BLOCK.findall(SECTIONS[section]) if block[0] in {"sh", "text"}]
    assert [kind for kind, _ in blocks] == ["sh", "text"] * (len(blocks) // 2)
    return [
        ([shlex.split(line) for line in run.splitlines()], shown.splitlines())
        for (_, run), (_, shown) in zip(blocks[::2], blocks[1::2], strict=True)
    ]


def pattern(line):
    """Return what matches a shown line, in which … is anything."""
    return re.compile(".*".join(re.escape(part) for part in line.split("…")))


def assert_shown(output, lines):
    """Each line is in the output, in order."""
    left = iter(output.splitlines())
    for line in lines:
        assert any(pattern(line).search(one) for one in left), f"{line!r} is not in {output}"


def run(commands, folder, *options):
    """Run commands to their ends; return what they print."""
    printed = ""
    for words in commands:
        assert words[0] == "mecazen"
        done = mecazen(*options, *words[1:], folder=folder)
        assert (done.returncode, done.stderr) == (0, ""), words
        printed += done.stdout
    return printed


def test_the_version_is_the_one_that_is_shown(folder):
    ((commands, shown),) = steps("Install")
    assert_shown(run(commands[-1:], folder), shown)


@pytest.mark.parametrize("section", ["Watch", "Drive"])
def test_a_scenario_starts_and_answers_the_commands_of_another_terminal(section, folder):
    ((((_, *start),), started), (asked, shown)) = steps(section)
    settings = private_router("tcp")
    running = Command(*start, "--no-viewer", *options(settings))
    namespace = next(one for one in settings if "namespace" in one).partition("=")[2].strip('"')
    where = ("--connect", endpoint_of(settings), "--namespace", namespace)
    for line in started:
        found = pattern(line)
        end = time.monotonic() + COMMAND_GUARD_S
        while not found.search(running.read_until("")) and time.monotonic() < end:
            pass
        assert found.search(running.text), running.text
    assert {words[1] for words in asked} <= ASKS_A_RUNNING_SCENARIO
    assert_shown(run(asked, folder, *where), shown)
    code, _, _ = running.end()
    assert code == 0


@pytest.mark.parametrize("section", ["Score it", "Record and replay"])
def test_the_follower_of_the_page_gives_the_scores_that_are_shown(section, folder):
    ((commands, shown),) = steps(section)
    assert_shown(run(commands, folder), shown)
