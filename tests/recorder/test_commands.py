"""`mecazen record`, `replay` and `info` as processes, over a router; and the service."""

import signal
from collections import Counter
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from harness import SCENARIOS, Command, assert_one_line, here, load_robot
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import RecorderConfig, Scenario
from mecazen.loading import load_scenario, to_toml
from mecazen.messages import Odometry, String, Twist
from mecazen.runtime.host import Host
from mecazen.runtime.process import observe
from mecazen.runtime.worker import Worker
from mecazen.schema import OutputFile
from mecazen.urdf import ask_description, build_meshes
from mecazen.wire import JSON_ENCODING
from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.writer import RecordingError, RecordingWriter
from mecazen_tools.recorded import inspect
from recorder.conftest import Net, odometry, stamp_of, tick

PER_TICK = len(tick(0))
CONVOY = load_scenario(SCENARIOS / "convoy.toml")


def samples(path: Path) -> list[Sample]:
    """Return the samples that are readable so far."""
    try:
        return list(Recording(path).samples())
    except RecordingError:
        return []


def record(net: Net, path: Path, *options: object) -> Command:
    """Start `mecazen record`, and wait until the bus of the test knows of it."""
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


def test_recorded_replay_equals_the_recording(net, tmp_path):
    toml = String(data=to_toml(CONVOY))
    net.bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(toml))
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    recorder = record(net, first)
    for number in range(10):
        for name in CONVOY.names:
            odom = keys.of_robot(keys.ODOM, name)
            net.bus.publisher(odom).put(odometry(number), stamp_of(number))
    net.bus.put_bytes("two/odom", b"{", JSON_ENCODING)
    net.bus.put_bytes("two/camera", b"\x00\xff", "image/png", stamp_of(10).pack())
    net.bus.put_bytes("one/cmd_vel", b'{"linear":{"x":0.5}}')
    assert "22 samples, 1 refused or dropped" in finish(net, recorder, first, 22)
    expected = samples(first)
    odom, camera, unstamped = expected[-3:]
    assert (odom.key, odom.kind) == ("two/odom", Odometry)
    assert (camera.kind, camera.payload) == (None, b"\x00\xff")
    assert (unstamped.stamp, unstamped.time_ns) == (None, stamp_of(10).time_ns)
    assert Recording(first).descriptions().keys() == set(CONVOY.names)

    recorder = record(net, second)
    assert "22 samples" in net.run("replay", first, "--speed", 100).stdout
    finish(net, recorder, second, 22)
    assert samples(second) == expected
    info = msgspec.json.decode(here("info", first, "--json").stdout)
    assert (info["count"], info["is_cut_off"]) == (22, False)
    assert {k["key"]: k["gaps"] for k in info["keys"]}["two/odom"] == 0


def test_recording_without_samples_is_an_error(net, tmp_path):
    path = tmp_path / "none.mcap"
    recorder = net.start("record", "-o", path, "odmo")
    recorder.await_start()
    code, _, err = recorder.end()
    assert err.endswith(f"error: {path}: not written, since no sample came\n")
    assert code == 1
    assert not path.exists()


def test_after_sigkill_all_that_was_flushed_is_read(net, tmp_path):
    path = tmp_path / "killed.mcap"
    recorder = record(net, path)
    net.publish(range(20))
    net.wait(lambda: len(samples(path)) == 20 * PER_TICK)
    net.publish(range(20, 40))
    recorder.end(signal.SIGKILL)
    kept = samples(path)
    published = [(stamp_of(n), key) for n in range(40) for key in tick(0)]
    assert len(kept) >= 20 * PER_TICK
    assert [(sample.stamp, sample.key) for sample in kept] == published[: len(kept)]
    done = here("info", path, "--json")
    assert_one_line(done, 0, "the end of the file is missing")
    assert msgspec.json.decode(done.stdout)["count"] == len(kept)


def test_malformed_samples_are_counted_and_others_recorded_once(net, tmp_path):
    path = tmp_path / "some.mcap"
    recorder = record(net, path, "odom", "target/*", "o$*", "**/observation", "cmd_vel")
    for payload in (b"", b"{", b'{"linear":1}', b"\xff"):
        net.bus.put_bytes("cmd_vel", payload, JSON_ENCODING)
    net.bus.put_bytes("cmd_vel", b"{}", JSON_ENCODING, b"no stamp")
    for number in range(2):
        for key in ("odom", "target/observation"):  # each matches several expressions
            net.bus.publisher(keys.topic_of(key)).put(tick(number)[key], stamp_of(number))
    assert "4 samples, 5 refused or dropped" in finish(net, recorder, path, 4)
    assert [s.key for s in samples(path)] == ["odom", "target/observation"] * 2


