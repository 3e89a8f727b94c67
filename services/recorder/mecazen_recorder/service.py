"""The recorder: writes samples of a bus to an MCAP file (docs/recording.md), and publishes them."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
from mecazen import keys
from mecazen.bus import Bus, StoppedError
from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import RecorderConfig, Scenario
from mecazen.errors import BusError, ConfigError, set_up_log
from mecazen.keys import Topic, of_robot, resolve
from mecazen.loading import renamed_in, robots_in, to_toml
from mecazen.messages import Empty, Message
from mecazen.programs import graph_of
from mecazen.robots import split_key
from mecazen.runtime.observer import Observer
from mecazen.runtime.pace import READY, RECORD, declare_every
from mecazen.runtime.process import stop_on_signals
from mecazen.wire import NS_PER_S, RefusedError, Stamp, decode
from mecazen_ros.topics import TF

from mecazen_recorder.frames import RobotFrames
from mecazen_recorder.reader import Recording, read_scenario
from mecazen_recorder.writer import FLUSH_S, RecordingError, RecordingWriter

BACKLOG_BYTES = 64 << 20
"""Size of the queue of samples to write; samples beyond it are dropped and counted."""
ANSWER_S = 1.0
"""Timeout of the query for the configuration of a run, during which samples wait."""
LINGER_S = 3.0
"""At the end, samples are recorded for at most this long ..."""
QUIET_S = 0.3
"""... or until none has come for this long."""

logger = logging.getLogger(__name__)


class Recorder:
    """Records every sample of some keys.

    Samples of `topics` are decoded; samples of other keys are stored unchanged. On a bus within a
    process, the topics of `robots` and the diagnostics of `services` are recorded. `scenario`
    returns the configuration of a new run in TOML, or None.

    Raises:
        RecordingError: The file can't be written.
        BusError: A key is not a valid key expression.
    """

    def __init__(
        self,
        bus: Bus,
        config: RecorderConfig,
        scenario: Callable[[], str | None],
        topics: Sequence[Topic[Any]] = keys.TOPICS,
        robots: Sequence[str] = ("",),
        services: Sequence[str] = (),
    ) -> None:
        self.count = 0
        self.now = Stamp(0, 0, 0)
        """The newest tick."""
        self._bus = bus
        self._scenario = scenario
        self._robots = robots
        self._topics = {topic.key: topic for topic in topics}
        self._topic_keys = {key: topic for topic, key in bus.renamed.items()}
        """Keys of topics by their keys on the bus, where these differ."""
        self._runs: set[int] = set()
        self._frames: dict[str, RobotFrames] = {}
        for key in config.keys:
            includes(key, key)  # a wrong key is an error before the file exists
        # re-computation needs the changes of parameters
        recorded = (*config.keys, keys.PARAMETERS.key)
        self.writer = RecordingWriter(config.path)
        if isinstance(bus, ZenohBus):
            for index, key in enumerate(recorded):
                take = partial(self._take_bytes, recorded[:index])
                bus.subscribe_bytes(key, take, BACKLOG_BYTES)
            return
        plain = [topic for topic in topics if "*" not in topic.key]
        for topic in (*plain, *map(keys.diagnostics, services)):
            for on_bus in dict.fromkeys(of_robot(topic, robot) for robot in ("", *robots)):
                key = bus.key_of(on_bus)
                if any(includes(expression, key) for expression in recorded):
                    bus.subscribe(on_bus, partial(self._take, key, on_bus), every=True)

    def run(self) -> None:
        """Record until the bus is stopped."""
        while True:
            self._bus.spin_once(FLUSH_S)
            self.writer.flush_if_due()

    def _take_bytes(
        self,
        earlier: Sequence[str],
        key: str,
        payload: bytes,
        encoding: str,
        attachment: bytes | None,
    ) -> None:
        """Record a sample from Zenoh, unless the subscription of an earlier expression has it."""
        if any(includes(expression, key) for expression in earlier):
            return
        topic = self._topic_of(key)
        try:
            if topic is not None:
                stamp = None if attachment is None else Stamp.unpack(attachment)
                self._take(key, topic, decode(payload, topic.type, encoding), stamp)
                return
            stamp = None
            if attachment is not None:
                with suppress(RefusedError):  # clients may attach anything to keys of their own
                    stamp = Stamp.unpack(attachment)
            self._note(stamp)
            self.writer.write_bytes(key, payload, encoding, stamp, self.now.time_ns)
            self.count += 1
        except RefusedError as refusal:
            self._bus.refuse(key, str(refusal))

    def _take(self, key: str, topic: Topic[Any], message: Message, stamp: Stamp | None) -> None:
        self._note(stamp)
        time_ns = self.now.time_ns if stamp is None else stamp.time_ns
        self.writer.write(key, message, stamp, time_ns)
        self.count += 1
        if stamp is not None and stamp.run != self.now.run:
            return  # a late sample of an ended run moves no robot of this one
        frames = self._frames.get(split_key(key, self._robots)[0])
        changed = None if frames is None else frames.update(topic.name, message, time_ns)
        if changed is not None:
            self.writer.write(TF, changed, stamp, time_ns)

    def _topic_of(self, key: str) -> Topic[Any] | None:
        """Return the topic of a key, which may be in the namespace of one of several robots."""
        name = split_key(self._topic_keys.get(key, key), self._robots)[1]
        robot, topic = resolve(name, keys.TOPICS)  # robots of other scenarios are unknown
        return self._topics.get(name) or (None if robot else topic)

    def _note(self, stamp: Stamp | None) -> None:
        """Note the newest tick; a stamp of another run begins that run."""
        if stamp is None:
            return
        if stamp.run not in self._runs:
            self.now = stamp
            self._begin()
        elif stamp.run == self.now.run:
            self.now = max(self.now, stamp)

    def _begin(self) -> None:
        """Write the configuration of the newest run, and the descriptions of its robots."""
        self._runs.add(self.now.run)
        text = self._scenario()
        self.writer.write_run(self.now, text)
        self._frames = {}
        if text is not None:
            self._robots = robots_in(text)
            self._topic_keys = {key: topic for topic, key in renamed_in(text).items()}
            try:
                scenario = read_scenario(text, self.writer.path)
                self._frames = {robot: RobotFrames(scenario, robot) for robot in scenario.names}
            except (ConfigError, ValueError) as error:
                logger.warning("msg=%r", f"recorded without frames: {error}")
        for frames in self._frames.values():
            for topic, message in frames.description():
                self.writer.write(topic, message, self.now, self.now.time_ns)


class RecorderService(Observer):
    """Records the services of a scenario."""

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        super().__init__(name, bus, scenario)
        config = scenario.recorder
        if scenario.sim.mode == "real_time":  # the service may have been restarted
            config = msgspec.structs.replace(config, file=free_name(config.path))
        topics, toml = graph_of(scenario).topics, partial(to_toml, scenario)
        self.recorder = Recorder(bus, config, toml, topics, scenario.names, scenario.services)
        self.subscribe(keys.CLOCK, lambda *_: None)  # the base class notes the newest tick

    def reset(self, seed: int) -> None:
        """Continue: one file holds every run."""

    def run(self) -> None:
        if self.scenario.sim.mode == "lockstep":
            declare_every(self.bus, self.name)
        self.recorder.run()

    def close(self) -> None:
        """Record the samples that are still in transit, and finish the file."""
        end = time.monotonic() + LINGER_S
        try:
            while time.monotonic() < end and self.bus.spin_once(QUIET_S):
                pass
        except StoppedError:
            pass  # stopped a second time: finish at once
        finally:
            self.recorder.writer.close()

    def diagnostics(self) -> dict[str, object]:
        return {"recorded": self.recorder.count}


def free_name(path: Path) -> Path:
    """Return `run.mcap`, or the first of `run-2.mcap`, `run-3.mcap`, … that does not exist."""
    if not path.exists():
        return path
    names = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    free = next(name for name in names if not name.exists())
    logger.warning("msg=%r", f"{path} exists already; this recording is {free}")
    return free


def record_until_stopped(bus: ZenohBus, config: RecorderConfig) -> int:
    """Record on a tool's bus until a signal; return the number of samples; raises as `Recorder`."""

    def scenario() -> str | None:
        try:
            return bus.call(keys.SIM_SCENARIO, Empty(), ANSWER_S).data
        except BusError:
            return None  # no simulation runs, as in a replay

    recorder: Recorder | None = None  # which may log while it is made
    set_up_log("recorder", lambda: recorder.now.time_ns / NS_PER_S if recorder else 0.0)
    recorder = Recorder(bus, config, scenario)
    stop_on_signals(bus.stop)
    try:
        bus.presence.known = ()
        for name in (RECORD, f"{RECORD}/{READY}"):
            bus.declare_alive(name)
        declare_every(bus, RECORD)
        logger.info("msg=started file=%s", config.path)
        recorder.run()
    except StoppedError:
        pass
    finally:
        recorder.writer.close()
    return recorder.count


