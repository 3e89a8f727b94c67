"""What is written is read again, whatever is missing or damaged; and others read it too."""

from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from harness import error_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from mecazen.messages import Twist, Vector3
from mecazen.wire import JSON_ENCODING, RefusedError
from mecazen_recorder.info import inspect
from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError, RecordingWriter, Sink
from recorder.ticks import TICK_NS, stamp_of, tick

TICKS = range(20)


def read(path: Path, *times: float) -> list[Sample]:
    return list(Recording(path).samples(*times))


def problem(path: Path) -> str:
    return error_of(RecordingError, lambda: read(path))


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_every_message_comes_back_with_its_stamp_in_the_order_of_writing(make_recording, encoding):
    samples = read(make_recording(TICKS, encoding))
    expected = [(n, key, message) for n in TICKS for key, message in tick(n).items()]
    assert [(s.stamp, s.key, s.time_ns) for s in samples] == [
        (stamp_of(n), key, n * TICK_NS) for n, key, _ in expected
    ]
    for sample, (_, _, message) in zip(samples, expected, strict=True):
        assert sample.message(type(message)) == message


def test_messages_in_cdr_are_what_readers_of_ros_bags_expect(make_recording):
    with make_recording(TICKS, "cdr").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        read = [(c.topic, m.log_time, ros) for _, c, m, ros in reader.iter_decoded_messages()]
    odom = [ros for key, _, ros in read if key == "odom"]
    assert [ros.pose.pose.position.x for ros in odom] == [n / 7 for n in TICKS]
    assert odom[0].pose.covariance == [1 / 3] * 36
    states = [ros for key, _, ros in read if key == "follower/state"]
    assert [ros.tracking for ros in states] == ["waiting"] * len(TICKS)
    assert [time for key, time, _ in read if key == "clock"] == [n * TICK_NS for n in TICKS]


def test_messages_in_json_are_whole_and_have_a_schema(make_recording):
    with make_recording(TICKS, "json").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            fields = msgspec.json.decode(schema.data)["properties"]
            assert list(msgspec.json.decode(message.data)) == list(fields)


def test_runs_in_one_file_are_told_apart_and_each_has_its_configuration(tmp_path):
    writer = RecordingWriter(tmp_path / "runs.mcap", "cdr")
    stamps = [stamp_of(n, run, run + 1) for run in (1, 2) for n in (0, 1)]
    for stamp in stamps:
        if stamp.time_ns == 0:
            writer.write_run(stamp, f"seed = {stamp.seed}" if stamp.run == 2 else None)
        writer.write("cmd_vel", Twist(), stamp, stamp.time_ns)
    writer.close()
    recording = Recording(tmp_path / "runs.mcap")
    assert [sample.stamp for sample in recording.samples()] == stamps
    assert recording.scenarios == {2: "seed = 3"}
    assert [(r.run, r.seed, r.has_scenario) for r in inspect(recording).runs] == [
        (1, 2, False),
        (2, 3, True),
    ]


@pytest.mark.parametrize("encoding", ["", "image/png", JSON_ENCODING, "zenoh/bytes;x"])
def test_a_key_of_ones_own_is_kept_as_it_came(tmp_path, encoding):
    writer = RecordingWriter(tmp_path / "raw.mcap", "cdr")
    writer.write_bytes("my/camera", b"\x00\xff", encoding, stamp_of(1), TICK_NS)
    writer.write_bytes("my/camera", b"", encoding, None, TICK_NS)
    writer.close()
    first, second = read(tmp_path / "raw.mcap")
    assert first.as_published() == (b"\x00\xff", encoding, stamp_of(1).pack())
    assert second.as_published() == (b"", encoding, None)


def test_a_message_is_published_again_in_json(make_recording):
    sample = next(s for s in read(make_recording([3])) if s.key == "cmd_vel")
    payload, encoding, attachment = sample.as_published()
    assert msgspec.json.decode(payload, type=Twist) == Twist(linear=Vector3(x=0.3))
    assert (encoding, attachment) == (JSON_ENCODING, stamp_of(3).pack())


def test_a_span_of_time_is_read_with_both_its_ends(make_recording):
    samples = read(make_recording(), 3 * TICK_NS, 5 * TICK_NS)
    assert sorted({sample.time_ns for sample in samples}) == [3 * TICK_NS, 4 * TICK_NS, 5 * TICK_NS]


@dataclass(repr=False)
class Chunked:
    """A recording as bytes; and its lengths and counts of samples after each sync."""

    data: bytes
    synced: list[tuple[int, int]]


@pytest.fixture(scope="module")
def chunked(tmp_path_factory):
    path = tmp_path_factory.mktemp("chunked") / "a.mcap"
    writer = RecordingWriter(path, "cdr")
    synced = []
    for number in TICKS:
        stamp = stamp_of(number)
        if number == 0:
            writer.write_run(stamp, "seed = 3")
        for key, message in tick(number).items():
            writer.write(key, message, stamp, stamp.time_ns)
        writer._sync()
        synced.append((path.stat().st_size, writer.count))
    writer.close()
    return Chunked(path.read_bytes(), synced)


