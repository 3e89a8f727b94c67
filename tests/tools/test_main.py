"""Ctrl-C before a command has begun."""

import signal
import subprocess
import sys

import pytest
from harness import COMMAND_GUARD_S

INTERRUPTED = """
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
    ("importing", "code"),
    # the first ends the process by the signal, which a shell tells as 130, too
    [("mecazen_tools.cli", -signal.SIGINT), ("typer._adapters", 130)],
    ids=["the commands", "what makes their options"],
)
def test_ctrl_c_while_a_command_starts_says_nothing(importing, code):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, importing],
        capture_output=True, text=True, check=False, timeout=COMMAND_GUARD_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "")


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


def test_ctrl_c_while_a_class_is_made_says_nothing():
    done = subprocess.run(
        [sys.executable, "-c", IN_A_CLASS],
        capture_output=True, text=True, check=False, timeout=COMMAND_GUARD_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "")
