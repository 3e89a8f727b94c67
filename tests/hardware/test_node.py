"""A robot in the place of physics, from commands to frames and from reports to odometry."""

import statistics
import time
from contextlib import contextmanager

import pytest
from hardware.stand import MOTION, RESET, ROBOT, Requested, emulated, until
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import GuardConfig, HardwareConfig, Scenario, SensorConfig, SimConfig
from mecazen.errors import BusError, ConfigError
from mecazen.geometry import Twist2D
from mecazen.messages import Empty, JointState, SpeedRequest, Twist
from mecazen.programs import graph_of
from mecazen.robot import WHEEL_JOINTS
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen_hardware.errors import HardwareError
from mecazen_hardware.node import HardwareNode

SERVICES = ("hardware", "controller")
MOST_S = 0.5
"""Time after the last command within which a stop frame has to come [s]."""


def scenario(port="", **sections):
    hardware = HardwareConfig(port=port or "/dev/ttyUSB0", **sections.pop("hardware", {}))
    return Scenario(**{"robot": ROBOT, "services": SERVICES, "hardware": hardware, **sections})


def speed(motion):
    """Return the forward speed that a frame of motion commands [m/s]."""
    return int.from_bytes(motion[1:3], "little", signed=True) / 1000.0


class Running:
    """The services in one process; a driver ticks by the wall clock."""

    def __init__(self, whole):
        self.bus = LocalBus()
        self.seen = {}
        self.odometry_speeds = []
        """Forward speed in each odometry message so far [m/s]."""
        self.host = Host([(name, "") for name in whole.services], self.bus, whole)
        for topic in (keys.ODOM, keys.IMU, keys.BATTERY_STATE, keys.JOINT_STATES):
            self.bus.subscribe(topic, lambda message, _, topic=topic: self.note(topic, message))
        self.clock = Clock(self.host)
        self.clock.begin()

    def note(self, topic, message):
        self.seen[topic] = message
        if topic is keys.ODOM:
            self.odometry_speeds.append(message.twist.twist.linear.x)

    def drive(self, duration_s, twist=None):
        for _ in range(round(duration_s / 0.01)):
            if twist is not None:
                self.bus.publisher(keys.CMD_VEL).put(Twist.planar(twist), None)
            self.clock.step()

    def command_wheels(self, speed):
        command = JointState(name=WHEEL_JOINTS, velocity=(speed,) * 4)
        self.bus.publisher(keys.JOINT_COMMAND).put(command, None)

    @property
    def health(self):
        (service,) = (one for one in self.host.services if one.name == "hardware")
        return service.diagnostics()


@contextmanager
def running(emulator, **sections):
    run = Running(scenario(emulator.line.name, **sections))
    try:
        yield run
    finally:
        run.host.close()


def test_a_command_moves_the_wheels_and_the_odometry_follows_them():
    with emulated() as emulator, running(emulator) as run:
        run.drive(2.0, Twist2D(0.5, 0.0, 0.0))
        rolled = sum(emulator.world.angles) / 4 * ROBOT.wheels.radius_m
        odometry = run.seen[keys.ODOM]
        # two cycles of the board at 0.5 m/s
        assert odometry.pose.pose.position.x == pytest.approx(rolled, abs=0.041)
        # of the last second: where a busy machine reads a report late, one speed is too high or low
        assert statistics.fmean(run.odometry_speeds[-100:]) == pytest.approx(0.5, abs=0.1)
        assert run.seen[keys.BATTERY_STATE].voltage == pytest.approx(12.0, abs=0.1)
        assert run.seen[keys.IMU].linear_acceleration.z == pytest.approx(9.81)
        assert run.seen[keys.JOINT_STATES].name[0] == "front_left_wheel_joint"
        # the emulated board loses a frame if a busy machine lets it read late
        assert emulator.firmware.lost <= emulator.firmware.taken // 20
        assert "warning/motors" not in run.health


def test_without_commands_the_controller_brakes_to_rest():
    with emulated() as emulator, running(emulator) as run:
        run.drive(1.0, Twist2D(0.5, 0.0, 0.0))
        run.drive(1.5)  # a command is 0.5 s old, and then the robot takes 0.5 s to rest
        assert not any(emulator.firmware.goal)
        assert "warning/motors" not in run.health


def test_once_wheel_commands_stay_away_the_robot_brakes_and_the_motors_are_stopped_in_time():
    with emulated() as emulator, running(emulator, services=("hardware",)) as run:
        for _ in range(50):
            run.command_wheels(10.0)
            run.drive(0.01)
        commanded_s = time.monotonic()
        run.drive(1.0)
        heard = emulator.firmware.heard
        braking = [t for t, function, rest in heard if function == MOTION and speed(rest) < 0.3]
        stopped = [t for t, function, _ in heard if function == RESET and t > commanded_s]
        assert min(t for t in braking if t > commanded_s) - commanded_s < 0.4
        assert stopped[0] - commanded_s < MOST_S
        assert "no command" in run.health["warning/motors"]


