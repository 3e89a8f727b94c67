"""Scenarios from Python: bit-identical to the command line."""

import doctest

import numpy as np
import pytest
from harness import SCENARIOS, error_of
from mecazen import Simulation, geometry, keys, robots, wire
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario, parse_settings
from mecazen.urdf import ask_description, read
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools import simulation
from mecazen_tools.simulate import simulate

SHORT = {"seed": 5, "sim.duration_s": 1.0, "follower.standoff_m": 1.5}


def test_a_name_a_file_and_an_object_give_the_same_bits_as_the_command_line():
    file = SCENARIOS / "side.toml"
    settings = ("seed=5", "sim.duration_s=1.0", "follower.standoff_m=1.5")
    expected, _ = simulate(load_scenario(file, parse_settings(settings)), "side")
    for scenario in ("side", file, load_scenario(file)):
        with Simulation(scenario, SHORT) as sim:
            for _ in range(50):
                sim.step()
            sim.run()
            assert sim.is_over
            assert sim.trajectory.sha256() == expected.trajectory_sha256
            assert sim.scores().d_err_m == expected.d_err_m


def test_the_state_is_that_of_the_tick_and_the_tables_hold_every_tick():
    with Simulation("side", duration_s=1.0) as sim:
        state = sim.run(0.5)
        table = sim.trajectory.to_numpy()
        assert state.time_s == sim.time_s == table["t_s"][-1] == 0.5
        assert len(table) == 51
        assert state.robot == tuple(
            table[f"robot_{name}"][-1] for name in ("x_m", "y_m", "yaw_rad")
        )
        assert table["tracking"][-1] == state.follower.tracking
        assert np.isnan(table["estimate_x_m"][0]) == (table["tracking"][0] == "waiting")
        frame = sim.trajectory.to_pandas()
        assert frame.index[-1] == 0.5
        assert frame["odom_x_m"].iloc[-1] == state.odom.x


def test_after_a_reset_a_run_has_the_bits_of_a_new_simulation():
    with Simulation("convoy", seed=7, duration_s=0.5) as fresh:
        fresh.run()
        expected = fresh.trajectory.sha256()
    with Simulation("convoy", seed=1, duration_s=0.5) as sim:
        sim.run(0.31)  # in the midst of a frame
        for _ in range(2):
            begin = sim.reset(seed=7)
            assert (begin.time_s, sim.scenario.seed, begin.robot) == (0.0, 7, sim.state.robot)
            sim.run()
            assert sim.trajectory.sha256() == expected


def test_after_a_step_all_that_was_published_in_its_tick_is_known():
    with Simulation("back", {"services": ["physics", "controller", "target"]}) as sim:
        for _ in range(8):
            sim.step()
        # frames at 25 Hz: one at 0.08 s, that no tick waits for
        assert sim.latest("target/observation").header.stamp == sim.latest("clock").clock


RENAMED = {"controller.command_key": "base/cmd", "controller.odometry_key": "base/odom"}
JOINTS = ["fl", "fr", "rl", "rr"]


def test_renamed_keys_and_joints_are_those_of_all_nodes_and_change_no_trajectory(tmp_path):
    file = tmp_path / "run.mcap"
    with Simulation("back", duration_s=0.3) as plain:
        plain.run()
    renamed = RENAMED | {"robot.wheels.joints": JOINTS}
    with Simulation("back", renamed, duration_s=0.3, record=file) as sim:
        state = sim.run()
        assert sim.trajectory.sha256() == plain.trajectory.sha256()
        assert (state.command, state.odom) == (plain.state.command, plain.state.odom)
        assert sim.latest("base/cmd") == plain.latest("cmd_vel")
        assert list(sim.latest("joint_states").name[:4]) == JOINTS
        assert list(sim.latest("joint_command").name) == JOINTS
        urdf = read(ask_description(sim.bus, "", 1.0).urdf)
        assert set(JOINTS) < {joint.name for joint in urdf.joints}
        assert "odom: no key of this" in error_of(ConfigError, lambda: sim.latest("odom"))
    samples = list(Recording(file).samples())
    assert {"base/cmd", "base/odom"} < {sample.key for sample in samples}
    assert not {"cmd_vel", "odom"} & {sample.key for sample in samples}
    assert recompute(Recording(file), "follower").counts["base/cmd"] == 30


@pytest.mark.parametrize("module", [geometry, keys, robots, simulation, wire])
def test_the_examples_in_the_docstrings_are_true(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


BOX = {"kind": "box", "size_m": [0.4, 0.4, 0.8], "position_m": [2.5, 0.0]}


@pytest.mark.parametrize(
    ("place", "speeds", "contacts"),
    [
        ((1.0, 0.0), [0.5, -0.3, 0.5], (0, 2)),
        ((3.0, 0.0), [-0.5], (1, 0)),  # a person stands 1 m behind
    ],
)
def test_contacts_of_the_robot_are_counted(place, speeds, contacts):
    settings = {
        "world.obstacles": [BOX | {"position_m": place}],
        "target.path": {"kind": "standing", "x_m": -1.0},
        "services": ["physics", "controller", "target"],
        "start.x_m": 0.0,
        "guard.enabled": False,
    }
    with Simulation("teleop", settings, duration_s=10.0) as sim:
        for speed in speeds:
            sim.command(vx=speed)
            sim.run(2.5)
        assert (sim.contacts().persons, sim.contacts().obstacles) == contacts
