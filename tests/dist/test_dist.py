"""The wheels of `make dist`, installed as docs/deploy.md says, far from the clone."""

import os
import signal
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import msgspec
import pytest
from harness import COMMAND_GUARD_S, ROOT, mecazen, options, tools
from mecazen.loading import load_scenario, scenario_path, parse_settings
from mecazen_tools.processes import private_router

DIST = ROOT / "dist"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SHORT = ("simulate", "back", "--set", "sim.duration_s=5", "--json")
INSTALL_GUARD_S = 600.0
"""The tests take half a minute where the packages are in a cache."""


@pytest.fixture(scope="module")
def away():
    """Run a command of an environment with nothing but `mecazen[all]`, in an empty folder."""
    # a gigabyte, which must not stay as pytest's folders do
    with tempfile.TemporaryDirectory() as name:
        folder, environment = Path(name, "empty"), Path(name, "env")
        folder.mkdir()
        (wheel,) = DIST.glob("*.whl")
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
        subprocess.run(
            [sys.executable, "-m", "pip", "--python", environment, "install", "-q"]
            + ["-c", DIST / "constraints.txt", f"{wheel}[all]"],
            env={**os.environ, "PIP_NO_COMPILE": "1"},
            check=True,
            timeout=INSTALL_GUARD_S,
        )

        def start(*arguments):
            return subprocess.Popen(
                [environment / "bin" / "mecazen", *arguments],
                cwd=folder,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )

        yield start


def said(process: subprocess.Popen[str], code: int = 0) -> str:
    """Return what a command printed, or its error."""
    out, err = process.communicate(timeout=COMMAND_GUARD_S)
    assert process.returncode == code, out + err
    return out or err


def test_it_has_its_version_and_names_the_extra_of_a_command_that_is_missing(away):
    assert said(away("--version")) == f"mecazen {PROJECT['version']}\n"
    assert "pip install 'mecazen[studies]'" in said(away("experiment", "table2"), 2)


def test_it_simulates_as_in_the_clone_to_the_last_bit(away):
    there, here = (msgspec.json.decode(out) for out in (said(away(*SHORT)), mecazen(*SHORT).stdout))
    assert there["trajectory_sha256"] == here["trajectory_sha256"]


def test_a_new_follower_runs_in_a_folder_of_ones_own(away):
    said(away("new", "follower", "mine"))
    program = ("--set", "programs.follower=mine.py:Mine")
    result = msgspec.json.decode(said(away(*SHORT, *program)))
    # a proportional law lags by speed over gain, 0.2/1.5 m
    assert result["d_err_m"] < 0.15


def test_everything_starts_and_is_shown_and_ends_by_ctrl_c(away):
    settings = (*private_router(), "viewer.web_port=0", "viewer.data_port=0")
    bus = load_scenario(scenario_path("side"), parse_settings(settings)).bus
    running = away("up", "side", *options(settings))
    try:
        while "Watch it at" not in (line := running.stdout.readline()):
            assert line, running.stderr.read()
        assert "position" in said(away(*tools(bus), "echo", "odom", "--count", "1"))
    finally:
        running.send_signal(signal.SIGINT)
    assert said(running).endswith("all processes have ended\n")
