"""The manners that a scenario chooses."""

import pytest
from harness import load_robot
from mecazen.config import CrowdConfig, Scenario
from mecazen.geometry import Pose2D
from mecazen_people.manners.choice import make_walkers
from mecazen_people.manners.helbing import Pedestrians
from mecazen_people.manners.planned import Planned
from mecazen_people.manners.walking import Errand


@pytest.mark.parametrize(
    ("manners", "made"), [("helbing", Pedestrians), ("orca", Planned), ("sfm", Planned)]
)
def test_a_scenario_chooses_the_manners(manners, made):
    scenario = Scenario(robot=load_robot(), crowd=CrowdConfig(manners=manners))
    walkers = make_walkers(scenario, [Errand(Pose2D(), ((3.0, 0.0),))], 1)
    assert type(walkers) is made
    for step in range(1, 30):
        walkers.step(0.1 * step, 0.1, [])
    assert walkers.motions[0].pose.x > 1.5
