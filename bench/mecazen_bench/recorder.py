"""The recorder: its writing speed, and its processor time during a simulation."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.keys import topic_of
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Message
from mecazen_recorder.reader import Recording
from mecazen_recorder.replay import publish
from mecazen_recorder.writer import RecordingWriter
from mecazen_tools.simulate import simulate

from mecazen_bench.harness import Figure, Group
from mecazen_bench.stack import SCENARIOS, Usage, running, spin_until

DURATION_S = 10.0
SPEED = 10.0
"""Speed of the replay that the recorder receives, relative to real time."""


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Write the messages of a run again, in this process and in the recorder's process."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "run.mcap"
        settings = (
            f"sim.duration_s={duration_s}",
            'services=["physics", "controller", "target", "follower", "recorder"]',
            f'recorder.file="{file}"',
        )
        simulate(load_scenario(SCENARIOS / "back.toml", parse_settings(settings)), "back")
        recording = Recording(file)
        rows = {"writer only": _write(recording), "as a process": _receive(recording)}
    how = f"messages of {duration_s:g} s; as a process: replayed at {SPEED:g} × real time"
    return [Group("Recorder: scenario back", how, rows)]


def _write(recording: Recording) -> dict[str, Figure]:
    samples = list(recording.samples())
    messages: list[Message] = [
        sample.message(topic.type) for sample in samples if (topic := topic_of(sample.key))
    ]
    path = recording.path.with_name("writer.mcap")
    writer = RecordingWriter(path)
    begin = time.perf_counter()
    for sample, message in zip(samples, messages, strict=True):
        writer.write(sample.key, message, sample.stamp, sample.time_ns)
    writer.close()
    elapsed = time.perf_counter() - begin
    return {
        "messages/s": Figure(len(samples) / elapsed, "more"),
        "bytes/message": Figure(path.stat().st_size / len(samples), "less"),
    }


def _receive(recording: Recording) -> dict[str, Figure]:
    path = recording.path.with_name("process.mcap")
    with (
        running("back", f'recorder.file="{path}"', services=["recorder"]) as stack,
        closing(ZenohBus(stack.scenario.bus)) as bus,
    ):
        bus.declare_alive("bench")
        started = lambda: "recorder" in bus.presence.names  # noqa: E731
        spin_until(bus, started, "the recorder does not start")
        usage = Usage({"recorder": stack.processes()["recorder"]})
        begin = time.perf_counter()
        published = publish(recording, bus, speed=SPEED)
        elapsed = time.perf_counter() - begin
        cpu = usage.core_percent()["recorder"]
    return {
        "messages/s": Figure(published / elapsed, "more"),
        "% of a core": Figure(cpu, "less"),
        "lost": Figure(_count(recording) - _count(Recording(path)), "less"),
    }


def _count(recording: Recording) -> int:
    # only one file contains the recorder's own diagnostics
    own = keys.diagnostics("recorder").key
    return sum(sample.key != own for sample in recording.samples())