def test_the_emergency_stop_holds_against_commands_until_it_is_released():
    with emulated() as emulator, running(emulator) as run:
        run.drive(0.5, Twist2D(0.5, 0.0, 0.0))
        run.bus.publisher(keys.EMERGENCY_STOP).put(Empty(), None)
        run.drive(0.5, Twist2D(0.5, 0.0, 0.0))
        assert not any(emulator.firmware.goal)
        assert "emergency stop" in run.health["warning/motors"]
        assert run.bus.call(keys.RELEASE_MOTORS, Empty()).data == "released"
        run.drive(0.5, Twist2D(0.5, 0.0, 0.0))
        assert any(emulator.firmware.goal)
        assert run.bus.call(keys.STOP_MOTORS, Empty()).data == "stopped"
        until(lambda: not any(emulator.firmware.goal))


def test_the_robot_describes_itself():
    with emulated() as emulator, running(emulator) as run:
        urdf = run.bus.call(keys.ROBOT_DESCRIPTION, Empty()).data
        assert "front_left_wheel_joint" in urdf


def test_a_low_battery_stops_the_motors_before_the_board_switches_itself_off():
    with emulated(Requested({}, {"brownout": 0.3})) as emulator, running(emulator) as run:
        run.drive(2.0, Twist2D(0.5, 0.0, 0.0))
        assert not any(emulator.firmware.goal)
        assert not emulator.firmware.is_latched
        assert "battery was at 9.0 V" in run.health["warning/motors"]


def test_a_board_that_falls_silent_is_told_to_stop_and_then_given_up():
    with emulated(Requested({}, {"silence": 0.5})) as emulator, running(emulator) as run:
        run.drive(0.9, Twist2D(0.5, 0.0, 0.0))
        assert run.health["warning/motors"] == "stopped: no report of the board"
        assert emulator.firmware.stopped_after_s < MOST_S
        with pytest.raises(HardwareError, match=r"the board has been silent for 1\.0 s"):
            run.drive(2.0)


def test_an_encoder_that_jumps_moves_the_odometry_by_no_more_than_a_cycle():
    with emulated(Requested({}, {"jump": 0.5})) as emulator, running(emulator) as run:
        run.drive(1.5, Twist2D(0.5, 0.0, 0.0))
        rolled = sum(emulator.world.angles) / 4 * ROBOT.wheels.radius_m
        # the jump is 5000 counts, 0.77 m of one wheel, which would be 0.19 m
        assert run.seen[keys.ODOM].pose.pose.position.x == pytest.approx(rolled, abs=0.1)
        assert run.health["jumps"] == 2


@pytest.mark.parametrize("damage", ["drop", "corrupt", "cut", "merge"])
def test_damaged_frames_both_ways_change_little(damage):
    with emulated(Requested({damage: 0.1}, {})) as emulator, running(emulator) as run:
        run.drive(2.0, Twist2D(0.5, 0.0, 0.0))
        rolled = sum(emulator.world.angles) / 4 * ROBOT.wheels.radius_m
        assert run.seen[keys.ODOM].pose.pose.position.x == pytest.approx(rolled, abs=0.08)
        assert rolled > 0.4


def test_while_time_is_paused_the_motors_are_stopped():
    with emulated() as emulator, running(emulator) as run:
        run.drive(0.5, Twist2D(0.5, 0.0, 0.0))
        until(lambda: not any(emulator.firmware.goal))  # no tick: as after `sim pause`
        assert emulator.firmware.stopped_after_s < MOST_S


def test_a_new_run_begins_at_rest_at_the_start():
    with emulated() as emulator, running(emulator) as run:
        run.drive(1.0, Twist2D(0.5, 0.0, 0.0))
        run.clock.reset(1)
        run.clock.begin()
        run.drive(0.1)
        assert abs(run.seen[keys.ODOM].pose.pose.position.x) < 0.1  # it came at 0.5 m/s


def test_what_a_real_robot_has_not_is_refused_before_it_moves():
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
    run = Running(scenario("/dev/none", hardware={"dry_run": True}))
    with pytest.raises(BusError, match="the time of a real robot is the wall clock"):
        run.bus.call(keys.SIM_SPEED, SpeedRequest(speed=2.0))
    run.host.close()


def test_a_command_behind_a_guard_expires_as_soon_as_the_guard_counts_on():
    guarded = scenario(sensor=SensorConfig(also=("lidar",)), guard=GuardConfig(hold_s=0.05))
    assert guarded.wheel_timeout_s == 0.05
    assert scenario().wheel_timeout_s == HardwareConfig().command_timeout_s


def test_a_dry_run_opens_no_port_and_prints_the_frames(capsys):
    run = Running(scenario("/dev/none", hardware={"dry_run": True}))
    run.drive(1.0, Twist2D(0.3, 0.0, 0.0))
    run.host.close()
    assert "motion +0.300 m/s +0.000 m/s +0.000 rad/s" in capsys.readouterr().out
    assert run.seen[keys.ODOM].twist.twist.linear.x == pytest.approx(0.3, abs=0.05)
