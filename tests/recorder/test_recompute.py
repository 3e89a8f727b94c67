"""A service with its recorded inputs gives its recorded outputs, or the difference is named."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w
from harness import assert_one_line, error_of, load_robot, mecazen
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import RecorderConfig, RobotConfig, Scenario, StartConfig
from mecazen.errors import ConfigError, MecazenError
from mecazen.keys import topic_of
from mecazen.loading import effective, to_toml
from mecazen.messages import Observation
from mecazen.programs import graph_of
from mecazen.runtime.host import Host
from mecazen.runtime.worker import Worker
from mecazen.schema import OutputFile
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_recorder.service import Recorder
from mecazen_recorder.writer import RecordingWriter
from recorder.conftest import TICK_NS, odometry, stamp_of

TICKS = 40
FRAME_TICKS = 4


@pytest.fixture
def mine(program):
    """The follower that is recorded."""
    return program()


@pytest.fixture
def recorded(tmp_path, mine):
    """Record followers that answer made-up odometry and frames; return the file."""

    def make(first=0, robots=()):
        path = tmp_path / "run.mcap"
        scenario = Scenario(robot=load_robot(), seed=3, robots=robots, programs={"follower": mine})
        bus = Bus()
        workers = [Worker(Host([("follower", r)], bus, scenario)) for r in scenario.names]
        config = RecorderConfig(file=OutputFile(path))
        recorder = Recorder(bus, config, lambda: to_toml(scenario), robots=scenario.names)
        for number in range(first, TICKS):
            stamp = stamp_of(number)
            for other, robot in enumerate(scenario.names):
                observation, odom = (keys.of_robot(t, robot) for t in (keys.OBSERVATION, keys.ODOM))
                if number % FRAME_TICKS == 0:
                    seen = Observation(poses=(odometry(1).pose,) * (number % 3))
                    bus.publisher(observation).put(seen, stamp)
                bus.publisher(odom).put(odometry(number / 7 + other), stamp)
            for worker in workers:
                while worker.step():
                    pass
        recorder.writer.close()
        return path

    return make


def rewritten(
    path: Path, keep: Callable[[int, str], bool] = lambda *_: True, *, turned: bool = False
) -> Path:
    """Return a copy of a recording without some samples, or with those of a tick turned round."""
    recording = Recording(path, trusted=True)
    samples = list(recording.samples())
    copy = path.with_name("copy.mcap")
    writer = RecordingWriter(copy)
    for run, scenario in recording.scenarios.items():
        writer.write_run(stamp_of(0, run), scenario)
    for sample in sorted(samples[:: -1 if turned else 1], key=lambda s: s.time_ns):
        if keep(sample.time_ns // TICK_NS, sample.key):
            message = sample.message(topic_of(sample.key).type)
            writer.write(sample.key, message, sample.stamp, sample.time_ns)
    writer.close()
    return copy


TWO = RobotConfig(name="one"), RobotConfig(name="two", start=StartConfig(y_m=1.5))


@pytest.mark.parametrize(
    ("answer", "field"),
    [
        ("Twist2D(x=self.sum, y=0.5 * (tick.time_ns == 12 * 10**7))", "linear.y"),
        ("Twist2D(x=self.sum + 1e-15 * (tick.time_ns >= 12 * 10**7))", "linear.x"),
        ("Twist2D(x=self.sum, yaw=-0.0 if tick.time_ns == 12 * 10**7 else 0.0)", "angular.z"),
    ],
)
def test_first_difference_is_named(program, recorded, answer, field):
    difference = recompute(Recording(recorded(), trusted=True), program(answer)).difference
    assert (difference.key, difference.time_ns, difference.field) == ("cmd_vel", 12 * 10**7, field)
    assert difference.recorded != difference.recomputed
    line = f"cmd_vel {field} at 0.12 s: recorded {difference.recorded}, recomputed"
    assert str(difference).startswith(line)


def test_a_missing_answer_is_a_difference(mine, recorded):
    path = recorded()
    gap = Recording(rewritten(path, lambda n, key: (n, key) != (20, "cmd_vel")), trusted=True)
    difference = recompute(gap, mine).difference
    assert str(difference) == (
        "cmd_vel at 0.2 s: recorded nothing, recomputed a message; does `mecazen info` show gaps?"
    )


def test_the_end_of_a_recording_may_be_incomplete(mine, recorded):
    path = recorded()
    for key in ("cmd_vel", "odom", "target/observation"):
        # the link of one process was behind the others' when the recorder was stopped
        copy = rewritten(path, lambda n, k, key=key: k != key or n < TICKS - 3)
        compared = recompute(Recording(copy, trusted=True), mine)
        assert compared.difference is None
        assert compared.counts["cmd_vel"] >= TICKS - 3
        copy.unlink()


def test_order_within_a_tick_is_free(mine, recorded):
    copy = rewritten(recorded(), turned=True)
    assert recompute(Recording(copy, trusted=True), mine).difference is None


@pytest.mark.parametrize(
    ("made", "program_name", "robot", "words"),
    [
        ({"robots": TWO}, "Mine", "", "follower: of which robot. --robot takes one or two"),
        ({"robots": TWO}, "Mine", "three", "'three': no such robot"),
        (
            {"first": 1},
            "Mine",
            "",
            "holds no run from its first tick; `mecazen sim reset` begins one",
        ),
        (
            {},
            "physics",
            "",
            "is no node with recorded inputs; `mecazen simulate` runs the rest again",
        ),
        ({}, "Other", "", r"holds nothing that .*Other publishes"),
    ],
)
def test_impossible_recomputations_are_one_line(
    program, recorded, made, program_name, robot, words
):
    name = program(kind=program_name) if program_name.istitle() else program_name
    with pytest.raises(MecazenError, match=words):
        recompute(Recording(recorded(**made), trusted=True), name, robot)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"services": ["physics", "{file}:Evil"]}, "services.1: got '/"),
        ({"programs": {"follower": "{file}:Evil"}}, "would run its programs {file}:Evil"),
        ({"follower": {"estimator": "{file}:Evil"}}, "unknown estimator '{file}:Evil'"),
        ({"robots": [{"name": "a", "programs": {"follower": "{file}:Evil"}}]}, "unknown key"),
        ({"robot": "/dev/zero"}, "robot would be read from another file"),
        ({"world": {"map": "/dev/zero"}}, "world would be read from another file"),
        ({"target": {"path": {"kind": "recorded", "file": "/x"}}}, "would open the file /x"),
        ({"bus": {"zenoh_config": "/x"}}, "would open the file /x"),
    ],
    ids=str,
)
def test_recording_runs_no_code_and_opens_no_file(settings, reason, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    file, path = tmp_path / "evil.py", tmp_path / "run.mcap"
    file.write_text(f"open({str(tmp_path / 'mark')!r}, 'w')\n")  # importing it leaves a mark
    settings = json.loads(json.dumps(settings).replace("{file}", str(file)))
    tables = {**effective(Scenario(robot=load_robot())), **settings}
    writer = RecordingWriter(path)
    writer.write_run(stamp_of(0), tomli_w.dumps(tables))
    writer.write("odom", odometry(0), stamp_of(0), 0)
    writer.close()
    recording = Recording(path)

    list(recording.samples())

    def read():
        recording.refuse_code()
        graph_of(recording.scenario(7, "target", "bus", "follower"))

    assert reason.replace("{file}", str(file)) in error_of(ConfigError, read)
    assert not (tmp_path / "mark").exists()


def test_programs_of_a_recording_run_only_with_trust(recorded, tmp_path):
    # importing it would leave a mark
    mark = tmp_path / "mark"
    path = recorded()
    follower = tmp_path / "follower0.py"
    follower.write_text(f"open({str(mark)!r}, 'w')\n" + follower.read_text())
    done = mecazen("replay", path, "--through", "follower")
    assert_one_line(done, 2, f"{path}: would run its programs {follower}:Mine", "--trust")
    untrusted = Recording(path)
    list(untrusted.samples())
    assert untrusted.scenario(7, "follower").programs == {}  # as `mecazen view` takes it
    assert not mark.exists()
    done = mecazen("replay", path, "--through", "follower", "--trust")
    assert (done.returncode, done.stderr) == (0, "")
    assert mark.exists()
