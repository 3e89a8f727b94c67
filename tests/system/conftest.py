"""Whole systems as processes, each test's at a port and a namespace of its own."""

import subprocess
import sys

import pytest
from harness import ROOT
from mecazen_tools import certificates
from mecazen_tools.cli import main
from stack import Stack


@pytest.fixture
def stack():
    """Make stacks of processes that end with the test."""
    stacks = []

    def make(path, *settings):
        stacks.append(Stack(path, settings))
        return stacks[-1]

    yield make
    for made in stacks:
        made.close()


@pytest.fixture
def access_control(tmp_path):
    """Settings of a stack with TLS and access control."""
    certificates.create(tmp_path / "keys")
    secure = ROOT / "configs" / "zenoh" / "secure.json5"
    return f"bus.zenoh_config={secure}", f"bus.keys={tmp_path / 'keys'}"


@pytest.fixture
def here(monkeypatch, capsys):
    """Run a command as `harness.mecazen` does, but in this process, which has started already."""

    def run(*arguments, **variables):
        for name, value in {"COLUMNS": "160", "TERM": "dumb", **variables}.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys, "argv", ["mecazen", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return subprocess.CompletedProcess(arguments, ended.value.code or 0, *capsys.readouterr())

    return run
