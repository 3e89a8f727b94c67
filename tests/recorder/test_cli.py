"""`mecazen record`, `replay` and `info` as processes, over a router."""

import resource
import signal
from pathlib import Path

import msgspec
import pytest
from harness import Command, assert_one_line, mecazen
from mecazen import keys
from mecazen.messages import Odometry, String
from mecazen.urdf import RobotDescription, serve_description
from mecazen.wire import JSON_ENCODING
from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError, RecordingWriter
from recorder.conftest import Net
from recorder.ticks import odometry, stamp_of, tick

PER_TICK = len(tick(0))


def samples(path: Path) -> list[Sample]:
    """Return the samples that are readable so far."""
    try:
        return list(Recording(path).samples())
    except RecordingError:
        return []


def record(net: Net, path: Path, *options: object) -> Command:
    """Start `mecazen record`, and wait until whoever publishes knows of it."""
    if not net.commands:
        net.bus.declare_alive("test")
    recorder = net.start("record", "-o", path, *options)
    recorder.await_start()
    net.wait(lambda: "record" in net.bus.presence.names)
    return recorder


def finish(net: Net, recorder: Command, path: Path, count: int) -> str:
    """End a recorder as Ctrl-C does when it has so many samples, and return what it says."""
    net.wait(lambda: len(samples(path)) == count)
    code, out, err = recorder.end()
    assert code == 0, err
    net.wait(lambda: "record" not in net.bus.presence.names)
    return out


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_what_is_recorded_replayed_and_recorded_again_is_the_same(net, tmp_path, encoding):
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    recorder = record(net, first, "--encoding", encoding)
    net.publish(range(50))
    net.bus.put_bytes("my/key", b"\x00\xff", "image/png", stamp_of(50).pack())
    net.bus.put_bytes("cmd_vel", b'{"linear":{"x":0.5}}')
    count = 50 * PER_TICK + 2
    assert f"{count} samples" in finish(net, recorder, first, count)
    expected = samples(first)
    assert [s.key for s in expected[:PER_TICK]] == list(tick(0))
    assert (expected[-1].stamp, expected[-1].time_ns) == (None, stamp_of(50).time_ns)
    assert expected[-2].payload == b"\x00\xff"

    info = msgspec.json.decode(mecazen("info", first, "--json").stdout)
    assert (info["count"], info["is_cut_off"]) == (count, False)
    assert {k["key"]: k["gaps"] for k in info["keys"]} == dict.fromkeys([*tick(0), "my/key"], 0)

    recorder = record(net, second, "--encoding", encoding)
    assert f"{count} samples" in net.run("replay", first, "--speed", 100).stdout
    finish(net, recorder, second, count)
    assert samples(second) == expected


def test_a_recording_without_a_sample_is_an_error_and_no_file(net, tmp_path):
    path = tmp_path / "none.mcap"
    recorder = net.start("record", "-o", path, "odmo")
    warning = recorder.process.stderr.readline()
    assert warning == "warning: odmo: no key of mecazen; did you mean odom?\n"
    recorder.await_start()
    code, _, err = recorder.end()
    assert err.endswith(f"error: {path}: not written, since no sample came\n")
    assert code == 1
    assert not path.exists()


@pytest.mark.parametrize("batches", [0, 2])
def test_after_sigkill_all_that_had_reached_the_disk_is_read(net, tmp_path, batches):
    path = tmp_path / "killed.mcap"
    recorder = record(net, path)
    for batch in range(batches):
        net.publish(range(batch * 20, batch * 20 + 20))
        net.wait(lambda batch=batch: len(samples(path)) == (batch + 1) * 20 * PER_TICK)
    net.publish(range(batches * 20, batches * 20 + 20))
    recorder.end(signal.SIGKILL)
    found = samples(path)
    published = [(n, key) for n in range(batches * 20 + 20) for key in tick(0)]
    assert len(found) >= batches * 20 * PER_TICK
    assert [(s.stamp, s.key) for s in found] == [
        (stamp_of(n), key) for n, key in published[: len(found)]
    ]
    done = mecazen("info", path, "--json")
    (line,) = done.stderr.strip().splitlines()
    if found:
        assert done.returncode == 0
        assert msgspec.json.decode(done.stdout)["count"] == len(found)
        assert "the end of the file is missing" in line
    else:  # what holds nothing must not look like a success
        assert done.returncode == 1
        assert line.endswith("no sample in it, and its end is missing")