def test_wherever_the_file_ends_all_that_was_synced_is_read(chunked, tmp_path):
    data, synced = chunked.data, chunked.synced
    whole = tmp_path / "whole.mcap"
    whole.write_bytes(data)
    samples = read(whole)
    cut = tmp_path / "cut.mcap"
    lengths = range(synced[0][0], len(data), 97)  # about a thousand, in every kind of record
    for length in [*lengths, *(length for length, _ in synced)]:
        cut.write_bytes(data[:length])
        recording = Recording(cut)
        found = list(recording.samples())
        assert found == samples[: len(found)]
        assert len(found) >= max(count for size, count in synced if size <= length)
        assert recording.is_cut_off or len(found) == len(samples)
        assert inspect(recording).count == len(found)


@given(place=st.integers(0, 10**6), value=st.integers(1, 255))
@settings(max_examples=300)
def test_a_damaged_byte_costs_samples_but_never_changes_one(
    chunked, tmp_path_factory, place, value
):
    data = chunked.data
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    path.write_bytes(data)
    good = {(s.key, s.time_ns, s.payload) for s in read(path)}
    damaged = bytearray(data)
    damaged[place % len(data)] ^= value
    path.write_bytes(damaged)
    try:
        found = read(path)
    except RecordingError:
        return
    assert {(s.key, s.time_ns, s.payload) for s in found} <= good


def test_what_is_no_recording_is_refused_in_one_line(tmp_path):
    path = tmp_path / "x.mcap"
    assert "no such file" in problem(path).lower()
    assert "directory" in problem(tmp_path).lower()
    for data in (b"", b"\x89MCAP", b"hello, this is text\n", bytes(100)):
        path.write_bytes(data)
        assert "not an MCAP file" in problem(path)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "rosbag2 0.26")
        writer.finish()
    assert "rosbag2 0.26" in problem(path)


def test_a_file_that_exists_is_not_overwritten_and_a_missing_folder_is_one_line(
    make_recording, tmp_path
):
    path = make_recording()
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        RecordingWriter(path, "cdr")
    assert path.read_bytes() == before
    with pytest.raises(RecordingError, match="No such file or directory"):
        RecordingWriter(tmp_path / "none" / "a.mcap", "cdr")


def test_a_sync_that_fails_leaves_what_was_synced_before(tmp_path, monkeypatch):
    sink = Sink(tmp_path / "a")
    sink.write(b"good")
    sink.sync()
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    sink.write(b"lost")
    with pytest.raises(RecordingError, match="No space left"):
        sink.sync()
    sink.close()
    assert (tmp_path / "a").read_bytes() == b"good"


def test_when_the_disk_is_full_at_the_end_expect_what_was_synced(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    writer._sync()
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(RecordingError, match="No space left; what was recorded before can be read"):
        writer.close()
    writer.close()  # as a service does that has failed
    assert [sample.key for sample in read(tmp_path / "a.mcap")] == ["cmd_vel"]


def test_when_the_disk_is_full_from_the_start_expect_no_file(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(RecordingError, match=r"No space left$"):
        writer.close()
    assert not list(tmp_path.iterdir())


def test_info_counts_rates_and_gaps(tmp_path):
    path = tmp_path / "gaps.mcap"
    writer = RecordingWriter(path, "json")
    for number in [*range(10), *range(15, 20), *range(22, 30)]:
        stamp = stamp_of(number)
        writer.write("cmd_vel", Twist(), stamp, stamp.time_ns)
    writer.write_bytes("my/key", b"x", "text/plain", None, 0)
    writer.close()
    info = inspect(Recording(path))
    cmd_vel, mine = info.keys
    assert (cmd_vel.key, cmd_vel.type, cmd_vel.count) == ("cmd_vel", "geometry_msgs/msg/Twist", 23)
    assert cmd_vel.rate_hz == pytest.approx(100.0)
    assert (cmd_vel.gaps, cmd_vel.longest_gap_s) == (2, pytest.approx(0.06))
    assert (mine.type, mine.count, mine.rate_hz, mine.gaps) == ("text/plain", 1, None, 0)
    assert (info.count, info.is_cut_off, info.duration_s) == (24, False, pytest.approx(0.29))


def test_info_tells_the_robots_of_a_run_and_its_own_seed(tmp_path):
    path = tmp_path / "robots.mcap"
    writer = RecordingWriter(path, "cdr")
    for run in (1, 2):
        writer.write_run(stamp_of(0, run), "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\n")
        for seed, key in enumerate(("one/odom", "two/odom", "clock"), start=10):
            if (run, key) != (2, "clock"):
                message = tick(1)[key.rpartition("/")[2]]
                writer.write(key, message, stamp_of(0, run, seed), 0)
    writer.close()
    info = inspect(Recording(path))
    assert [(r.run, r.seed, r.robots) for r in info.runs] == [
        (1, 12, ("one", "two")),
        (2, None, ("one", "two")),
    ]
    assert {key.key: key.type.rpartition("/")[2] for key in info.keys} == {
        "clock": "Clock",
        "one/odom": "Odometry",
        "two/odom": "Odometry",
    }


def test_a_damaged_configuration_is_one_line(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write_run(stamp_of(0), "seed = \n")
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    writer.close()
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.samples())) == 1
    with pytest.raises(RecordingError, match=r"a\.mcap: the configuration of run 7 is damaged"):
        recording.scenario(7)


def test_there_is_a_limit_to_keys_and_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("mecazen_recorder.writer.MAX_CHANNELS", 2)
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    for run in (1, 2):
        writer.write("cmd_vel", Twist(), stamp_of(0, run), 0)
    with pytest.raises(RefusedError, match="at most 2 keys times runs"):
        writer.write("cmd_vel", Twist(), stamp_of(0, 3), 0)
    writer.close()
    assert len(read(tmp_path / "a.mcap")) == 2
