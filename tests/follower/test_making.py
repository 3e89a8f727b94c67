"""The control law and the planner are those that the configuration selects."""

from follower.rooms import BODY, CAMERA, DRIVE
from mecazen.config import FollowerConfig
from mecazen.config.follower import PidControl, PlannerConfig, PolarControl
from mecazen_follower.making import make_controller, make_planner
from mecazen_follower.pid import PoseController
from mecazen_follower.polar import PolarController


def test_the_control_says_which_controller():
    for control, kind in ((PidControl(), PoseController), (PolarControl(), PolarController)):
        assert isinstance(make_controller(FollowerConfig(control=control)), kind)


def test_only_a_follower_that_plans_has_a_planner():
    sizes = DRIVE, BODY, CAMERA, 1
    assert make_planner(FollowerConfig(), *sizes) is None
    assert make_planner(FollowerConfig(planner=PlannerConfig(samples=2)), *sizes) is not None
