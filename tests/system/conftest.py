"""Whole systems as processes, each test's at a port and a namespace of its own."""

import pytest
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
