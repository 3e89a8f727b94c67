"""Subscribes to a bus and writes its samples."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import nullcontext, suppress
from functools import partial
from typing import Any, NamedTuple

from mecazen import keys
from mecazen.bus import Bus, StoppedError
from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import Sent, ZenohBus, bytes_of
from mecazen.config import RecorderConfig
from mecazen.errors import BusError, set_up_log
from mecazen.keys import Topic, call_of_robot, of_robot, resolve
from mecazen.loading import renamed_in, robots_in
from mecazen.messages import Empty, Message
from mecazen.robots import split_key
from mecazen.runtime.pace import RECORD, declare_every
from mecazen.runtime.process import stop_on_signals
from mecazen.runtime.readiness import READY
from mecazen.urdf import RobotDescription, ask_description
from mecazen.wire import NS_PER_S, RefusedError, Stamp, decode

from mecazen_recorder.runs import FirstSamples
from mecazen_recorder.writer import SYNC_S, RecordingWriter

BACKLOG_BYTES = 64 << 20
"""Size of the queue of samples to write; samples beyond it are dropped and counted."""
ANSWER_S = 1.0
"""Timeout of queries, during which samples wait."""
MAX_OTHER_RUNS = 100
"""Maximum number of runs in a file that physics has not named, since any client can invent runs."""

logger = logging.getLogger(__name__)


class _Answer(NamedTuple):
    """The answer to queries about a run."""

    run: int | None
    """The run that physics simulates, if physics answers."""
    scenario: str | None
    """The configuration in TOML, if known."""
    descriptions: dict[str, RobotDescription]
    """Descriptions of robots not described before, by name."""


class Recorder:
    """Records every sample of some keys, as docs/recording.md specifies.

    On a bus within a process the diagnostics of `services` are recorded. `scenario` returns the
    configuration of a new run in TOML, or None; the robot names in it replace those of `robots`.
    Samples of `topics` are decoded; samples of other keys are stored unchanged.

    Raises:
        RecordingError: The file can't be written.
        BusError: A key is not a valid key expression.
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
        self._topic_keys = {key: topic for topic, key in bus.renamed.items()}
        """Keys of topics by their keys on the bus, where these differ."""
        self.now = Stamp(0, 0, 0)
        """The newest tick."""
        self._runs: set[int] = set()
        self._other_runs = 0
        """Number of runs in `_runs` that physics has not named."""
        self._firsts = FirstSamples(lambda key: bus.refuse(key, "no second sample of its run"))
        self._asking = ThreadPoolExecutor(1)
        self._answer: Future[_Answer] | None = None
        """The pending answer about a run; until it arrives, samples wait here."""
        self._asked = self.now
        """The run that the last query was about ..."""
        self._asked_for = 0
        """... and the number of samples that had arrived before it and waited."""
        self._waiting: deque[Sent] = deque()
        self._waiting_bytes, self._most_bytes = 0, BACKLOG_BYTES
        self._described: set[str] = set()
        for key in config.keys:
            includes(key, key)  # a wrong key is an error before the file exists
        # re-computation needs the changes of parameters
        recorded = (*config.keys, keys.PARAMETERS.key)
        self.writer = RecordingWriter(config.path, config.encoding)
        if isinstance(bus, ZenohBus):
            for index, key in enumerate(recorded):
                take = partial(self._take_bytes, recorded[:index])
                bus.subscribe_bytes(key, take, BACKLOG_BYTES)
        else:
            heard = [topic for topic in topics if "*" not in topic.key]
            heard += map(keys.diagnostics, services)
            for robot in dict.fromkeys(("", *robots)):
                for topic in heard:
                    if topic.shared and robot:
                        continue
                    on_bus = of_robot(topic, robot)
                    if any(includes(key, bus.key_of(on_bus)) for key in recorded):
                        bus.subscribe(on_bus, partial(self._take, bus.key_of(on_bus)), every=True)

    def run(self) -> None:
        """Record until the bus is stopped."""
        while True:
            self._bus.spin_once(SYNC_S)
            self._go_on()
            self.writer.sync_if_due()

    def close(self) -> None:
        """Record the waiting samples, and finish the file."""
        self._most_bytes = 0  # later runs begin without a query to another process
        while self._answer is not None:
            wait([self._answer])
            self._go_on()
        self._asking.shutdown()
        self._firsts.close()
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
            return  # another subscription receives the sample as well
        self._go_on()
        sample = key, payload, encoding, attachment
        if self._answer is None:
            self._record(sample)
        elif self._waiting_bytes < self._most_bytes:
            self._waiting.append(sample)
            self._waiting_bytes += bytes_of(sample)
        else:
            self._bus.refuse(key, f"more than {self._most_bytes} bytes wait")

    def _go_on(self) -> None:
        """Record the samples that wait for an answer, once it has arrived."""
        while self._answer is not None and self._answer.done():
            answer, self._answer = self._answer.result(), None
            self._admit(answer)
            asked_for = self._asked_for
            while self._waiting and self._answer is None:
                sample = self._waiting.popleft()
                self._waiting_bytes -= bytes_of(sample)
                self._record(sample, answer if asked_for > 0 else None)
                asked_for -= 1

    def _admit(self, answer: _Answer) -> None:
        """Begin the run of the query if physics names it or the file has room for other runs."""
        if answer.run != self._asked.run:
            if self._other_runs >= MAX_OTHER_RUNS:
                return
            self._other_runs += 1
        self._runs.add(self._asked.run)
        self.now = self._asked
        self._begin(answer)

    def _record(self, sample: Sent, answer: _Answer | None = None) -> None:
        """Record a sample; `answer` is the answer to a query that was sent after its arrival."""
        key, payload, encoding, attachment = sample
        try:
            topic = self._topic_of(key)
            stamp = None
            with suppress(RefusedError) if topic is None else nullcontext():
                # on keys outside the table the attachment may be anything
                stamp = None if attachment is None else Stamp.unpack(attachment)
            if stamp is not None and stamp.run not in self._runs:
                self._meet(stamp, sample, answer)
            elif topic is None:
                self._note(stamp)
                self.writer.write_bytes(key, payload, encoding, stamp, self.now.time_ns)
            else:
                self._take(key, decode(payload, topic.type, encoding), stamp)
        except RefusedError as refusal:
            self._bus.refuse(key, str(refusal))

    def _meet(self, stamp: Stamp, sample: Sent, answer: _Answer | None) -> None:
        """Send a query about a run at its second sample; later samples wait for the answer."""
        is_other = answer is not None and answer.run != stamp.run
        if is_other and self._other_runs >= MAX_OTHER_RUNS:
            raise RefusedError(f"a file holds at most {MAX_OTHER_RUNS} runs unknown to physics")
        first = self._firsts.second(stamp.run, sample)
        if first is None:
            return
        self._waiting.extendleft((sample, first))
        self._waiting_bytes += bytes_of(sample) + bytes_of(first)
        self._asked, self._asked_for = stamp, len(self._waiting)
        calls = [call_of_robot(keys.ROBOT_DESCRIPTION, robot) for robot in self._robots]
        served = any(map(self._bus.serves, calls))
        if self._most_bytes and not served:
            self._answer = self._asking.submit(self._ask)
        else:
            self._answer = Future()
            self._answer.set_result(self._ask() if served else _Answer(None, None, {}))

    def _take(self, key: str, message: Message, stamp: Stamp | None) -> None:
        self._note(stamp)
        time_ns = self.now.time_ns if stamp is None else stamp.time_ns
        self.writer.write(key, message, stamp, time_ns)

    def _topic_of(self, key: str) -> Topic[Message] | None:
        """Return the topic of a key, which may be in the namespace of one of several robots."""
        name = split_key(self._topic_keys.get(key, key), self._robots)[1]
        robot, topic = resolve(name, keys.TOPICS)  # robots of other scenarios are unknown
        return self._topics.get(name) or (None if robot else topic)

    def _note(self, stamp: Stamp | None) -> None:
        """Note the newest tick, and write the record of a new run."""
        if stamp is None:
            return
        if stamp.run not in self._runs:  # within a process every publisher is trusted
            self._runs.add(stamp.run)
            self.now = stamp
            self._begin(self._ask())
        elif stamp.run == self.now.run:
            self.now = max(self.now, stamp)

    def _begin(self, answer: _Answer) -> None:
        """Write the record of the newest run, and attach each robot's description once."""
        self.writer.write_run(self.now, answer.scenario)
        if answer.scenario is not None:
            self._robots = robots_in(answer.scenario)
            renamed = renamed_in(answer.scenario)
            self._topic_keys = {key: topic for topic, key in renamed.items()}
        for robot, description in answer.descriptions.items():
            self.writer.write_description(description, robot)
            self._described.add(robot)

    def _ask(self) -> _Answer:
        """Query scenario, run and robots; in a thread over Zenoh, since answers may take long."""
        scenario, run = self._scenario(), None
        with suppress(BusError):  # no simulation runs, as in a replay of another recording
            run = self._bus.call(keys.SIM_STATE, Empty(), ANSWER_S).run
        robots = self._robots if scenario is None else robots_in(scenario)
        descriptions = {}
        for robot in [one for one in robots if one not in self._described]:
            with suppress(BusError):
                descriptions[robot] = ask_description(self._bus, robot, ANSWER_S)
        return _Answer(run, scenario, descriptions)


def record_until_stopped(bus: ZenohBus, config: RecorderConfig) -> int:
    """Record on a tool's bus until a signal; return the number of samples; raises as `Recorder`."""

    def scenario() -> str | None:
        try:
            return bus.call(keys.SIM_SCENARIO, Empty(), ANSWER_S).data
        except BusError:
            return None  # no simulation runs, as in a replay

    set_up_log("recorder", lambda: recorder.now.time_ns / NS_PER_S)
    recorder = Recorder(bus, config, (), scenario)
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
        recorder.close()
    return recorder.writer.count
