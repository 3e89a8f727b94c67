"""A robot in the place of physics, from commands to frames and back; and its link to the board."""

import errno
import os
import pty
import signal
import statistics
import subprocess
import sys
import threading
import time
import tty
from contextlib import contextmanager
from itertools import pairwise
from unittest.mock import Mock

import pytest
import serial
from hardware.stand import MOTION, RESET, ROBOT, STOP_WITHIN_S, emulated, linked, until
from harness import Listener, Newest, error_of
from hypothesis import given
from hypothesis import strategies as st
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import HardwareConfig, Scenario, SimConfig
from mecazen.errors import BusError, ConfigError
from mecazen.geometry import Twist2D
from mecazen.messages import Empty, JointState, SpeedRequest, Twist
from mecazen.programs import graph_of
from mecazen.robot import WHEEL_JOINTS, RealMotors
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.driver import compensated
from mecazen_hardware.keeper import DRIVE, STOP, keep
from mecazen_hardware.link import HardwareError, Link
from mecazen_hardware.node import HardwareNode
from mecazen_physics.motors import MotorModel

SERVICES = ("hardware", "controller")
AHEAD = Twist2D(0.5, 0.0, 0.0)


def scenario(port="/dev/ttyUSB0", **sections):
    hardware = HardwareConfig(port=port)
    return Scenario(**{"robot": ROBOT, "services": SERVICES, "hardware": hardware, **sections})


def speed(motion):
    """Return the forward speed that a frame of motion commands [m/s]."""
    return int.from_bytes(motion[1:3], "little", signed=True) / 1000.0


class Running:
    """The services in one process; a driver ticks by the wall clock."""

    def __init__(self, whole):
        self.bus = Bus()
        topics = (keys.ODOM, keys.IMU, keys.BATTERY_STATE, keys.JOINT_STATES)
        self.newest = {topic: Newest(self.bus, topic) for topic in topics}
        self.odometry = Listener(self.bus, keys.ODOM)
        self.host = Host([(name, "") for name in whole.services], self.bus, whole)
        self.clock = Clock(self.host)
        self.clock.begin()

    def drive(self, duration_s, twist=None):
        for _ in range(round(duration_s / 0.01)):
            if twist is not None:
                self.bus.publisher(keys.CMD_VEL).put(Twist.planar(twist), None)
            self.clock.step()

    def command_wheels(self, duration_s, **values):
        command = JointState(name=WHEEL_JOINTS, **values)
        for _ in range(round(duration_s / 0.01)):
            self.bus.publisher(keys.JOINT_COMMAND).put(command, None)
            self.clock.step()

    @property
    def x_m(self):
        return self.newest[keys.ODOM].pose.x

    @property
    def health(self):
        (service,) = (service for service in self.host.services if service.name == "hardware")
        return service.diagnostics()


@contextmanager
def running(emulator, **sections):
    run = Running(scenario(emulator.line.name, **sections))
    try:
        yield run
    finally:
        run.host.close()


def rolled_m(emulator):
    return sum(emulator.world.angles) / 4 * ROBOT.wheels.radius_m


def test_a_command_moves_the_wheels_and_odometry_follows():
    with emulated() as emulator, running(emulator) as run:
        run.drive(2.0, AHEAD)
        # two cycles of the board at 0.5 m/s
        assert run.x_m == pytest.approx(rolled_m(emulator), abs=0.041)
        # of the last second: where a busy machine reads a report late, one speed is too high or low
        speeds = [odom.message.twist.twist.linear.x for odom in run.odometry.take()]
        assert statistics.fmean(speeds[-100:]) == pytest.approx(0.5, abs=0.1)
        assert run.newest[keys.BATTERY_STATE].message.voltage == pytest.approx(12.0, abs=0.1)
        assert run.newest[keys.IMU].message.linear_acceleration.z == pytest.approx(9.81)
        assert run.newest[keys.JOINT_STATES].message.name[0] == "front_left_wheel_joint"
        # the emulated board loses a frame if a busy machine lets it read late
        assert emulator.firmware.lost <= emulator.firmware.taken // 20
        assert "warning/motors" not in run.health
        run.drive(1.5)  # a command is 0.5 s old, and then the robot takes 0.5 s to rest
        assert not any(emulator.firmware.goal)
        assert "warning/motors" not in run.health
        run.clock.reset(1)
        run.clock.begin()
        run.drive(0.1)
        assert abs(run.x_m) < 0.1  # a new run begins at the start


def test_without_wheel_commands_the_robot_brakes_and_stops():
    with emulated() as emulator, running(emulator, services=("hardware",)) as run:
        run.command_wheels(0.5, velocity=(10.0,) * 4)
        commanded_s = time.monotonic()
        run.drive(1.0)
        log = [entry for entry in emulator.firmware.log if entry[0] > commanded_s]
        braking = [t for t, function, rest in log if function == MOTION and speed(rest) < 0.3]
        stopped = [t for t, function, _ in log if function == RESET]
        assert braking[0] - commanded_s < 0.4
        assert stopped[0] - commanded_s < STOP_WITHIN_S
        assert "no command" in run.health["warning/motors"]


