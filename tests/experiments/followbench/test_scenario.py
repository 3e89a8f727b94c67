"""An episode as a scenario: our robot in the place of theirs, people on the same errands."""

import math

import msgspec
import pytest
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.episodes import Density
from mecazen_experiments.followbench.generate import generate, tracks
from mecazen_experiments.followbench.scenario import scenario_of
from mecazen_experiments.safety_old import safety
from mecazen_tools.observe import watch

EPISODE = generate("Parallel", "back", Density(5), 1)


def test_the_same_episode_is_a_scenario_with_our_robot():
    scenario = scenario_of(EPISODE, 3)
    assert scenario.start.pose.x == pytest.approx(EPISODE.robot.x + 0.25)  # its middle
    assert len(scenario.crowd.walkers) == len(EPISODE.humans)
    short = msgspec.structs.replace(
        scenario, sim=msgspec.structs.replace(scenario.sim, duration_s=1.0)
    )
    seen = watch(short)
    assert len(seen.pedestrians) == len(EPISODE.humans)
    assert not safety(seen, short).contacts_person_all


@pytest.mark.parametrize("track", [one.name for one in tracks()])
def test_a_track_is_the_way_of_the_target(track):
    episode = generate(track, "back", Density(0), 3)
    path = scenario_of(episode, 3).target.path
    assert (*path.via_m, path.goal_m) == episode.target.goals


def test_boxes_and_ways_are_those_of_the_episode():
    door = generate("Doorway", "left_side", Density(2, 2.8), 1)
    scenario = scenario_of(door, 1)
    assert len(scenario.world.solids) == len(door.boxes)
    assert scenario.target.path.goal_m == door.target.goals[-1]


@pytest.mark.parametrize(("beside", "view"), [(1.5, "side_left"), (-1.5, "side_right")])
def test_beside_the_target_the_robot_begins_on_its_side_and_looks_at_the_target(beside, view):
    target = EPISODE.target.start
    goal_x = EPISODE.target.goals[0][0]
    left = beside if goal_x > target.x else -beside
    episode = msgspec.structs.replace(
        EPISODE, place="left_side", robot=Pose2D(target.x - 0.25, target.y + left)
    )
    scenario = scenario_of(episode, 1)
    assert scenario.follower.view == view
    assert scenario.start.yaw_deg == pytest.approx(math.degrees(math.copysign(math.pi / 2, -left)))
