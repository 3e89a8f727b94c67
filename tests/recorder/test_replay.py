"""Samples that a replay publishes, and their times."""

from contextlib import closing

import pytest
from harness import Newest, assert_one_line
from mecazen import keys
from mecazen.messages import Clock, Header, Observation, Time
from mecazen.robots import join_key
from mecazen.urdf import RobotDescription, ask_description
from mecazen_recorder.writer import RecordingWriter
from recorder.ticks import odometry, stamp_of, tick

ROBOT = RobotDescription("<robot/>", {"meshes/r.stl": b"solid"})


def test_a_replay_does_not_mix_with_a_simulation_that_runs_but_may_drive_it(net, make_recording):
    net.bus.declare_alive("physics")
    path = make_recording()
    for chosen in ((), ("--keys", "odom"), ("--keys", "*")):
        assert_one_line(net.run("replay", path, *chosen), 1, "a simulation runs there", "cmd_vel")
    assert "20 samples" in net.run("replay", path, "--keys", "cmd_vel").stdout


def test_a_recorded_person_stands_in_for_the_sensors_of_a_real_robot(net, tmp_path):
    net.bus.declare_alive("hardware")
    path, heard = tmp_path / "person.mcap", []
    with closing(RecordingWriter(path, "cdr")) as writer:
        for number in range(50):
            stamp = stamp_of(number)
            captured = Header(stamp=Time.from_ns(max(stamp.time_ns - 20_000_000, 0)))
            seen = Observation(header=captured)
            writer.write("target/observation", seen, stamp, stamp.time_ns)
    net.bus.subscribe(keys.OBSERVATION, lambda *sample: heard.append(sample), every=True)
    net.start("replay", path, "--keys", "target/observation", "--loop")
    clock = Clock(clock=Time(sec=100))

    def comes() -> bool:
        net.bus.publisher(keys.CLOCK).put(clock, None)
        return bool(heard) and heard[-1][0].header.stamp.sec >= 99

    net.wait(comes)
    seen, stamp = heard[-1]
    assert stamp is None
    assert clock.clock.ns - seen.header.stamp.ns in (0, 10_000_000, 20_000_000)


@pytest.mark.parametrize("names", [("",), ("one", "two")], ids=["one robot", "several robots"])
def test_a_replay_tells_what_robots_look_like(net, tmp_path, names):
    path = tmp_path / "described.mcap"
    writer = RecordingWriter(path, "cdr")
    for name in names:
        writer.write_description(RobotDescription(f"<{name}/>", ROBOT.meshes), name)
    for number in range(2):
        stamp = stamp_of(number)
        writer.write(join_key("odom", names[-1]), odometry(number), stamp, stamp.time_ns)
    writer.close()
    odom = Newest(net.bus, keys.of_robot(keys.ODOM, names[-1]))
    net.start("replay", path, "--loop")
    net.wait(lambda: odom.message is not None)
    for name in names:
        described = ask_description(net.bus, name, timeout_s=10.0)
        assert described == RobotDescription(f"<{name}/>", ROBOT.meshes)


def test_a_replay_has_the_original_stamps_and_in_a_loop_new_runs(net, make_recording):
    path = make_recording(range(4))
    heard = []
    net.bus.subscribe(keys.CMD_VEL, lambda *sample: heard.append(sample), every=True)
    net.bus.subscribe(keys.ODOM, lambda *_: pytest.fail("not asked for"), every=True)
    options = ("--keys", "cmd_vel", "--from", 0.01, "--to", 0.02)
    assert "2 samples" in net.run("replay", path, *options).stdout
    net.wait(lambda: len(heard) == 2)
    assert heard == [(tick(n)["cmd_vel"], stamp_of(n)) for n in (1, 2)]
    net.start("replay", path, *options, "--loop")
    net.wait(lambda: len(heard) >= 8)
    assert [stamp for _, stamp in heard[2:8]] == [
        stamp_of(n, run) for run in (7, 8, 9) for n in (1, 2)
    ]
