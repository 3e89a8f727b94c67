"""The guard between whoever drives and the wheels, in whole runs and step by step."""

import math
from contextlib import closing

import pytest
from harness import SCENARIOS
from mecazen import messages as m
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import CMD_VEL, GROUND_TRUTH, GUARD_CMD_VEL, GUARD_STATE, ODOM, SCAN
from mecazen.loading import load_scenario
from mecazen.node import Inputs, Tick
from mecazen.programs import graph_of
from mecazen_guard.node import GuardNode
from mecazen_tools.simulate import InProcess

TELEOP = SCENARIOS / "teleop.toml"
PERSON_RADIUS_M = 0.2


def teleop(*settings):
    return load_scenario(TELEOP, settings)


def run_of(seconds, drive, *settings):
    """Drive by hand; return the robot's true odometry, and what the guard says, by tick."""
    with closing(InProcess(teleop(f"sim.duration_s={seconds}", *settings))) as run:
        truth, states = [], []
        run.bus.subscribe(GROUND_TRUTH, lambda odom, _: truth.append(odom))
        run.bus.subscribe(GUARD_STATE, lambda state, _: states.append(state))
        for tick, _ in enumerate(run.ticks()):
            if (command := drive(tick)) is not None:
                run.bus.put_bytes(CMD_VEL.key, command)
    return truth, states


def test_driving_at_the_person_stops_short_of_them_and_says_why():
    truth, states = run_of(3, lambda tick: b'{"linear":{"x":0.8}}' if tick % 5 == 0 else None)
    half, _ = teleop().robot.footprint
    gap = -truth[-1].pose.pose.position.x - half - PERSON_RADIUS_M  # they stand at the origin
    assert 0.1 < gap < 0.25
    assert abs(truth[-1].twist.twist.linear.x) < 0.01
    seen = [state.state for state in states]
    assert seen[0] == "clear"
    assert seen[-1] == "stop"
    assert "slow" in seen
    assert "m ahead" in states[-1].reason


def test_without_a_guard_the_same_command_runs_into_them():
    drive = lambda tick: b'{"linear":{"x":0.8}}' if tick % 5 == 0 else None  # noqa: E731
    truth, states = run_of(2, drive, "guard.enabled=false")
    half, _ = teleop().robot.footprint
    assert not states
    assert -truth[-1].pose.pose.position.x - half - PERSON_RADIUS_M < 0.01


def test_half_a_second_of_silence_brings_the_robot_to_rest():
    truth, _ = run_of(1.5, lambda tick: b'{"linear":{"y":0.5}}' if tick == 10 else None)
    speeds = [odom.twist.twist.linear.y for odom in truth]
    assert max(speeds) == pytest.approx(0.5, abs=0.03)
    assert speeds[58] > 0.4
    # 0.5 m/s at 2.5 m/s² take 0.2 s
    assert abs(speeds[10 + 50 + 25]) < 0.03


def test_the_controller_obeys_the_guard_alone_where_there_is_one():
    graph = graph_of(teleop())
    assert [i.topic for i in graph.row("controller").inputs][1:] == [GUARD_CMD_VEL]
    assert graph.giver(GUARD_CMD_VEL.key).name == "guard"
    free = graph_of(teleop("guard.enabled=false"))
    assert [i.topic for i in free.row("controller").inputs][1:] == [CMD_VEL]
    assert "guard" not in {row.name for row in free.rows}


class Rig:
    """A guard that is given its inputs by hand."""

    def __init__(self, *settings):
        self.scenario = teleop(*settings)
        self.node = GuardNode(self.scenario)
        self.node.reset(1)
        self.tick, self.age_s = -1, math.inf

    def scan(self, ranges=None, ahead_ns=0):
        config = self.scenario.sensors.lidar
        stamp = m.Time.from_ns(self.tick * 10_000_000 + 10_000_000 + ahead_ns)
        return m.LaserScan(
            header=m.Header(stamp=stamp),
            angle_min=-math.pi,
            angle_increment=math.tau / config.beams,
            range_min=config.min_range_m,
            range_max=config.max_range_m,
            ranges=tuple(ranges or [config.max_range_m + 1.0] * config.beams),
        )

    def step(self, command=None, scan=None, again=False):
        self.tick += not again
        time = m.Time.from_ns(self.tick * 10_000_000)
        odom = m.planar_odometry(time, "odom", "base_link", Pose2D(), Twist2D())
        samples = {ODOM: odom, CMD_VEL: command, SCAN: scan}
        self.age_s = 0.0 if command else self.age_s + 0.01
        inputs = Inputs({k: v for k, v in samples.items() if v}, {CMD_VEL: self.age_s})
        period = 0.0 if again else 0.01
        outputs = self.node.step(Tick(self.tick, time.ns, period), inputs)
        self.refused = inputs.refused
        return outputs[GUARD_CMD_VEL], outputs[GUARD_STATE]


FORWARD = m.Twist.planar(Twist2D(x=0.5))


def test_nothing_is_let_through_before_the_first_scan_and_after_three_that_are_missing():
    rig = Rig()
    let_through, state = rig.step(FORWARD)
    assert (let_through, state.state, state.reason) == (m.Twist(), "blind", "no scan yet")
    let_through, state = rig.step(FORWARD, rig.scan())
    assert (let_through, state.state) == (FORWARD, "clear")
    states = [rig.step(FORWARD)[1] for _ in range(31)]
    assert [state.state for state in states] == ["clear"] * 30 + ["blind"]
    assert states[-1].reason == "the lidar has been silent for 0.3 s"
    assert rig.step(FORWARD, rig.scan())[1].state == "clear"


@pytest.mark.parametrize("what", ["invalid", "few", "ahead"])
def test_an_implausible_scan_is_refused_and_stops_the_robot(what):
    rig = Rig()
    rig.step(FORWARD, rig.scan())
    ranges = {"invalid": [0.0] * 720, "few": [1.0] * 90}.get(what)
    let_through, state = rig.step(FORWARD, rig.scan(ranges, 50_000_000 if what == "ahead" else 0))
    assert (let_through, state.state) == (m.Twist(), "blind")
    assert state.reason
    assert rig.refused[0][0] is SCAN


def test_a_late_command_corrects_its_tick():
    rig = Rig()
    assert rig.step(FORWARD, rig.scan())[0] == FORWARD
    late = m.Twist.planar(Twist2D(y=-0.5))
    assert rig.step(late, again=True)[0] == late
    assert rig.step()[0] == late


def test_it_listens_to_the_key_that_the_controller_names():
    row = GuardNode.row(teleop("controller.command_key=joystick"))
    assert row.on_bus(CMD_VEL).key == "joystick"
