"""The recorder: how fast it writes, and what it needs beside a simulation."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import MecazenError
from mecazen.keys import topic_of
from mecazen.loading import load_scenario
from mecazen.messages import Message
from mecazen_recorder.config import Encoding
from mecazen_recorder.reader import Recording
from mecazen_recorder.replay import publish
from mecazen_recorder.writer import RecordingWriter
from mecazen_tools.processes import Supervisor, private_router
from mecazen_tools.simulate import simulate

from mecazen_bench.figures import Figure, Group, Row
from mecazen_bench.scenarios import SCENARIOS

DURATION_S = 10.0
SPEED = 10.0
"""Of the replay that the recorder listens to, times real time."""
START_S = 20.0
ENCODINGS: tuple[Encoding, ...] = ("cdr", "json")


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Write a run of the scenario `back` again, alone and as another process hears it."""
    with TemporaryDirectory() as folder:
        recording = _recording(Path(folder) / "run.mcap", duration_s)
        rows = [
            *(_write(recording, encoding) for encoding in ENCODINGS),
            *(_listen(recording, encoding) for encoding in ENCODINGS),
        ]
    how = (
        f"the messages of {duration_s:g} s; as a process: replayed at {SPEED:g} × real time by "
        "another"
    )
    return [Group("Recorder: scenario back", how, tuple(rows))]


def _recording(path: Path, duration_s: float) -> Recording:
    scenario = load_scenario(
        SCENARIOS / "back.toml",
        (
            f"sim.duration_s={duration_s}",
            'services=["physics", "controller", "target", "follower", "recorder"]',
            f'recorder.file="{path}"',
        ),
    )
    simulate(scenario, "back")
    return Recording(path)


def _write(recording: Recording, encoding: Encoding) -> Row:
    samples = list(recording.samples())
    messages: list[Message] = [
        sample.message(topic.type) for sample in samples if (topic := topic_of(sample.key))
    ]
    path = recording.path.with_name(f"alone-{encoding}.mcap")
    writer = RecordingWriter(path, encoding)
    begin = time.perf_counter()
    for sample, message in zip(samples, messages, strict=True):
        writer.write(sample.key, message, sample.stamp, sample.time_ns)
    writer.close()
    elapsed = time.perf_counter() - begin
    figures = {
        "messages/s": Figure.of(len(samples) / elapsed, "more"),
        "bytes/message": Figure.of(path.stat().st_size / len(samples), "less"),
    }
    return Row(f"written alone, {encoding}", figures)


def _listen(recording: Recording, encoding: Encoding) -> Row:
    """Replay to a recorder's process.

    Raises:
        MecazenError: It does not start.
    """
    path = recording.path.with_name(f"{encoding}.mcap")
    settings = (
        *private_router(),
        f'recorder.file="{path}"',
        f"recorder.encoding={encoding}",
    )
    supervisor = Supervisor(SCENARIOS / "back.toml", settings)
    try:
        supervisor.start_router()
        supervisor.start("recorder")
        scenario = load_scenario(SCENARIOS / "back.toml", settings)
        with closing(ZenohBus(scenario.bus, lossless=True)) as bus:
            bus.declare_alive("bench")
            deadline = time.monotonic() + START_S
            while "recorder" not in bus.presence.names:
                if time.monotonic() > deadline:
                    raise MecazenError("the recorder does not start")
                bus.spin_once(0.1)
            process = psutil.Process(supervisor.pids["recorder"])
            begin, used = time.perf_counter(), process.cpu_times()
            published = publish(recording, bus, speed=SPEED)
            elapsed, now = time.perf_counter() - begin, process.cpu_times()
    finally:
        supervisor.stop()
    lost = _count(recording) - _count(Recording(path))
    cpu = now.user + now.system - used.user - used.system
    figures = {
        "messages/s": Figure.of(published / elapsed, "more"),
        "CPU share": Figure.of(cpu / elapsed, "less"),
        "lost": Figure.of(lost, "less"),
    }
    return Row(f"as a process, {encoding}", figures)


def _count(recording: Recording) -> int:
    # a recorder says of itself how it is, while it hears what another has said
    own = keys.diagnostics("recorder").key
    return sum(sample.key != own for sample in recording.samples())