def test_wrong_arguments_are_one_line(net, make_recording, tmp_path):
    path, cut = make_recording(), tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:80])  # holds nothing, which must not look like a success
    net.bus.declare_alive("physics")
    for arguments, words in (
        (("record", "a//b", "-o", tmp_path / "x.mcap"), "a//b"),
        (("replay", path, "--keys", "odom"), "a simulation runs there"),
        (("replay", path, "--robot", "two"), "--through"),
        (("replay", path, "--through", "follower"), "no run with its configuration"),
    ):
        done = net.run(*arguments)
        assert_one_line(done, done.returncode, "error: ", words)
    assert_one_line(here("info", cut), 1, "no sample in it, and its end is missing")
    assert not (tmp_path / "x.mcap").exists()


def test_a_replay_serves_the_descriptions_of_the_robots(net, tmp_path):
    path, served = tmp_path / "described.mcap", []
    with closing(RecordingWriter(path)) as writer:
        writer.write_run(stamp_of(0), to_toml(CONVOY))
        for number in range(2):
            stamp = stamp_of(number)
            writer.write("two/odom", odometry(number), stamp, stamp.time_ns)
    net.bus.subscribe(keys.of_robot(keys.ODOM, "two"), lambda *_: served.append(1))
    net.start("replay", path, "--loop")
    net.wait(lambda: bool(served))
    for name in CONVOY.names:
        description = ask_description(net.bus, name, timeout_s=10.0)
        assert description == Recording(path).descriptions()[name]
        assert description.meshes == build_meshes(CONVOY.of(name).robot)


def test_replay_keeps_stamps_and_loops(net, make_recording):
    path, received = make_recording(range(4)), []
    net.bus.subscribe(keys.CMD_VEL, lambda *sample: received.append(sample), every=True)
    net.bus.subscribe(keys.ODOM, lambda *_: pytest.fail("not asked for"), every=True)
    options = ("--keys", "cmd_vel", "--from", 0.01, "--to", 0.02)
    assert "2 samples" in net.run("replay", path, *options).stdout
    net.wait(lambda: len(received) == 2)
    assert received == [(tick(n)["cmd_vel"], stamp_of(n)) for n in (1, 2)]
    net.start("replay", path, *options, "--loop")
    net.wait(lambda: len(received) >= 8)
    assert [stamp for _, stamp in received[2:8]] == [
        stamp_of(n, run) for run in (7, 8, 9) for n in (1, 2)
    ]


def test_info_has_counts_rates_gaps_robots_and_seeds(tmp_path):
    path = tmp_path / "gaps.mcap"
    with closing(RecordingWriter(path)) as writer:
        writer.write_run(stamp_of(0), "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\n")
        for number in [*range(10), *range(15, 20), *range(22, 30)]:
            stamp = stamp_of(number)
            writer.write("cmd_vel", Twist(), stamp, stamp.time_ns)
        writer.write("two/odom", odometry(0), stamp_of(0, 8, 11), 0)  # a robot's own seed
        writer.write_bytes("my/[/key]\x1b[2J", b"x", "text/plain", None, 0)
    info = inspect(Recording(path))
    cmd_vel, mine, odom = info.keys
    assert (cmd_vel.key, cmd_vel.type, cmd_vel.count) == ("cmd_vel", "geometry_msgs/msg/Twist", 23)
    assert cmd_vel.rate_hz == pytest.approx(100.0)
    assert (cmd_vel.gaps, cmd_vel.longest_gap_s) == (2, pytest.approx(0.06))
    assert (mine.type, mine.count, mine.rate_hz, mine.gaps) == ("text/plain", 1, None, 0)
    assert (odom.key, odom.type) == ("two/odom", "nav_msgs/msg/Odometry")
    assert (info.count, info.is_cut_off, info.duration_s) == (25, False, pytest.approx(0.29))
    assert [(r.run, r.seed, r.robots) for r in info.runs] == [(7, 3, ("one", "two")), (8, 11, ())]
    assert r"my/[/key]\u001b[2J" in here("info", path).stdout


def test_the_service_records_the_services_of_its_scenario(program, tmp_path):
    config = RecorderConfig(file=OutputFile(tmp_path / "run.mcap"), keys=("odom", "diagnostics/*"))
    scenario = Scenario(
        robot=load_robot(),
        services=("follower", "recorder"),
        programs={"follower": program()},
        recorder=config,
    )
    bus = Bus()
    worker = Worker(Host([("follower", "")], bus, scenario))
    recorder = observe("recorder", bus, scenario)
    odom, clock = bus.publisher(keys.ODOM), bus.publisher(keys.CLOCK)
    for number in (0, 100, 200):
        clock.put(keys.CLOCK.type(), stamp_of(number))
        odom.put(odometry(number), stamp_of(number))
        while worker.step():
            pass
    recorder.close()
    recording = Recording(tmp_path / "run.mcap", trusted=True)
    by_key = Counter(sample.key for sample in recording.samples())
    assert by_key == {"odom": 3, "diagnostics/follower": 3, "diagnostics/recorder": 3}
    assert recording.scenarios == {7: to_toml(scenario)}
    # its last diagnostics are themselves the ninth sample, and were written after the count
    assert recorder.diagnostics() == {"recorded": 9}