def publish(
    recording: Recording,
    bus: ZenohBus,
    keys: Sequence[str] = ("**",),
    *,
    speed: float = 1.0,
    begin_ns: float = 0,
    end_ns: float = math.inf,
    turn: int = 0,
) -> int:
    """Publish the samples of some keys with their original stamps; return their number.

    `speed` is in simulated seconds per wall second; for the times see `Recording.samples`.
    `turn`, the number of earlier publications, is added to the numbers of the runs, since services
    drop ticks older than the newest tick of a run.

    Raises:
        RecordingError: The recording has no sample on these keys within these times, or the
            type of a sample does not match its key.
    """
    published, run = 0, None
    start_s, start_ns = 0.0, math.nan  # begin of the run
    for sample in recording.samples(begin_ns, end_ns):
        if not any(includes(expression, sample.key) for expression in keys):
            continue
        if recording.is_foreign and sample.kind is None:  # without content
            continue
        stamp = sample.stamp
        if math.isnan(start_ns) or (stamp is not None and stamp.run != run):
            start_s, start_ns = time.monotonic(), sample.time_ns
        if stamp is not None:
            run = stamp.run
            stamp = stamp._replace(run=(run + turn) % 2**32)
        due_s = start_s + (sample.time_ns - start_ns) / (speed * NS_PER_S)
        while (left_s := due_s - time.monotonic()) > 0.0:
            bus.spin_once(left_s)
        with recording.reading(sample):
            bus.put_bytes(sample.key, *sample._replace(stamp=stamp).as_published())
        published += 1
    if not published:
        raise RecordingError(f"{recording.path}: nothing on these keys in this time")
    return published
