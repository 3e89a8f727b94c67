"""A person walks out of sight behind a corner: the robot searches and finds them again."""

from harness import SCENARIOS
from mecazen.loading import load_scenario
from mecazen_tools.simulation import Simulation
from mecazen_tools.table import Table

SETTINGS = {
    "seed": 101,
    "programs.physics": "mecazen_tools.plane:Plane",
    "sim.duration_s": 20.0,
    "follower.control": {"kind": "polar", "max_speed_m_s": 0.7},
    "target.path": {
        "kind": "waypoints",
        "speed_m_s": 1.1,
        "points_m": [[0, 0], [3.5, 0], [4.7, 0.3], [5, 1.5], [5, 6.0]],
        "start_after_s": 1.0,
    },
    "world.walls": [
        {"points_m": [[-3, -1], [6, -1], [6, 9], [4, 9], [4, 1], [-3, 1], [-3, -1]]},
    ],
}


def test_a_person_behind_a_corner_is_found_again():
    scenario = load_scenario(SCENARIOS / "safety.toml", SETTINGS)
    with Simulation(scenario) as sim:
        sim.run()
        table, contacts = Table.of(sim.trajectory), sim.trajectory.contacts()
    states = [state for state in dict.fromkeys(table.tracking) if state]
    assert states == ["waiting", "following", "coasting", "searching"]
    assert table.tracking[-1] == "following"
    person, estimate = table.poses("target").at(-1), table.poses("estimate").at(-1)
    assert person.distance(estimate) < 0.5
    assert (contacts.persons, contacts.obstacles) == (0, 0)
