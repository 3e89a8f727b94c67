"""Recordings made in the test itself, and the commands as processes."""

from __future__ import annotations

import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from harness import mecazen
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen_recorder.writer import RecordingWriter
from recorder.ticks import stamp_of, tick, topic_named

GUARD_S = 30.0
"""Only ends a test that would hang."""


@pytest.fixture
def make_recording(tmp_path: Path) -> Callable[..., Path]:
    """Write a recording of some ticks; return its path."""

    def make(
        ticks: Sequence[int] = range(20), encoding: Any = "cdr", name: str = "made.mcap"
    ) -> Path:
        path = tmp_path / name
        writer = RecordingWriter(path, encoding)
        for number in ticks:
            stamp = stamp_of(number)
            for key, message in tick(number).items():
                writer.write(key, message, stamp, stamp.time_ns)
        writer.close()
        return path

    return make


class Net:
    """A namespace on the router: a bus in it, and the commands of the recorder."""

    def __init__(self, endpoint: str) -> None:
        self.tools = ("--connect", endpoint, "--namespace", f"test{secrets.token_hex(6)}")
        config = BusConfig(connect=(endpoint,), namespace=self.tools[3])
        self.bus = ZenohBus(config, lossless=True)
        self.processes: list[subprocess.Popen[str]] = []

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        """Start a command that goes on, and wait until it says that it has started."""
        process = self.start_quietly(*arguments)
        assert process.stderr is not None
        assert "msg=started" in process.stderr.readline()
        return process

    def start_quietly(self, *arguments: object) -> subprocess.Popen[str]:
        """Start a command that goes on and says nothing."""
        process = subprocess.Popen(
            [sys.executable, "-m", "mecazen_tools", *map(str, arguments), *self.tools],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.processes.append(process)
        return process

    def run(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        return mecazen(*arguments, *self.tools)

    def publish(self, ticks: Sequence[int], **run: int) -> None:
        """Publish some ticks, with a stamp each."""
        publishers = {key: self.bus.publisher(topic_named(key)) for key in tick(0)}
        for number in ticks:
            for key, message in tick(number).items():
                publishers[key].put(message, stamp_of(number, **run))

    def wait(self, condition: Callable[[], bool]) -> None:
        """Deliver what arrives until `condition` holds."""
        end = time.monotonic() + GUARD_S
        while not condition():
            assert time.monotonic() < end, "what was waited for did not come"
            self.bus.spin_once(0.05)

    def close(self) -> None:
        self.bus.close()
        for process in self.processes:
            process.kill()
            process.communicate()


def stop(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=GUARD_S)
    return process.returncode, out, err


@pytest.fixture
def net(router: str) -> Iterator[Net]:
    net = Net(router)
    yield net
    net.close()
