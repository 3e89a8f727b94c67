"""A guarded robot in whole runs, on a plane without slip: it stops short of people and walls."""

import numpy as np
import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.arrays import to_rectangle
from mecazen.loading import load_scenario
from mecazen.programs import graph_of
from mecazen_tools.observe import collect, watch
from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Table

BRAKING_M_S2 = 6.0
"""Deceleration of a person who stops hard: from 1.8 m/s in 0.3 s."""
STOPS_AT = 400
"""Tick of the hard stop; the robot has caught up by then."""
BESIDE = {"follower.view": "side_left", "start": {"y_m": 1.2, "yaw_deg": -90.0}}
DOOR_M = 2.5
"""Position of the wall along x."""
DOOR = [
    {"kind": "box", "size_m": [0.1, 4.0, 1.0], "position_m": [DOOR_M, y]} for y in (2.45, -2.45)
]
"""The door is 0.9 m wide."""
PILLAR = {"kind": "cylinder", "size_m": [0.2, 2.0], "position_m": [2.0, 0.6]}
"""Robot and person, side by side, pass it one on each side."""


def load(name, settings):
    plane = {"programs.physics": "mecazen_tools.plane:Plane"}
    return load_scenario(SCENARIOS / f"{name}.toml", plane | settings)


def run_of(scenario, drive=lambda *_: {}):
    """Return the columns of a run, its contacts, and the guard's states."""
    with Simulation(scenario) as sim:
        (states,) = collect(sim, keys.GUARD_STATE, drive=drive).values()
        return Table.of(sim.trajectory), sim.trajectory.contacts(), states


def gaps(scenario, robot, place, radius):
    """Return the gaps between the robot's outline and a cylinder, tick by tick [m]."""
    centre = robot.between(place)
    return to_rectangle(centre.x, centre.y, scenario.robot.footprint) - radius


def person_gaps(scenario, table):
    radius = scenario.world.person.radius_m
    return gaps(scenario, table.poses("robot"), table.poses("target"), radius)


def drive_ahead(tick, _):
    return {keys.CMD_VEL.key: b'{"linear":{"x":0.8}}'} if tick % 5 == 1 else {}


def test_driving_at_a_person_stops_with_a_reason():
    scenario = load("teleop", {"sim.duration_s": 3.0})
    table, contacts, states = run_of(scenario, drive_ahead)
    assert contacts.persons == 0
    assert 0.1 < person_gaps(scenario, table)[-1] < 0.25
    assert abs(table["robot_vx_m_s"][-1]) < 0.01
    assert states[0].state == "clear"
    assert states[-1].state == "stop"
    assert "slow" in {state.state for state in states}
    assert "m ahead" in states[-1].reason


def test_without_a_guard_the_robot_hits_the_person():
    scenario = load("teleop", {"sim.duration_s": 2.0, "guard.enabled": False})
    _, contacts, states = run_of(scenario, drive_ahead)
    assert contacts.persons == 1
    assert not states


def test_silence_brings_the_robot_to_rest():
    command = {11: {keys.CMD_VEL.key: b'{"linear":{"y":0.5}}'}}
    scenario = load("teleop", {"sim.duration_s": 1.5})
    table, *_ = run_of(scenario, lambda tick, _: command.get(tick, {}))
    speeds = table["robot_vy_m_s"]
    assert speeds.max() == pytest.approx(0.5, abs=0.03)
    assert speeds[58] > 0.4
    # after 0.5 s without a command, 0.5 m/s at 2.5 m/s² take 0.2 s
    assert abs(speeds[10 + 50 + 25]) < 0.03


def test_the_controller_obeys_the_guard_alone():
    for settings, topic in (({}, keys.GUARD_CMD_VEL), ({"guard.enabled": False}, keys.CMD_VEL)):
        graph = graph_of(load("teleop", settings))
        assert {i.topic.key for i in graph.row("controller").inputs[1:]} == {topic.key}
        assert ("guard" in {row.name for row in graph.rows}) == (topic is keys.GUARD_CMD_VEL)


@pytest.mark.parametrize(
    ("speed", "standoff", "least_m"), [(1.8, 1.0, 0.15), (1.0, 0.6, 0.1)], ids=["fast", "near"]
)
def test_a_gap_is_left_behind_a_person_who_stops_hard(speed, standoff, least_m):
    settings = {
        "sim.duration_s": 5.5,
        "start.x_m": -standoff,
        "follower.standoff_m": standoff,
        "target.path": {"kind": "driven"},
    }
    scenario = load("safety", settings)
    walks = 0.0

    def walk(tick, _):
        nonlocal walks
        is_walking = tick <= STOPS_AT
        step = (1.5 if is_walking else BRAKING_M_S2) * scenario.sim.tick_s
        walks += min(max(speed * is_walking - walks, -step), step)
        return {keys.TARGET_CMD_VEL.key: b'{"linear":{"x":%f}}' % walks}

    table, *_ = run_of(scenario, walk)
    assert person_gaps(scenario, table).min() >= least_m
    # it has followed, if at a larger distance
    robot, person = (table.poses(name).at(STOPS_AT) for name in ("robot", "target"))
    assert robot.distance(person) < 2.0


def narrow(seconds, obstacles, settings):
    path = {"kind": "straight", "speed_m_s": 0.6, "length_m": 20.0}
    world = {"target.path": path, "world.obstacles": obstacles, "sim.duration_s": seconds}
    return load("safety", world | settings)


def test_the_guard_lets_the_robot_through_a_door():
    table, contacts, _ = run_of(narrow(8.0, DOOR, {}))
    assert table["robot_x_m"][-1] > DOOR_M + 0.3  # all of it
    assert contacts.obstacles == 0


def test_the_guard_holds_a_robot_before_a_jamb():
    table, contacts, states = run_of(narrow(5.0, DOOR, BESIDE))
    assert table["robot_x_m"][-1] < DOOR_M
    assert contacts.obstacles == 0
    assert states[-1].state == "stop"
    assert "m to the left" in states[-1].reason  # it faces the person, and walks to its left


@pytest.mark.parametrize("planner", [{}, {"follower.planner": {}}], ids=["law", "planner"])
def test_a_person_behind_a_pillar_is_seen_again(planner):
    scenario = narrow(6.5, [PILLAR], BESIDE | planner)
    run = watch(scenario)
    times, shown = run.sight
    assert 0.2 < np.diff(times[shown]).max() < 2.0  # the person has been hidden
    robot = run.table.poses("robot")
    x, y = PILLAR["position_m"]
    pillar = robot._replace(x=np.full_like(robot.x, x), y=np.full_like(robot.y, y))
    assert gaps(scenario, robot, pillar, PILLAR["size_m"][0]).min() > 0.0
    assert person_gaps(scenario, run.table).min() > 0.0