def test_when_the_disk_is_full_expect_one_line_and_what_was_recorded(net, tmp_path):
    path = tmp_path / "full.mcap"
    recorder = record(net, path)
    net.publish(range(20))
    net.wait(lambda: len(samples(path)) == 20 * PER_TICK)
    # no process can fill a disk in a test: a limit to the size of files fails in the same place
    limit = path.stat().st_size + 10
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (limit, limit))
    net.publish(range(20, 40))
    code, out, err = recorder.end(None)
    assert code == 1, out
    errors = [line for line in err.splitlines() if line.startswith("error:")]
    assert len(errors) == len(err.splitlines()) == 1, err
    assert "File too large" in errors[0]
    assert "can be read" in errors[0]
    assert len(samples(path)) == 20 * PER_TICK


def test_what_is_malformed_is_refused_and_the_rest_recorded(net, tmp_path):
    path = tmp_path / "some.mcap"
    recorder = record(net, path)
    for payload in (b"", b"{", b'{"linear":1}', b"\xff"):
        net.bus.put_bytes("cmd_vel", payload, JSON_ENCODING)
    net.bus.put_bytes("cmd_vel", b"{}", JSON_ENCODING, b"no stamp")
    net.bus.put_bytes("cmd_vel", b"{}", JSON_ENCODING)
    assert "1 samples, 5 refused or dropped" in finish(net, recorder, path, 1)


ROBOT = RobotDescription("<robot/>", {"meshes/r.stl": b"solid"})


def test_who_simulates_is_asked_for_the_configuration_and_what_the_robot_looks_like(net, tmp_path):
    path = tmp_path / "asked.mcap"
    net.bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data="seed = 3")))
    serve_description(net.bus, "", ROBOT)
    recorder = record(net, path)
    net.publish(range(2))
    finish(net, recorder, path, 2 * PER_TICK)
    recording = Recording(path)
    assert len(list(recording.samples())) == 2 * PER_TICK
    assert recording.scenarios == {7: "seed = 3"}
    assert recording.descriptions() == {"": ROBOT}


def test_a_key_of_any_name_is_text_in_the_table(tmp_path):
    path = tmp_path / "odd.mcap"
    writer = RecordingWriter(path, "json")
    writer.write_bytes("my/[/oops]\x1b[2J", b"x", "", None, 0)
    writer.close()
    shown = mecazen("info", path)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert r"my/[/oops]\u001b[2J" in shown.stdout


def test_what_a_user_gets_wrong_is_one_line(net, make_recording, tmp_path):
    path = make_recording()
    assert_one_line(net.run("record", "a//b", "-o", tmp_path / "x.mcap"), 1, "a//b")
    assert not (tmp_path / "x.mcap").exists()
    assert_one_line(net.run("replay", path, "--keys", "nothing"), 1, "nothing on these keys")
    through = mecazen("replay", path, "--through", "follower")
    assert_one_line(through, 1, "no run with its configuration")


def test_rerun_and_json_do_not_go_together(tmp_path):
    done = mecazen("record", "-o", tmp_path / "a.mcap", "--rrd", "--encoding", "json")
    assert done.returncode == 2
    assert "--encoding cdr" in done.stderr


def test_what_several_robots_say_is_recorded_and_replayed_as_what_one_says(net, tmp_path):
    names = ("one", "two")
    toml = "".join(f"[[robots]]\nname = '{name}'\n" for name in names)
    net.bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data=toml)))
    for name in names:
        serve_description(net.bus, name, RobotDescription(f"<robot name='{name}'/>", ROBOT.meshes))
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    recorder = record(net, first)
    for number in range(10):
        for name in names:
            odom = keys.of_robot(keys.ODOM, name)
            net.bus.publisher(odom).put(odometry(number), stamp_of(number))
    net.bus.put_bytes("two/odom", b"{", JSON_ENCODING)
    net.bus.put_bytes("two/camera", b"\xff", "image/png")
    assert "21 samples, 1 refused or dropped" in finish(net, recorder, first, 21)
    expected = samples(first)
    assert [(s.key, s.kind) for s in expected[-3:]] == [
        ("one/odom", Odometry),
        ("two/odom", Odometry),
        ("two/camera", None),
    ]
    assert {name: of.urdf for name, of in Recording(first).descriptions().items()} == {
        name: f"<robot name='{name}'/>" for name in names
    }
    assert Recording(first).descriptions()["two"].meshes == ROBOT.meshes

    recorder = record(net, second)
    net.run("replay", first, "--speed", 100)
    finish(net, recorder, second, 21)
    assert samples(second) == expected
    shown = mecazen("info", first).stdout
    assert "two/odom" in shown
    assert "robots one, two" in shown
    alone = net.run("replay", first, "--robot", "two")
    assert_one_line(alone, 2, "--through")


def test_some_keys_are_recorded_once_each(net, tmp_path):
    path = tmp_path / "some.mcap"
    recorder = record(net, path, "odom", "target/*", "o$*", "**/observation")
    net.publish(range(5))
    finish(net, recorder, path, 10)
    assert [s.key for s in samples(path)] == ["odom", "target/observation"] * 5
