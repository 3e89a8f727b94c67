"""Written recordings: how other programs read them, and errors of writing."""

import math
import resource
import signal
from contextlib import contextmanager

import msgspec
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mecazen.geometry import Twist2D
from mecazen.keys import TOPICS
from mecazen.messages import Twist
from mecazen.wire import RefusedError
from mecazen_recorder import writer
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError, RecordingWriter, Sink
from recorder.ticks import TICK_NS, stamp_of

TICKS = range(20)


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


def test_what_fits_on_the_disk_is_kept_up_to_the_last_whole_chunk(tmp_path):
    path, ticks = tmp_path / "a.mcap", 0
    with limited_files(1_000_000):
        recording = RecordingWriter(path, "json")
        recording._synced_s = (
            math.inf
        )  # as in a run so fast that the disk is full at the first sync
        while recording._sink.tell() < 2_000_000:
            twist = Twist.planar(Twist2D(math.sin(ticks), math.cos(ticks)))
            recording.write("cmd_vel", twist, stamp_of(ticks), ticks)
            ticks += 1
        with pytest.raises(RecordingError, match="what was recorded before can be read"):
            recording.close()
    kept = list(Recording(path).samples())
    assert [sample.time_ns for sample in kept] == list(range(len(kept)))
    assert ticks / 4 < len(kept) < ticks / 2
    assert path.stat().st_size <= 1_000_000


def test_when_the_disk_is_full_from_the_start_expect_no_file(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(RecordingError, match=r"No space left$"):
        writer.close()
    assert not list(tmp_path.iterdir())


def test_there_is_a_limit_to_keys_and_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("mecazen_recorder.writer.MAX_CHANNELS", 2)
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    for run in (1, 2):
        writer.write("cmd_vel", Twist(), stamp_of(0, run), 0)
    with pytest.raises(RefusedError, match="at most 2 keys times runs"):
        writer.write("cmd_vel", Twist(), stamp_of(0, 3), 0)
    writer.close()
    assert len(list(Recording(tmp_path / "a.mcap").samples())) == 2


@pytest.mark.parametrize("kind", sorted({t.type for t in TOPICS}, key=lambda k: k.__name__))
def test_a_json_schema_has_the_message_at_its_root_and_all_that_it_refers_to(kind):
    name, encoding, data = writer.schema_of(kind, "json")
    table = msgspec.json.decode(data)
    assert (encoding, name) == ("jsonschema", kind.ROS_TYPE)
    assert table["type"] == "object"
    assert tuple(table["properties"]) == kind.__struct_fields__
    references = [part.partition(b'"')[0] for part in data.split(b'"$ref":"#/$defs/')[1:]]
    assert {name.decode() for name in references} <= set(table["$defs"])


def test_when_the_disk_is_full_at_the_end_expect_what_was_synced(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    writer._sync()
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(RecordingError, match="No space left; what was recorded before can be read"):
        writer.close()
    writer.close()  # as a service does that has failed
    assert [sample.key for sample in Recording(tmp_path / "a.mcap").samples()] == ["cmd_vel"]
