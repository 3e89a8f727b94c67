"""The follower and the guard in whole runs on a plane: faults, losses, walls and people."""

import re

import numpy as np
import pytest
from harness import SCENARIOS, here, options
from mecazen import keys
from mecazen.arrays import to_rectangle
from mecazen.loading import load_scenario
from mecazen_recorder.reader import Recording
from mecazen_tools.observe import collect, observe
from mecazen_tools.recorded import trajectory_of
from mecazen_tools.run_figure import courses, draw
from mecazen_tools.simulation import Simulation

PLANE = {"programs.physics": "mecazen_tools.plane:Plane"}


def load(name, settings):
    return load_scenario(SCENARIOS / f"{name}.toml", PLANE | settings)


def run_of(scenario, drive=lambda *_: {}):
    """Return the columns of a run, its contacts, and the guard's states."""
    with Simulation(scenario) as sim:
        (states,) = collect(sim, keys.GUARD_STATE, drive=drive).values()
        return sim.trajectory.table(), sim.trajectory.contacts(), states


def test_a_loss_is_explained_at_load_in_the_scores_the_recording_and_the_picture(tmp_path):
    reason = "shoulders not in the camera's view"
    path = tmp_path / "run.mcap"
    settings = {"sensor.kind": "body", "robot.camera.pitch_deg": 0, **PLANE}
    words = options([f"{key}={value}" for key, value in settings.items()])
    done = here("simulate", "back", "--duration", "20", "--record", path, *words)
    assert done.stderr.startswith(f"warning: follower.standoff_m = 1: {reason}; that takes ")
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("lost "))
    assert re.fullmatch(rf"lost \d+% of the time: {reason}", line)
    assert f"  robot: {line}\n" in here("info", path).stdout
    run = trajectory_of(Recording(path))
    figure = draw(courses(run), run.scenario, "")
    assert figure.get_supxlabel() == line
    assert {"coasting", "lost"} <= {text.get_text() for text in figure.legends[0].get_texts()}


ROOM_WITH_A_CORNER = [[-3, -1], [6, -1], [6, 9], [4, 9], [4, 1], [-3, 1], [-3, -1]]
BEHIND_A_CORNER = {
    "seed": 101,
    "sim.duration_s": 20.0,
    "follower.control": {"kind": "polar", "max_speed_m_s": 0.7},
    "target.path": {
        "kind": "waypoints",
        "speed_m_s": 1.1,
        "points_m": [[0, 0], [3.5, 0], [4.7, 0.3], [5, 1.5], [5, 6.0]],
        "start_after_s": 1.0,
    },
    "world.walls": [{"points_m": ROOM_WITH_A_CORNER}],
}


def test_a_person_who_walks_out_of_sight_behind_a_corner_is_found_again():
    table, contacts, _ = run_of(load("safety", BEHIND_A_CORNER))
    states = [state for state in dict.fromkeys(table.tracking) if state]
    assert states == ["waiting", "following", "coasting", "searching"]
    assert table.tracking[-1] == "following"
    person, estimate = table.poses("target").at(-1), table.poses("estimate").at(-1)
    assert person.distance(estimate) < 0.5
    assert (contacts.persons, contacts.obstacles) == (0, 0)


WALL = {"kind": "box", "size_m": [1.8, 0.1, 2.0], "position_m": [3.4, 0.5]}
BESIDE = {"follower.view": "side_left", "start": {"y_m": 1.2, "yaw_deg": -90.0}}


@pytest.mark.parametrize(
    ("settings", "walker", "hidden_s"),
    [
        # through the gap of 1.6 m, after 4 s
        (
            {"world.obstacles": [], "follower.standoff_m": 1.6, "start": {"x_m": -1.6}},
            {"x_m": 1.6, "y_m": 4.4, "yaw_deg": -90.0, "speed_m_s": 1.1, "length_m": 9.0},
            0.0,
        ),
        # side by side, 0.6 m away: nearer to the person than to the pedestrian
        (
            {"world.obstacles": [], "start": {"x_m": -1.2}},
            {"y_m": 0.6, "speed_m_s": 0.6, "length_m": 20.0},
            0.0,
        ),
        # towards the person on the robot's side of a wall, which hides the person meanwhile
        (
            {**BESIDE, "sim.duration_s": 11.0, "world.obstacles": [WALL]},
            {"x_m": 8.5, "y_m": -0.7, "yaw_deg": 180.0, "speed_m_s": 0.8, "length_m": 20.0},
            3.0,
        ),
    ],
    ids=["crossing", "side by side", "behind a wall"],
)
def test_the_robot_keeps_to_its_person(settings, walker, hidden_s):
    path = {"kind": "straight", "speed_m_s": 0.6, "length_m": 20.0}
    crowd = [{"path": {"kind": "straight"} | walker}]
    walks = {"sim.duration_s": 9.0, "target.path": path, "crowd.walkers": crowd}
    run = observe(load("senses", walks | settings), keys.FOLLOWER_STATE)
    (states,) = run.samples.values()
    robot, odom, estimate, person = map(run.table.poses, ("robot", "odom", "estimate", "target"))
    seen = robot.compose(odom.between(estimate))
    errors = np.hypot(seen.x - person.x, seen.y - person.y)
    unseen_s = max(state.last_seen_s for state in states)
    assert unseen_s == pytest.approx(hidden_s, abs=0.5)
    assert {state.tracking for state in states} <= {"waiting", "following", "coasting"}
    assert states[-1].tracking == "following"
    assert np.nanmax(errors) < 0.3 or hidden_s
    assert errors[-1] < 0.1
    # meanwhile the robot stays beside the predicted person
    assert abs(states[-1].distance_error) < 0.1


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


STOPS_AT = 400
"""Tick of the hard stop; the robot has caught up by then."""
BRAKING_M_S2 = 6.0
"""Deceleration of a person who stops hard: from 1.8 m/s in 0.3 s."""


@pytest.mark.parametrize(
    ("speed", "standoff", "least_m"), [(1.8, 1.0, 0.15), (1.0, 0.6, 0.1)], ids=["fast", "near"]
)
def test_a_gap_is_left_behind_a_person_who_stops_hard(speed, standoff, least_m):
    places = {"start.x_m": -standoff, "follower.standoff_m": standoff}
    driven = {"sim.duration_s": 5.5, "target.path": {"kind": "driven"}}
    scenario = load("safety", places | driven)
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
    # a door of 0.9 m in a wall at 2.5 m along x
    box = {"kind": "box", "size_m": [0.1, 4.0, 1.0]}
    wall = [{**box, "position_m": [2.5, y_m]} for y_m in (-2.45, 2.45)]
    door = {"target.path": path, "world.obstacles": wall}
    table, contacts, _ = run_of(load("safety", door | {"sim.duration_s": 8.0}))
    assert table["robot_x_m"][-1] > 2.5 + 0.3  # all of it
    assert contacts.obstacles == 0
    table, contacts, states = run_of(load("safety", door | BESIDE | {"sim.duration_s": 5.0}))
    assert table["robot_x_m"][-1] < 2.5
    assert contacts.obstacles == 0
    assert states[-1].state == "stop"
    assert "m to the left" in states[-1].reason  # it faces the person, and walks to its left
