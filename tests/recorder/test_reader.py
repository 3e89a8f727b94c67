"""Recordings are read back, also damaged ones, and other programs read them too."""

import struct
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from harness import error_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import Writer
from mecazen.errors import MecazenError
from mecazen.messages import Twist, Vector3
from mecazen.urdf import RobotDescription
from mecazen.wire import JSON_ENCODING
from mecazen_recorder.reader import MAX_CHUNK_BYTES, Recording, Sample
from mecazen_recorder.writer import RecordingError, RecordingWriter
from mecazen_tools.recording_info import inspect
from recorder.ticks import TICK_NS, stamp_of, tick
from zstandard import ZstdCompressor

TICKS = range(20)


def read(path: Path, *times: float) -> list[Sample]:
    return list(Recording(path).samples(*times))


def problem(path: Path) -> str:
    return error_of(MecazenError, lambda: read(path))


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_every_message_comes_back_with_its_stamp_in_the_order_of_writing(make_recording, encoding):
    samples = read(make_recording(TICKS, encoding))
    expected = [(n, key, message) for n in TICKS for key, message in tick(n).items()]
    assert [(s.stamp, s.key, s.time_ns) for s in samples] == [
        (stamp_of(n), key, n * TICK_NS) for n, key, _ in expected
    ]
    for sample, (_, _, message) in zip(samples, expected, strict=True):
        assert sample.message(type(message)) == message


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


def record(opcode: int, content: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(content)) + content


def chunk(size: int, data: bytes, compression: str = "zstd") -> bytes:
    """A chunk that claims to have `size` bytes when it is expanded."""
    name = compression.encode()
    head = struct.pack("<QQQII", 0, 0, size, 0, len(name)) + name
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(data)) + data)


def zeros(count: int, *, says_size: bool) -> bytes:
    """Some MiB of zeros, compressed a thirtythousandfold."""
    compressor = ZstdCompressor().compressobj(size=count << 20 if says_size else -1)
    parts = [compressor.compress(bytes(1 << 20)) for _ in range(count)]
    return b"".join(parts) + compressor.flush()


LARGEST = MAX_CHUNK_BYTES >> 20


@pytest.mark.parametrize(
    ("size", "count", "says_size", "compression"),
    [
        (LARGEST + 1 << 20, LARGEST + 1, True, "zstd"),
        (2**64 - 1, 1, True, "zstd"),
        (1000, 8 * LARGEST, True, "zstd"),
        (1000, 8 * LARGEST, False, "zstd"),
        (0, 8 * LARGEST, False, "zstd"),
        (1 << 20, 1, True, "lz4"),
    ],
    ids=["too large", "huge", "lies", "lies, frame without size", "no size", "lz4"],
)
def test_a_chunk_that_is_too_large_or_lies_about_its_size_is_not_expanded(
    make_recording, size, count, says_size, compression
):
    path = make_recording(range(2))
    with path.open("ab") as file:
        whole = path.read_bytes()
        file.truncate(whole.rindex(bytes([Opcode.DATA_END]) + struct.pack("<Q", 4)))
        file.write(chunk(size, zeros(count, says_size=says_size), compression))
    tracemalloc.start()
    recording = Recording(path)
    assert len(list(recording.samples())) == 12
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert recording.is_cut_off
    assert most < 4 << 20  # of at least 16 MiB


def test_a_file_of_many_chunks_that_expand_is_given_up(make_recording, monkeypatch):
    monkeypatch.setattr("mecazen_recorder.reader.MAX_BYTES", 8 << 20)
    path = make_recording(range(2))
    with path.open("ab") as file:
        whole = path.read_bytes()
        file.truncate(whole.rindex(bytes([Opcode.DATA_END]) + struct.pack("<Q", 4)))
        file.write(chunk(LARGEST << 20, zeros(LARGEST, says_size=True)) * 10)
    assert problem(path) == f"{path}: expands more than 1000-fold"


@pytest.mark.parametrize(
    "metadata",
    [
        {"run": "abc", "seed": "1"},
        {"run": "9" * 5000, "seed": "1"},
        {"run": "1"},
        {"run": "1", "seed": "4294967296"},
        {"run": "-1", "seed": "1"},
        {"run": "\u0663", "seed": "1"},
    ],
)
def test_a_channel_whose_run_and_seed_are_none_is_one_line(tmp_path, metadata):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "mecazen 1")
        writer.add_metadata("run", {**metadata, "scenario": "seed = 1"})
        writer.add_message(writer.register_channel("my/key\n", "json", 0, metadata), 0, b"", 0)
        writer.finish()
    assert problem(path) == f"{path}: my/key\\n has no valid run and seed"


def test_a_sample_later_than_any_time_is_one_line(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write("cmd_vel", Twist(), stamp_of(0), 2**63)
    writer.close()
    assert problem(tmp_path / "a.mcap").endswith("a.mcap: cmd_vel at an impossible time")


def test_only_attachments_whose_names_can_be_keys_are_served(tmp_path):
    path = tmp_path / "a.mcap"
    names = [
        "../../x",
        "/etc/x",
        "a//b",
        "**",
        "",
        "a" * 5000,
        ".",
        "a/../b",
        "a b",
        "m/wheel-1.stl",
    ]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "mecazen 1")
        for name in [*names, "robot.urdf"]:
            writer.add_attachment(0, 0, name, "", b"\xff")
        writer.finish()
    (description,) = Recording(path).descriptions().values()
    assert description == RobotDescription("\ufffd", {"m/wheel-1.stl": b"\xff"})


@pytest.mark.parametrize(
    "scenario", ["seed = \n", f"a = {'[' * 5000}{']' * 5000}", f"a = {'9' * 5000}"]
)
def test_a_damaged_configuration_is_one_line(tmp_path, scenario):
    writer = RecordingWriter(tmp_path / "a.mcap", "cdr")
    writer.write_run(stamp_of(0), scenario)
    writer.write("cmd_vel", Twist(), stamp_of(0), 0)
    writer.close()
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.samples())) == 1
    with pytest.raises(RecordingError, match=r"a\.mcap: the configuration of run 7 is damaged"):
        recording.scenario(7)
