"""A stack that speaks rmw_zenoh, and the ROS side: one of each for a module."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest
from harness import ROOT
from ros.node import RawNode
from stack import Stack

PEERS = ROOT / ".venv-ros" / "bin" / "python"


class Peer:
    """The process that runs `peer.py`; `peer(name, *arguments)` calls a function of it."""

    def __init__(self, endpoint: str, mode: str) -> None:
        assert PEERS.exists(), "`make test-ros` prepares .venv-ros"
        port = endpoint.rpartition(":")[2]
        self._process = subprocess.Popen(
            [PEERS, ROOT / "tests" / "ros" / "peer.py", port, ROOT / "ros2"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={"ROS_DISTRO": "jazzy", "ZENOH_CONFIG_OVERRIDE": f'mode="{mode}"'},
        )

    def __call__(self, name: str, *arguments: object) -> Any:
        print(json.dumps([name, *arguments]), file=self._process.stdin, flush=True)
        answer = json.loads(self._process.stdout.readline())
        assert not (isinstance(answer, dict) and "error" in answer), answer["error"]
        return answer

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture(scope="module")
def resources() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture(scope="module")
def start_peer(resources):
    """Start a ROS side at an endpoint."""
    return lambda endpoint, mode="peer": resources.enter_context(closing(Peer(endpoint, mode)))


@pytest.fixture(scope="module")
def raw_node(resources):
    """Open a node by hand at an endpoint."""
    return lambda endpoint, **more: resources.enter_context(closing(RawNode(endpoint, **more)))


@pytest.fixture(scope="module")
def up(resources):
    """Start a scenario that speaks rmw_zenoh."""

    def start(path, *settings: str) -> Stack:
        running = resources.enter_context(closing(Stack(path, ("bus.ros2=true", *settings))))
        running.start()
        return running

    return start
