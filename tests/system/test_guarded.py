"""A guarded robot in whole runs, on a plane without slip: it stops short of people and walls."""

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.arrays import to_rectangle
from mecazen.loading import load_scenario
from mecazen_tools.observe import collect
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


def load(name, settings):
    plane = {"programs.physics": "mecazen_tools.plane:Plane"}
    return load_scenario(SCENARIOS / f"{name}.toml", plane | settings)


def run_of(scenario, drive=lambda *_: {}):
    """Return the columns of a run, its contacts, and the guard's states."""
    with Simulation(scenario) as sim:
        (states,) = collect(sim, keys.GUARD_STATE, drive=drive).values()
        return Table.of(sim.trajectory), sim.trajectory.contacts(), states


def person_gaps(scenario, table):
    """Return the gaps between the robot's outline and its person, tick by tick [m]."""
    person = table.poses("robot").between(table.poses("target"))
    gaps = to_rectangle(person.x, person.y, scenario.robot.footprint)
    return gaps - scenario.world.person.radius_m


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


def test_the_guard_lets_the_robot_through_a_door_and_holds_it_before_a_jamb():
    path = {"kind": "straight", "speed_m_s": 0.6, "length_m": 20.0}
    door = {"target.path": path, "world.obstacles": DOOR}
    table, contacts, _ = run_of(load("safety", door | {"sim.duration_s": 8.0}))
    assert table["robot_x_m"][-1] > DOOR_M + 0.3  # all of it
    assert contacts.obstacles == 0
    table, contacts, states = run_of(load("safety", door | BESIDE | {"sim.duration_s": 5.0}))
    assert table["robot_x_m"][-1] < DOOR_M
    assert contacts.obstacles == 0
    assert states[-1].state == "stop"
    assert "m to the left" in states[-1].reason  # it faces the person, and walks to its left
