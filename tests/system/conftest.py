"""Whole systems as processes, each test's at a port and a namespace of its own."""

import pytest
from harness import ROOT
from mecazen_tools import certificates
from stack import Stack


@pytest.fixture
def stack():
    """Make stacks of processes that end with the test."""
    stacks = []

    def make(path, *settings, **options):
        stacks.append(Stack(path, settings, **options))
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
