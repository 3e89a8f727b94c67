"""The guard in whole runs, driven by hand."""

import pytest
from harness import SCENARIOS
from mecazen.keys import CMD_VEL, GROUND_TRUTH, GUARD_CMD_VEL, GUARD_STATE
from mecazen.loading import load_scenario, parse_settings
from mecazen.programs import graph_of
from mecazen_tools.observe import observe

TELEOP = SCENARIOS / "teleop.toml"
PERSON_RADIUS_M = 0.2


def ahead(tick, _):
    return {CMD_VEL.key: b'{"linear":{"x":0.8}}'} if tick % 5 == 1 else {}


def teleop(*settings):
    return load_scenario(TELEOP, parse_settings(settings))


def run_of(seconds, drive, *settings):
    """Drive by hand; return the robot's true odometry, and what the guard says, by tick."""
    scenario = teleop(f"sim.duration_s={seconds}", *settings)
    found = observe(scenario, GROUND_TRUTH, GUARD_STATE, drive=drive)
    return tuple(found.samples.values())


def test_driving_at_the_person_stops_short_of_them_and_says_why():
    truth, states = run_of(3, ahead)
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
    truth, states = run_of(2, ahead, "guard.enabled=false")
    half, _ = teleop().robot.footprint
    assert not states
    assert -truth[-1].pose.pose.position.x - half - PERSON_RADIUS_M < 0.01


def test_half_a_second_of_silence_brings_the_robot_to_rest():
    once = {11: {CMD_VEL.key: b'{"linear":{"y":0.5}}'}}
    truth, _ = run_of(1.5, lambda tick, _: once.get(tick, {}))
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
