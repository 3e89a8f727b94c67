"""A run that ROS drives is recorded once, and computed again to the bit."""

import json
import math
import time

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.graph import OBSERVERS
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, StepRequest
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools.simulate import simulate, simulate_distributed

TELEOP = SCENARIOS / "teleop.toml"
AGAIN_S = 1.0
SPEEDS = (0.0, -0.25, -0.5)
TICKS = 50


@pytest.fixture
def recorded(up, start_peer, raw_node, tmp_path_factory):
    """A recording of a run that is paused while a command comes from ROS."""
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    services = [part for part in load_scenario(TELEOP).services if part not in OBSERVERS]
    running = up(
        TELEOP,
        f"processes={json.dumps([services])}",
        f"services={json.dumps([*services, 'recorder'])}",
        f"recorder.file={json.dumps(str(path))}",
    )
    peer, cmd_vel = start_peer(running.endpoint), f"/{running.scenario.bus.namespace}/cmd_vel"
    raw_node(running.endpoint).subscribe("0/**")  # so that all is published in ROS as well
    running.bus.call(keys.SIM_PAUSE, Empty())
    for speed in SPEEDS:
        published_s = -math.inf

        def is_recorded(speed: float = speed) -> bool:
            nonlocal published_s  # again and again: the first samples, or some of many, may be lost
            if time.monotonic() > published_s + AGAIN_S:
                published_s = time.monotonic()
                peer("publish", cmd_vel, "geometry_msgs/msg/Twist", {"linear": {"x": speed}})
            return commands(path)[-1:] == [speed]

        running.wait(is_recorded)
        running.bus.call(keys.SIM_STEP, StepRequest(ticks=TICKS))
    running.supervisor.stop()
    return Recording(path)


def commands(path) -> list[float]:
    samples = [sample for sample in Recording(path).samples() if sample.key == keys.CMD_VEL.key]
    assert all(sample.stamp is None for sample in samples)
    return [sample.message(keys.CMD_VEL.type).linear.x for sample in samples]


def test_a_run_that_ros_drives_is_computed_again(recorded):
    samples = list(recorded.samples())
    assert not [sample.key for sample in samples if "dds_" in sample.key]
    *_, wheels = (sample for sample in samples if sample.key == keys.JOINT_COMMAND.key)
    assert wheels.message(keys.JOINT_COMMAND.type).velocity[0] < -1.0
    for node in ("guard", "controller", "odometry"):
        compared = recompute(recorded, node)
        assert compared.difference is None
        assert sum(compared.counts.values()) >= TICKS * len(SPEEDS) // 10


def test_ros_changes_no_trajectory():
    path, settings = SCENARIOS / "back.toml", ("sim.duration_s=2.0", "seed=7")
    alone = simulate(load_scenario(path, parse_settings(settings)), "back")[0].trajectory_sha256
    seen = simulate_distributed(path, (*settings, "bus.ros2=true"), "back")[0]
    assert seen.trajectory_sha256 == alone
