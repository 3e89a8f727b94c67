"""A run that ROS drives is recorded once, and computed again to the bit."""

import json

from harness import SCENARIOS
from mecazen import keys
from mecazen.graph import OBSERVERS
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, StepRequest, Twist, Vector3
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_ros import cdr
from mecazen_tools.simulate import simulate, simulate_distributed

TELEOP = SCENARIOS / "teleop.toml"
TICKS = 50


def commands(path) -> list[float]:
    samples = [sample for sample in Recording(path).samples() if sample.key == keys.CMD_VEL.key]
    assert all(sample.stamp is None for sample in samples)
    return [sample.message(keys.CMD_VEL.type).linear.x for sample in samples]


def test_a_run_that_ros_drives_is_computed_again(up, raw_node, tmp_path):
    path = tmp_path / "run.mcap"
    services = [part for part in load_scenario(TELEOP).services if part not in OBSERVERS]
    running = up(
        TELEOP,
        f"processes={json.dumps([services])}",
        f"services={json.dumps([*services, 'recorder'])}",
        f"recorder.file={json.dumps(str(path))}",
    )
    node = raw_node(running.endpoint)
    node.subscribe("0/**")  # so that all is published in ROS as well
    key = node.key_of("MS", f"/{running.scenario.bus.namespace}/cmd_vel", "/Twist")
    running.call(keys.SIM_PAUSE, Empty())
    for speed in (0.0, -0.25, -0.5):

        def is_recorded(speed: float = speed) -> bool:
            node.put(key, cdr.encode(Twist(Vector3(speed))))  # again: some may be lost
            return commands(path)[-1:] == [speed]

        running.wait(is_recorded)
        running.call(keys.SIM_STEP, StepRequest(ticks=TICKS))
    running.supervisor.stop()
    samples = list(Recording(path).samples())
    assert not [sample.key for sample in samples if "dds_" in sample.key]
    for name in ("guard", "controller", "odometry"):
        compared = recompute(Recording(path), name)
        assert compared.difference is None
        assert sum(compared.counts.values()) >= TICKS * 3 // 10


def test_ros_changes_no_trajectory():
    path, settings = SCENARIOS / "back.toml", ("sim.duration_s=2.0", "seed=7")
    alone = simulate(load_scenario(path, parse_settings(settings)), "back")[0].trajectory_sha256
    seen = simulate_distributed(path, (*settings, "bus.ros2=true"), "back")[0]
    assert seen.trajectory_sha256 == alone
