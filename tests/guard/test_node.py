"""The guard step by step."""

import math

import numpy as np
import pytest
from harness import SCENARIOS, Steps
from mecazen import messages as m
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import CMD_VEL, GUARD_CMD_VEL, GUARD_STATE, ODOM, SCAN
from mecazen.loading import load_scenario, parse_settings
from mecazen_guard.node import GuardNode
from mecazen_guard.surroundings import Surroundings

TELEOP = SCENARIOS / "teleop.toml"


def teleop(*settings):
    return load_scenario(TELEOP, parse_settings(settings))


class Guard(Steps):
    """A guard that is given its inputs by hand."""

    def __init__(self, *settings):
        self.scenario = teleop(*settings)
        self.tick = -1
        super().__init__(GuardNode, self.scenario)

    def scan(self, ranges=None, ahead_ns=0):
        config = self.scenario.sensors.lidar
        stamp = m.Time.from_ns((self.tick + 1) * self.tick_ns + ahead_ns)
        return m.LaserScan(
            header=m.Header(stamp=stamp),
            angle_min=-math.pi,
            angle_increment=math.tau / config.beams,
            range_min=config.min_range_m,
            range_max=config.max_range_m,
            ranges=tuple(ranges or [config.max_range_m + 1.0] * config.beams),
        )

    def drive(self, command=None, scan=None, again=False):
        self.tick += not again
        time = m.Time.from_ns(self.tick * self.tick_ns)
        odom = m.planar_odometry(time, "odom", "base_link", Pose2D(), Twist2D())
        samples = {ODOM: odom, CMD_VEL: command, SCAN: scan}
        outputs = self.step(self.tick, {k: v for k, v in samples.items() if v})
        return outputs[GUARD_CMD_VEL], outputs[GUARD_STATE]


FORWARD = m.Twist.planar(Twist2D(x=0.5))


def test_nothing_is_let_through_before_the_first_scan_and_after_three_that_are_missing():
    guard = Guard()
    let_through, state = guard.drive(FORWARD)
    assert (let_through, state.state, state.reason) == (m.Twist(), "blind", "no scan yet")
    let_through, state = guard.drive(FORWARD, guard.scan())
    assert (let_through, state.state) == (FORWARD, "clear")
    states = [guard.drive(FORWARD)[1] for _ in range(31)]
    assert [state.state for state in states] == ["clear"] * 30 + ["blind"]
    assert states[-1].reason == "the lidar has been silent for 0.3 s"
    assert guard.drive(FORWARD, guard.scan())[1].state == "clear"


@pytest.mark.parametrize("what", ["invalid", "few", "ahead"])
def test_an_implausible_scan_is_refused_and_stops_the_robot(what):
    guard = Guard()
    guard.drive(FORWARD, guard.scan())
    ranges = {"invalid": [0.0] * 720, "few": [1.0] * 90}.get(what)
    scan = guard.scan(ranges, ahead_ns=50_000_000 if what == "ahead" else 0)
    let_through, state = guard.drive(FORWARD, scan)
    assert (let_through, state.state) == (m.Twist(), "blind")
    assert state.reason
    assert guard.refused == [SCAN.key]


def test_a_programming_error_is_not_reported_as_a_refused_scan(monkeypatch):
    guard = Guard()
    monkeypatch.setattr(Surroundings, "update", lambda *_: np.zeros(2) + np.zeros(3))
    with pytest.raises(ValueError, match="shapes"):
        guard.drive(FORWARD, guard.scan())


def test_a_late_command_corrects_its_tick():
    guard = Guard()
    assert guard.drive(FORWARD, guard.scan())[0] == FORWARD
    late = m.Twist.planar(Twist2D(y=-0.5))
    assert guard.drive(late, again=True)[0] == late
    assert guard.drive()[0] == late


def stopping_distance(guard):
    """Return the distance of a wall at which the guard begins to brake a robot at 1 m/s [m]."""
    beams = guard.scenario.sensors.lidar.beams
    angles = [-math.pi + n * math.tau / beams for n in range(beams)]
    command = m.Twist.planar(Twist2D(x=1.0))
    for _ in range(60):
        guard.drive(command, guard.scan())
    for step in range(200):
        wall = 2.0 - 0.01 * step
        ranges = [wall / math.cos(a) if math.cos(a) > 0.2 else 100.0 for a in angles]
        if guard.drive(command, guard.scan(ranges))[1].state != "clear":
            return wall
    raise AssertionError("it lets the robot into the wall")


def test_it_counts_on_the_time_for_which_a_silent_guard_is_obeyed():
    soon, late = (
        stopping_distance(Guard(f"guard.hold_s={held}", "guard.person_margin_m=0.06"))
        for held in (0.0, 0.2)
    )
    # 0.2 s at 1 m/s; the wall comes by steps of 0.01 m
    assert late - soon == pytest.approx(0.2, abs=0.015)


def test_a_guard_that_was_held_up_begins_with_the_motion_of_the_robot_again():
    guard = Guard()
    for _ in range(60):
        guard.drive(m.Twist.planar(Twist2D(x=1.0)), guard.scan())
    guard.tick += 100  # the robot stands, as the odometry says
    guard.drive(FORWARD, guard.scan())
    assert [axis.velocity for axis in guard.node.guard._state] == [0.0, 0.0, 0.0]


def test_another_margin_counts_from_the_next_scan_on_and_what_was_seen_stays():
    guard = Guard()
    wall = [0.5] * guard.scenario.sensors.lidar.beams
    for _ in range(50):
        let_through, state = guard.drive(FORWARD, guard.scan(wall))
    assert let_through.linear.x > 0.1
    guard.node.configure(teleop("guard.margin_m=0.3"))
    _, still = guard.drive(FORWARD)
    assert still.state == state.state != "blind"
    for _ in range(50):
        let_through, state = guard.drive(FORWARD, guard.scan(wall))
    assert (let_through, state.state) == (m.Twist(), "stop")
