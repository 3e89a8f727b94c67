"""One scenario and seed, one trajectory: in one process or several, with any kernel and Python.

hashes.json pins 10 s of every scenario. This writes it, for a change that moves trajectories on
purpose: `PYTHONPATH=tests .venv/bin/python tests/system/test_one_result.py`.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from harness import ROOT
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.simulate import collect, simulate, simulate_distributed

CONFIGS = ROOT / "configs"
SCENARIOS = {
    str(path.relative_to(CONFIGS).with_suffix("")): path
    for folder in ("paper", "scenarios")
    for path in sorted((CONFIGS / folder).glob("*.toml"))
}
FILE = Path(__file__).with_name("hashes.json")
PINNED = json.loads(FILE.read_text())
SHORT = ("sim.duration_s=2.0", "processes=[]")
NEW = ROOT / "examples" / "new"
USER_NODES = (
    *SHORT,
    f"programs.follower={NEW}/my_follower.py:MyFollower",
    f"programs.my_sensor={NEW}/my_sensor.py:MySensor",
)
HARD = (
    "sensor.dropout_probability=0.2",
    "sensor.occlusions_s=[[1.5, 2.5]]",
    "sensor.latency_s=0.04",
    "target.gait.step_length_m=0.3",
    "target.path.length_m=0.5",
    "target.path.start_after_s=0.5",
    "sim.duration_s=3.5",
    "physics.drive=effort",
    "controller.update_rate_hz=20",
)
"""Dropouts, an occlusion, latency and gait, odometry at a lower rate, and a track so short that its
bend is in it."""
KICKED = (
    "guard.enabled=false",
    "follower.view=back",
    "follower.standoff_m=1.2",
    "start={ x_m = -1.2 }",
    "seed=8",
    "target.path={ kind = 'script', acceleration_m_s2 = 20.0, steps = ["
    "{ duration_s = 3.468506661883443, speed_m_s = 1.2 }, "
    "{ duration_s = 0.5, speed_m_s = 2.1675332057241845, direction_deg = 180.0 }], "
    "start_after_s = 1.0 }",
    "sim.duration_s=6.5",
)
"""A person who leaps back at the robot, so hard that it leans and slides: in a process with other
memory, contacts are to be found in the same order."""


def outcome(result):
    """Return hash and scores of a run."""
    return {key: getattr(result, key) for key in ("trajectory_sha256", "d_err_m", "theta_err_deg")}


def one_process(name, *settings):
    return simulate(load_scenario(SCENARIOS[name], parse_settings(settings)), name)


def many_processes(name, *settings):
    return simulate_distributed(SCENARIOS[name], settings, name)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_has_its_pinned_trajectory_in_one_process_and_in_many(name):
    result, trajectory = one_process(name, "sim.duration_s=10.0")
    assert outcome(result) == PINNED[name]
    if name.startswith("scenarios/"):
        rows = many_processes(name, *SHORT)[1].rows()
        assert rows == trajectory.rows()[: len(rows)]


@pytest.mark.parametrize(
    ("name", "settings"),
    [("scenarios/back", USER_NODES), ("scenarios/side", HARD), ("scenarios/safety", KICKED)],
    ids=["user nodes", "hard", "kicked"],
)
def test_many_processes_give_the_trajectory_of_one(name, settings):
    expected = one_process(name, *settings)[0].trajectory_sha256
    assert many_processes(name, *settings)[0].trajectory_sha256 == expected


def test_groups_of_services_tls_and_access_control_change_no_trajectory(access_control):
    expected = one_process("scenarios/back", *SHORT)[0].trajectory_sha256
    pairs = 'processes=[["physics", "controller"], ["target", "follower"]]'
    for settings in ((pairs,), access_control):
        result, _ = many_processes("scenarios/back", *SHORT, *settings)
        assert result.trajectory_sha256 == expected


def started(stack, *settings):
    """Start the services of a lockstep run, without its collector."""
    services = "services=['physics','controller','target','collector']"
    running = stack(SCENARIOS["scenarios/teleop"], *settings, "sim.mode=lockstep", services)
    running.launch("physics", "controller", "target")
    running.bus.close()  # the test does not read it, and the clock would wait for it
    return running


def test_a_run_that_others_started_is_collected_until_a_service_has_gone(stack):
    settings = ("sim.duration_s=2.0", "sensor.also=[]")
    result, _ = collect(started(stack, *settings).scenario, "teleop")
    expected, _ = one_process("scenarios/teleop", *settings)
    assert result.trajectory_sha256 == expected.trajectory_sha256
    endless = started(stack, "sim.duration_s=1e6", "sensor.also=[]")
    target = endless.supervisor.pids["target"]
    with pytest.raises(MecazenError, match=r"^target: gone after \d+ ticks"):
        collect(endless.scenario, "teleop", lambda _: os.kill(target, signal.SIGKILL))


CPU_FLAGS = set(Path("/proc/cpuinfo").read_text().partition("flags")[2].split("\n")[0].split())


def pinned_trajectory(*program, scenario="senses", **variables):
    """Whether 10 s of a scenario by the command line of another process are as pinned."""
    command = [*program, "simulate", scenario, "--duration", "10", "--json"]
    environment = {**os.environ, **variables}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    result = json.loads(done.stdout)
    return result["trajectory_sha256"] == PINNED[f"scenarios/{scenario}"]["trajectory_sha256"]


@pytest.mark.parametrize(("kernel", "needed"), [("Prescott", "pni"), ("Haswell", "avx2")])
def test_other_kernels_of_openblas_and_numpy_give_the_pinned_trajectory(kernel, needed):
    if needed not in CPU_FLAGS:
        pytest.skip(f"this processor has no {needed}")
    assert pinned_trajectory(
        *(sys.executable, "-m", "mecazen_tools"),
        OPENBLAS_CORETYPE=kernel,
        NPY_DISABLE_CPU_FEATURES="X86_V4" if "avx512bw" in CPU_FLAGS else "",
        PYTHONHASHSEED="1",
    )


@pytest.mark.parametrize("scenario", ["back", "senses", "safety"])
def test_every_python_gives_the_pinned_trajectory(scenario):
    programs = sorted(ROOT.glob(".venv-python*/bin/mecazen"))
    if not programs:
        pytest.skip("no environment of another Python: make test-pythons makes them")
    for program in programs:
        assert pinned_trajectory(program, scenario=scenario), program


if __name__ == "__main__":
    outcomes = {name: outcome(one_process(name, "sim.duration_s=10.0")[0]) for name in SCENARIOS}
    FILE.write_text(json.dumps(outcomes, indent=2) + "\n")
