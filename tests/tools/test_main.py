"""Ctrl-C before a command has begun."""

import signal
import subprocess
import sys

import pytest
from harness import COMMAND_GUARD_S

IN_AN_IMPORT = """
import os, signal, sys
from mecazen_tools.__main__ import main

class Interrupt:
    def find_spec(self, name, *_):
        if name == sys.argv[1]:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
main()
"""


@pytest.mark.parametrize(
    ("module", "code"),
    [
        # the first ends the process by the signal, which a shell reports as 130, too
        ("mecazen_tools.cli", -signal.SIGINT),
        ("typer._adapters", 130),
    ],
    ids=["importing the commands", "importing what makes their options"],
)
def test_ctrl_c_while_a_command_starts_says_nothing(module, code):
    done = subprocess.run(
        [sys.executable, "-c", IN_AN_IMPORT, module],
        capture_output=True, text=True, check=False, timeout=COMMAND_GUARD_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "")
