"""The commands of `mecazen hardware`."""

from hardware.stand import emulated
from harness import assert_one_line, mecazen


def test_a_probe_shows_version_battery_and_encoders_and_no_motor_turns():
    with emulated() as emulator:
        done = mecazen("hardware", "probe", "--port", emulator.line.name)
        assert done.returncode == 0
        assert "ROSMASTER X3, firmware 3.5" in done.stdout
        assert "battery: 12.0 V" in done.stdout
        assert "turned: front_left 0.00 rad" in done.stdout
        assert "WheelAngles: 2" in done.stdout  # 24.4 Hz
        assert not any(emulator.world.angles)


def test_a_check_on_blocks_finds_all_wheels_in_order():
    with emulated() as emulator:
        done = mecazen("hardware", "check", "--yes", "--port", emulator.line.name)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.count(": ok, turned ") == 4


def test_a_check_of_a_robot_whose_plugs_are_swapped_says_which():
    with emulated() as emulator:
        turn = emulator.world.step
        emulator.world.step = lambda duty: turn([duty[1], duty[0], *duty[2:]])
        done = mecazen("hardware", "check", "--yes", "--port", emulator.line.name)
        assert_one_line(done, 1, "2 of 4 wheels are wrong; do not drive yet")
        assert "front_left: rear_left turned instead" in done.stdout


def test_what_can_not_be_probed_is_one_line():
    assert_one_line(mecazen("hardware", "probe", "--port", "/dev/none"), 1, "no such port")
    unknown = ("--board", "none", "--robot", "nexus", "--port", "/dev/null")
    assert_one_line(mecazen("hardware", "probe", *unknown), 2, "no board 'none'; installed: ")


def test_frames_are_fuzzed_and_counted():
    done = mecazen("hardware", "fuzz", "--frames", "2000")
    assert "largest loss: 1" in done.stdout or "largest loss: 0" in done.stdout


def test_the_latency_of_a_driver_is_measured():
    done = mecazen("hardware", "latency", "--duration", "2")
    assert (done.returncode, done.stderr) == (0, "")
    assert "command: p50 " in done.stdout
    assert "report: p50 " in done.stdout
