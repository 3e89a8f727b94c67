"""The lines that docs/troubleshooting.md explains are the lines that a user sees."""

import re

import pytest
from harness import ROOT, mecazen
from mecazen_tools.processes import free_port

TEXT = (ROOT / "docs" / "troubleshooting.md").read_text()
LINES = re.findall(r"^\| `((?:error|warning): .*?)` \|", TEXT, re.MULTILINE)
NOBODY = ("--connect", f"tcp/127.0.0.1:{free_port()}")
MISTAKES = {
    "no such scenario": ("simulate", "nosuch"),
    "did you mean standoff_m": ("simulate", "back", "--set", "follower.standof_m=1"),
    "got -1": ("simulate", "back", "--set", "follower.standoff_m=-1"),
    "stands inside the person": ("simulate", "back", "--set", "start.x_m=0"),
    "beyond loopback": ("run", "physics", "back", "--set", 'bus.listen=["tcp/0.0.0.0:0"]'),
    "nothing answers": (*NOBODY, "echo", "odom", "--count", "1"),
    "did you mean odom": (*NOBODY, "echo", "odmo", "--count", "1"),
    "not a geometry_msgs": (*NOBODY, "pub", "cmd_vel", '{"linear":{"x":"a"}}'),
    "linear.q is ignored": (*NOBODY, "pub", "cmd_vel", '{"linear":{"x":0.1,"q":1}}'),
    "picture's name": ("simulate", "back", "--plot", "x.gif"),
    "can't be read": ("info", "none.mcap"),
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_prints_a_line_of_the_page(words, tmp_path):
    (line,) = (line for line in LINES if words in line)
    shown = ".*".join(re.escape(part) for part in line.split("…"))
    done = mecazen(*MISTAKES[words], folder=tmp_path)
    printed = done.stderr.replace("`", "").splitlines()
    assert any(re.fullmatch(shown, one) for one in printed), done.stderr
