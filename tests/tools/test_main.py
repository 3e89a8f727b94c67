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
IN_A_CLASS = """
import sys, types
from mecazen_tools.__main__ import main

class Interrupt:
    def __set_name__(self, *_):
        raise KeyboardInterrupt

def run():
    type("Made", (), {"attribute": Interrupt()})

sys.modules["mecazen_tools.cli"] = types.SimpleNamespace(main=run)
main()
"""


@pytest.mark.parametrize(
    ("program", "code"),
    [
        # the first ends the process by the signal, which a shell reports as 130, too
        ((IN_AN_IMPORT, "mecazen_tools.cli"), -signal.SIGINT),
        ((IN_AN_IMPORT, "typer._adapters"), 130),
        ((IN_A_CLASS,), 130),
    ],
    ids=["importing the commands", "importing what makes their options", "making a class"],
)
def test_ctrl_c_while_a_command_starts_says_nothing(program, code):
    done = subprocess.run(
        [sys.executable, "-c", *program],
        capture_output=True, text=True, check=False, timeout=COMMAND_GUARD_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "")
