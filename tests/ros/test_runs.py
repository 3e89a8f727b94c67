"""A run that ROS drives is recorded once, and computed again to the bit."""

import json
import math
import time

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.graph import OBSERVERS
from mecazen.loading import load_scenario
from mecazen.messages import Empty
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools.simulate import simulate, simulate_distributed

TELEOP = SCENARIOS / "teleop.toml"
TWIST = "geometry_msgs/msg/Twist"
STEP = "simulation_interfaces/srv/StepSimulation"
AGAIN_S = 1.0
SPEEDS = (-0.25, 0.125, -0.5)
TICKS = 50


@pytest.fixture(scope="module")
def recorded(up, ros_side, raw_node, tmp_path_factory):
    """A recording of a run that is paused while a command comes, and resumed by ROS's services."""
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    services = [one for one in load_scenario(TELEOP).services if one not in OBSERVERS]
    running = up(
        TELEOP,
        f"processes={json.dumps([services])}",
        f"services={json.dumps([*services, 'recorder'])}",
        f"recorder.file={json.dumps(str(path))}",
    )
    side = ros_side(running.endpoint)
    raw_node(running.endpoint).hear("0/**")  # so that all is published in ROS as well
    prefix = f"/{running.scenario.bus.namespace}"
    running.bus.call(keys.SIM_PAUSE, Empty())

    def commands() -> list[float]:
        found = [one for one in Recording(path).samples() if one.key == keys.CMD_VEL.key]
        return [one.message(keys.CMD_VEL.type).linear.x for one in found]

    def publish(speed: float) -> None:
        """Publish a speed until it is recorded: the first samples, or some of many, may be lost."""
        published_s = -math.inf

        def is_recorded() -> bool:
            nonlocal published_s
            if time.monotonic() > published_s + AGAIN_S:
                published_s = time.monotonic()
                side("publish", f"{prefix}/cmd_vel", TWIST, {"linear": {"x": speed}})
            return commands()[-1:] == [speed]

        running.wait(is_recorded)

    publish(0.0)
    for speed in SPEEDS:
        publish(speed)
        answer = side("call", f"{prefix}/step_simulation", STEP, {"steps": TICKS})
        assert answer["result"]["result"] == 1
    running.supervisor.stop()
    return Recording(path)


def test_what_ros_publishes_is_recorded_once_as_commands_without_a_stamp_and_obeyed(recorded):
    samples = list(recorded.samples())
    assert not [one.key for one in samples if "dds_" in one.key]
    commands = [one for one in samples if one.key == keys.CMD_VEL.key]
    assert all(one.stamp is None for one in commands)
    assert {one.message(keys.CMD_VEL.type).linear.x for one in commands} == {0.0, *SPEEDS}
    *_, wheels = (one for one in samples if one.key == keys.JOINT_COMMAND.key)
    assert wheels.message(keys.JOINT_COMMAND.type).velocity[0] < -1.0


@pytest.mark.parametrize("node", ["guard", "controller", "odometry", "target", "lidar"])
def test_each_node_computes_the_same_from_what_is_recorded(recorded, node):
    compared = recompute(recorded, node)
    assert compared.difference is None
    assert sum(compared.counts.values()) >= TICKS * len(SPEEDS) // 10


def test_ros_changes_no_trajectory():
    path, settings = SCENARIOS / "back.toml", ("sim.duration_s=2.0", "seed=7")
    alone = simulate(load_scenario(path, settings), "back")[0].trajectory_sha256
    seen = simulate_distributed(path, (*settings, "bus.ros2=true"), "back")[0]
    assert seen.trajectory_sha256 == alone
