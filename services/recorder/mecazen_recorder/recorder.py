"""Subscribes to a bus and writes its samples."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from mecazen import keys, log
from mecazen.bus import Bus, StoppedError
from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import join_key, split_key
from mecazen.description import ask_description
from mecazen.errors import BusError
from mecazen.keys import Topic, topic_of
from mecazen.loading import robots_in
from mecazen.messages import Empty, Message
from mecazen.runtime.router import stop_on_signals
from mecazen.wire import NS_PER_S, RefusedError, Stamp, decode

from mecazen_recorder.config import RecorderConfig
from mecazen_recorder.writer import SYNC_S, RecordingWriter

BYTES_PER_MIB = 1 << 20
ANSWER_S = 1.0
"""Timeout of queries, during which samples queue up."""

logger = logging.getLogger(__name__)


class Recorder:
    """Records every sample of some keys, as docs/recording.md says.

    On a bus within a process the diagnostics of `services` are recorded. `scenario` returns the
    configuration of a new run in TOML, or None; the names in it replace those of `robots`.
    `topics` can be decoded; samples of other keys are kept as they come.

    Raises:
        RecordingError: The file can't be written.
        BusError: A key is no key expression.
    """

    def __init__(
        self,
        bus: Bus,
        config: RecorderConfig,
        services: Sequence[str],
        scenario: Callable[[], str | None],
        robots: Sequence[str] = ("",),
        topics: Sequence[Topic[Any]] = keys.TOPICS,
    ) -> None:
        self._bus = bus
        self._scenario = scenario
        self._robots = robots
        self._topics = {topic.key: topic for topic in topics}
        self.now = Stamp(0, 0, 0)
        """The newest tick."""
        self._runs: set[int] = set()
        self._described: set[str] = set()
        for key in config.keys:
            includes(key, key)  # a wrong key is an error before the file exists
        # without what was changed nothing can be computed anew
        recorded = (*config.keys, keys.PARAMETERS.key)
        self.writer = RecordingWriter(Path(config.file), config.encoding)
        if isinstance(bus, ZenohBus):
            for index, key in enumerate(recorded):
                take = partial(self._take_bytes, recorded[:index])
                bus.subscribe_bytes(key, take, config.backlog_mib * BYTES_PER_MIB)
        else:
            heard = [topic for topic in topics if "*" not in topic.key]
            heard += map(keys.diagnostics, services)
            for robot in dict.fromkeys(("", *robots)):
                for topic in heard:
                    if topic.shared and robot:
                        continue
                    name = join_key(topic.key, robot)
                    if any(includes(key, name) for key in recorded):
                        take = partial(self._take, name)
                        bus.namespaced(robot).subscribe(topic, take, every=True)

    def run(self) -> None:
        """Record until the bus is stopped."""
        while True:
            self._bus.spin_once(SYNC_S)
            self.writer.sync_if_due()

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()

    def _take_bytes(
        self,
        others: Sequence[str],
        key: str,
        payload: bytes,
        encoding: str,
        attachment: bytes | None,
    ) -> None:
        if any(includes(expression, key) for expression in others):
            return  # another subscription brings it too
        try:
            topic = self._topic_of(key)
            if topic is None:
                stamp = None
                with suppress(RefusedError):  # on keys outside the table it may be anything
                    stamp = None if attachment is None else Stamp.unpack(attachment)
                self._note(stamp)
                topic = self._topic_of(key)  # the new run may have this robot
            if topic is None:
                self.writer.write_bytes(key, payload, encoding, stamp, self.now.time_ns)
            else:
                stamp = None if attachment is None else Stamp.unpack(attachment)
                self._take(key, decode(payload, topic.type, encoding), stamp)
        except RefusedError as refusal:
            self._bus.refuse(key, str(refusal))

    def _take(self, key: str, message: Message, stamp: Stamp | None) -> None:
        self._note(stamp)
        time_ns = self.now.time_ns if stamp is None else stamp.time_ns
        self.writer.write(key, message, stamp, time_ns)

    def _topic_of(self, key: str) -> Topic[Message] | None:
        """Return the topic of a key, which may be in the namespace of one of several robots."""
        name = split_key(key, self._robots)[1]
        return self._topics.get(name) or topic_of(name)

    def _note(self, stamp: Stamp | None) -> None:
        """Note the newest tick, and write the record of a new run."""
        if stamp is None:
            return
        if stamp.run not in self._runs:
            self._runs.add(stamp.run)
            scenario = self._scenario()
            self.writer.write_run(stamp, scenario)
            if scenario is not None:
                self._robots = robots_in(scenario)
            self.now = stamp
            self._describe()
        elif stamp.run == self.now.run:
            self.now = max(self.now, stamp)

    def _describe(self) -> None:
        """Attach the description of each robot, once, as soon as physics answers."""
        for robot in [one for one in self._robots if one not in self._described]:
            with suppress(BusError):  # nobody simulates, as in a replay of another recording
                description = ask_description(self._bus.namespaced(robot), ANSWER_S)
                self.writer.write_description(description, robot)
                self._described.add(robot)


def record_until_stopped(bus: ZenohBus, config: RecorderConfig) -> int:
    """Record on a tool's bus until a signal; return the number of samples; raises as `Recorder`."""

    def scenario() -> str | None:
        try:
            return bus.call(keys.SIM_SCENARIO, Empty(), ANSWER_S).data
        except BusError:
            return None  # nobody simulates, as in a replay

    log.set_up("recorder", lambda: recorder.now.time_ns / NS_PER_S)
    recorder = Recorder(bus, config, (), scenario)
    stop_on_signals(bus.stop)
    try:
        for name in ("record", "record/ready"):
            bus.declare_alive(name)
        logger.info("msg=started file=%s", config.file)
        recorder.run()
    except StoppedError:
        pass
    finally:
        recorder.close()
    return recorder.writer.count