@pytest.mark.parametrize("wrong", [{"effort": (1.0,) * 4}, {"velocity": (float("nan"),) * 4}])
def test_commands_without_finite_speeds_stop_the_motors(wrong):
    with emulated() as emulator, running(emulator, services=("hardware",)) as run:
        run.command_wheels(0.3, velocity=(10.0,) * 4)
        assert any(emulator.firmware.goal)
        run.command_wheels(0.6, **wrong)
        until(lambda: not any(emulator.firmware.goal))


def test_the_emergency_stop_holds_until_it_is_released():
    with emulated() as emulator, running(emulator) as run:
        run.drive(0.5, AHEAD)
        run.bus.publisher(keys.EMERGENCY_STOP).put(Empty(), None)
        run.drive(0.5, AHEAD)
        assert not any(emulator.firmware.goal)
        assert "emergency stop" in run.health["warning/motors"]
        assert run.bus.call(keys.RELEASE_MOTORS, Empty()).data == "released"
        run.drive(0.5, AHEAD)
        assert any(emulator.firmware.goal)
        assert run.bus.call(keys.STOP_MOTORS, Empty()).data == "stopped"
        until(lambda: not any(emulator.firmware.goal))


def test_low_battery_stops_the_motors():
    with emulated() as emulator, running(emulator) as run:
        run.drive(0.3, AHEAD)
        emulator.world.battery_v = 9.0
        run.drive(1.7, AHEAD)
        assert not any(emulator.firmware.goal)
        assert not emulator.firmware.is_latched
        assert "battery was at 9.0 V" in run.health["warning/motors"]


def test_silent_board_stops_the_motors_and_driver():
    with emulated() as emulator, running(emulator) as run:
        run.drive(0.5, AHEAD)
        emulator.line.is_silent = True
        run.drive(0.4, AHEAD)
        assert run.health["warning/motors"] == "stopped: no report of the board"
        assert emulator.firmware.stopped_after_s < STOP_WITHIN_S
        with pytest.raises(HardwareError, match=r"the board has been silent for 1\.0 s"):
            run.drive(2.0)


def test_damaged_frames_both_ways_change_little():
    with emulated(damage=0.1) as emulator, running(emulator) as run:
        run.drive(2.0, AHEAD)
        assert run.x_m == pytest.approx(rolled_m(emulator), abs=0.08)
        assert run.x_m > 0.4


def test_what_a_real_robot_has_not_is_refused():
    for mode, settings, words in (
        ("lockstep", {}, "runs in real time"),
        ("real_time", {"speed": 2.0}, "must be 1"),
    ):
        with pytest.raises(ConfigError, match=words):
            HardwareNode(scenario(sim=SimConfig(mode=mode, **settings)))
    with pytest.raises(ConfigError, match=r"target needs ground_truth/odom, which a real robot"):
        graph_of(scenario(services=("hardware", "controller", "target")))
    with pytest.raises(ValueError, match="hardware takes the place of physics"):
        scenario(services=("hardware", "physics"))
    with emulated() as emulator, running(emulator) as run:
        with pytest.raises(BusError, match="the time of a real robot is the wall clock"):
            run.bus.call(keys.SIM_SPEED, SpeedRequest(speed=2.0))
        assert "<robot" in run.bus.call(keys.ROBOT_DESCRIPTION, Empty()).data


MOTORS = RealMotors(dead_band_rad_s=1.5, gains=(1.1, 0.9, 1.0, 0.95))


@given(st.tuples(*[st.floats(0.1, 30.0) | st.floats(-30.0, -0.1)] * 4))
def test_physics_motors_turn_as_wanted_when_compensated(wanted):
    model = MotorModel(MOTORS, 0.005)
    model.give(compensated(WheelSpeeds(*wanted), MOTORS))
    assert list(model.step(1.0)) == pytest.approx(list(wanted))
    assert compensated(WheelSpeeds(0.0, 0.04, -0.04, 0.0), MOTORS) == WheelSpeeds()
    assert compensated(WheelSpeeds(*wanted), None) == wanted


FORWARD = WheelSpeeds(10.0, 10.0, 10.0, 10.0)

DRIVING = """
import sys, time
from contextlib import closing
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.link import Link
with closing(Link(HardwareConfig(port=sys.argv[1]), ROBOT)) as link:
    print("driving", flush=True)
    for _ in range(1000):
        link.drive(WheelSpeeds(10.0, 10.0, 10.0, 10.0))
        time.sleep(0.02)
        {then}
"""


