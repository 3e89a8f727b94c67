"""Somebody who is followed at speed stops hard: the gap that is left."""

import pytest
from harness import ROBOTS
from mecazen import keys
from mecazen.loading import from_tables
from mecazen_experiments.fuzz import BRAKING_M_S2, from_outline
from mecazen_tools.observe import observe

STOPS_AT = 400
"""The tick; the robot has caught up by then."""


@pytest.mark.parametrize(
    ("speed", "standoff", "least_m"), [(1.8, 1.0, 0.15), (1.0, 0.6, 0.1)], ids=["fast", "near"]
)
def test_the_robot_stops_behind_somebody_who_stops_hard(speed, standoff, least_m):
    scenario = from_tables(
        {
            "robot": "nexus.toml",
            "seed": 1,
            "programs": {"physics": "mecazen_experiments.fuzz:Plane"},
            "sim": {"duration_s": 5.5},
            "start": {"x_m": -standoff},
            "sensor": {"kind": "fused"},
            "follower": {"view": "back", "standoff_m": standoff},
            "target": {"path": {"kind": "driven"}},
        },
        ROBOTS / "x.toml",
    )
    walks = 0.0

    def walk(tick, _):
        nonlocal walks
        step = 0.015 if tick <= STOPS_AT else BRAKING_M_S2 * 0.01
        walks += min(max((speed if tick <= STOPS_AT else 0.0) - walks, -step), step)
        return {"target/cmd_vel": b'{"linear":{"x":%f}}' % walks}

    found = observe(scenario, keys.GROUND_TRUTH, keys.TARGET_ODOM, drive=walk)
    places = [[o.pose.pose.to_planar() for o in those] for those in found.samples.values()]
    gaps = [
        from_outline(at, scenario.robot.footprint, who.x, who.y) - scenario.world.person.radius_m
        for at, who in zip(*places, strict=False)
    ]
    assert min(gaps) >= least_m
    # it has followed, if at a larger distance
    assert places[0][STOPS_AT].distance(places[1][STOPS_AT]) < 2.0
