"""The nodes of perception: from what is sensed to observations."""

import pytest
from follower.rooms import legs, scan
from follower.skeletons import skeleton
from harness import SCENARIOS
from mecazen.geometry import Pose2D
from mecazen.keys import SCAN, SKELETONS
from mecazen.loading import load_scenario
from mecazen.messages import Header, Skeletons
from mecazen.node import Inputs, Tick
from mecazen_follower.perception.node import Body, Legs

HERE = Pose2D(1.0, 0.0, 0.2)


def test_the_nodes_answer_with_observations_in_base_link():
    scenario = load_scenario(SCENARIOS / "senses.toml")
    tick = Tick(number=0, time_ns=0, period_s=0.04)
    frame = Skeletons(header=Header(frame_id="base_link"), skeletons=(skeleton(HERE),))
    (seen,) = Body(scenario).step(tick, Inputs({SKELETONS: frame})).values()
    assert seen.ids == ("7",)
    assert seen.poses[0].pose.to_planar().distance(HERE) < 1e-9
    lidar_x = scenario.robot.lidar.position_m[0]
    inputs = Inputs({SCAN: scan(Pose2D(), legs(1.0, 0.0))})
    (found,) = Legs(scenario).step(tick, inputs).values()
    assert found.header.frame_id == "base_link"
    assert found.poses[0].pose.position.x == pytest.approx(1.0 + lidar_x, abs=0.03)