@contextmanager
def driving(emulator, then):
    """Yield a process that drives the wheels, once they turn."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVING.format(then=then), emulator.line.name],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout.readline() == "driving\n"
        until(lambda: emulator.firmware.driving)
        yield process
        until(lambda: not any(emulator.firmware.goal))
        assert emulator.firmware.stopped_after_s < STOP_WITHIN_S
    finally:
        process.kill()
        process.communicate()


def drive_for(duration_s, link):
    for _ in range(round(duration_s / 0.01)):
        link.drive(FORWARD)
        link.read()
        time.sleep(0.01)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP, "1 / 0"])
def test_the_motors_stop_however_the_driver_ends(end):
    is_signal = isinstance(end, signal.Signals)
    with emulated() as emulator, driving(emulator, "pass" if is_signal else end) as process:
        if is_signal:
            process.send_signal(end)


def test_newest_of_frequent_frames_is_sent(monkeypatch):
    with emulated() as emulator, linked(emulator) as link:
        assert link.identity.name == "ROSMASTER X3, firmware 3.5"
        written, write = [], link.port.write
        monkeypatch.setattr(
            link.port,
            "write",
            lambda frame: written.append((time.monotonic(), frame)) or write(frame),
        )
        speeds = [WheelSpeeds(*[speed] * 4) for speed in (2.0, 4.0, 6.0, 8.0)]
        for speed in speeds:
            link.drive(speed)
        link.stop()
        link.drive(speeds[-1])
        until(lambda: emulator.firmware.goal == pytest.approx([8.0 * 32.5] * 4, abs=1.0))
        frames = [frame for _, frame in written]
        assert frames[-5:] == [*link.board.stop(), link.board.drive(speeds[-1])[0]]
        assert len(frames) <= 7
        gaps = [after - before for (before, _), (after, _) in pairwise(written)]
        assert min(gaps) >= link.board.SPACING_S


def test_without_its_keeper_the_driver_stops_and_ends():
    with emulated() as emulator:
        with linked(emulator) as link:
            link.drive(FORWARD)
            until(lambda: any(emulator.firmware.goal))
            link.keeper.kill()
            link.keeper.wait()
            with pytest.raises(HardwareError, match=r"in an emergency was killed; start again$"):
                drive_for(10.0, link)
            assert any(emulator.firmware.goal)  # the board keeps its last command
        until(lambda: not any(emulator.firmware.goal))


def test_keeper_stops_the_motors_after_silence():
    received, beat = os.pipe()
    board, port = os.pipe()
    stops = []
    frames = [b"zero", b"reset"]
    thread = threading.Thread(
        target=lambda: stops.append(keep(port, received, 0.1, 0.001, frames)), daemon=True
    )
    thread.start()
    os.write(beat, DRIVE)
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    os.write(beat, DRIVE)
    os.write(beat, STOP)
    thread.join(0.3)  # a driver at rest may be silent
    os.close(beat)
    thread.join()
    assert os.read(board, 4) + os.read(board, 5) == b"zeroreset"
    assert stops == [2]
    for fd in (received, board, port):
        os.close(fd)


def error(kind=HardwareError, **settings):
    return error_of(kind, lambda: Link(HardwareConfig(**settings), ROBOT))


def test_what_can_not_be_opened_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr("mecazen_hardware.link.BUSY_FOR_S", 0.1)
    assert "no board 'math:pi': " in error(ConfigError, board="math:pi")
    assert "none.py: can't be imported" in error(ConfigError, board="/none.py:MyBoard")
    with emulated() as emulator, linked(emulator):
        assert "in use by another program" in error(port=emulator.line.name)
    for number, reason in (
        (errno.EACCES, "no permission; `sudo usermod -aG "),
        (errno.EIO, "can't be opened: "),
    ):
        refusal = serial.SerialException(number, "refused")
        monkeypatch.setattr(serial, "Serial", Mock(side_effect=refusal))
        assert f"/dev/null: {reason}" in error(port="/dev/null")


@pytest.mark.parametrize(
    ("sent", "reason"), [(b"", "nothing answers"), (b"$GPGGA,123519", "not a rosmaster_x3")]
)
def test_a_port_without_this_board_is_named(sent, reason, monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    board_end, port_end = pty.openpty()
    tty.setraw(port_end)
    talking = threading.Timer(0.2, os.write, (board_end, sent))  # opening a port empties it
    talking.start()
    assert reason in error(port=os.ttyname(port_end))
    talking.join()
    os.close(board_end)
    os.close(port_end)


def test_a_board_of_another_car_is_named(monkeypatch):
    monkeypatch.setattr("mecazen_hardware.link.ANSWER_S", 0.5)
    with emulated(car_type=5) as emulator:
        assert "set to the car R2" in error(port=emulator.line.name)
        assert not emulator.firmware.driving
