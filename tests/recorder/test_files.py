"""Files: messages are written and read back, also by other programs and from damaged files."""

import resource
import signal
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from harness import error_of
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from mecazen.errors import MecazenError
from mecazen.messages import Twist
from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError, RecordingWriter
from recorder.conftest import TICK_NS, stamp_of, tick

TICKS = range(20)


def read(path: Path, *times: float) -> list[Sample]:
    return list(Recording(path).samples(*times))


def test_messages_keep_their_stamps_and_order(make_recording):
    samples = read(make_recording(TICKS))
    expected = [(n, key, message) for n in TICKS for key, message in tick(n).items()]
    assert [(s.stamp, s.key, s.time_ns) for s in samples] == [
        (stamp_of(n), key, n * TICK_NS) for n, key, _ in expected
    ]
    for sample, (_, _, message) in zip(samples, expected, strict=True):
        assert sample.message(type(message)) == message
    span = read(make_recording(TICKS, "span.mcap"), 3 * TICK_NS, 5 * TICK_NS)
    assert sorted({sample.time_ns for sample in span}) == [3 * TICK_NS, 4 * TICK_NS, 5 * TICK_NS]


def test_the_same_samples_give_the_same_file(make_recording):
    first, second = make_recording(TICKS, "1.mcap"), make_recording(TICKS, "2.mcap")
    assert first.read_bytes() == second.read_bytes()


def test_readers_of_ros_bags_read_the_messages(make_recording):
    with make_recording(TICKS).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = [(c.topic, m.log_time, ros) for _, c, m, ros in reader.iter_decoded_messages()]
    odom = [ros for key, _, ros in decoded if key == "odom"]
    assert [ros.pose.pose.position.x for ros in odom] == [n / 7 for n in TICKS]
    assert odom[0].pose.covariance == [1 / 3] * 36
    states = [ros for key, _, ros in decoded if key == "follower/state"]
    assert [ros.tracking for ros in states] == ["waiting"] * len(TICKS)
    assert [time for key, time, _ in decoded if key == "clock"] == [n * TICK_NS for n in TICKS]


def test_only_ros_topics_are_latched(tmp_path):
    path = tmp_path / "latched.mcap"
    names = ["/tf_static", "/two/robot_description", "/tf", "my/tf_static"]
    with closing(RecordingWriter(path)) as writer:
        for name in names:
            writer.write(name, Twist(), None, 0)
    with path.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    latched = [c.topic for c in channels if "durability: 1" in str(c.metadata)]
    assert latched == names[:2]


@pytest.fixture
def flushed(tmp_path, monkeypatch):
    """Return a recording that is flushed after each sample; its sizes; and its samples."""
    monkeypatch.setattr("mecazen_recorder.writer.FLUSH_S", 0.0)
    path, sizes = tmp_path / "flushed.mcap", []
    with closing(RecordingWriter(path)) as writer:
        writer.write_run(stamp_of(0), "seed = 3")
        for number in TICKS:
            writer.write("cmd_vel", Twist(), stamp_of(number), number * TICK_NS)
            sizes.append(path.stat().st_size)
    return path, sizes, read(path)


def test_a_truncated_file_has_all_that_was_flushed(flushed, tmp_path):
    path, sizes, samples = flushed
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    for length in [*range(sizes[0], len(data), 61), *sizes]:
        cut.write_bytes(data[:length])
        recording = Recording(cut)
        kept = list(recording.samples())
        assert kept == samples[: len(kept)]
        assert len(kept) >= sum(size <= length for size in sizes)
        assert recording.is_cut_off or len(kept) == len(samples)


def test_damaged_byte_costs_samples_or_is_refused(flushed, tmp_path):
    path, _, samples = flushed
    data, damaged = path.read_bytes(), tmp_path / "damaged.mcap"
    for place in range(0, len(data), 7):
        damaged.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        try:
            kept = read(damaged)
        except RecordingError:  # any other error would be a traceback
            continue
        assert len(kept) <= len(samples)


@contextmanager
def limited_files(size):
    """Let files have at most a size: no process can fill a disk in a test."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_full_disk_costs_no_earlier_sample(tmp_path, monkeypatch):
    monkeypatch.setattr("mecazen_recorder.writer.FLUSH_S", 0.0)
    path, count = tmp_path / "a.mcap", 0
    writer = RecordingWriter(path)

    def write_on():
        nonlocal count
        while True:
            writer.write("cmd_vel", Twist(), stamp_of(count), count * TICK_NS)
            count += 1

    with limited_files(20_000):
        problem = error_of(RecordingError, write_on)
        writer.close()  # as a service does that has failed
    assert problem.endswith(
        "can't be written on: File too large; what was recorded before can be read"
    )
    assert len(read(path)) == count > 10


def damaged(path: Path, **metadata: str) -> None:
    """Write a file of `mecazen record` with a channel and a run that have these metadata."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "mecazen 1")
        writer.add_metadata("run", metadata)
        writer.add_message(writer.register_channel("my/key\n", "", 0, metadata), 0, b"", 0)
        writer.finish()


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (lambda path: None, "can't be read: No such file or directory"),
        (lambda path: path.write_bytes(b"\x89MCAP"), "not an MCAP file"),
        (lambda path: damaged(path, run="abc", seed="1"), r"my/key\n has no valid run and seed"),
        (lambda path: damaged(path, run="1"), r"my/key\n has no valid run and seed"),
        (
            lambda path: damaged(path, run="1", seed="1", scenario="seed = \n"),
            "the configuration of run 1 is damaged: Invalid value (at line 1, column 8)",
        ),
        (
            lambda path: damaged(path, run="1", seed="1", scenario=f"a = {'[' * 5000}{']' * 5000}"),
            "the configuration of run 1 is damaged: nested too deep",
        ),
        (
            lambda path: damaged(path, run="1", seed="1"),
            "without the configuration of run 1; --scenario NAME says which scenario it was",
        ),
    ],
)
def test_a_wrong_file_is_one_line(write, reason, tmp_path):
    path = tmp_path / "x.mcap"
    write(path)

    def use() -> None:
        recording = Recording(path)
        list(recording.samples())
        recording.scenario(1)

    assert error_of(MecazenError, use) == f"{path}: {reason}"


def test_existing_file_or_missing_folder_is_one_line(make_recording, tmp_path):
    path = make_recording()
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        RecordingWriter(path)
    assert path.read_bytes() == before
    with pytest.raises(RecordingError, match="No such file or directory"):
        RecordingWriter(tmp_path / "none" / "a.mcap")
