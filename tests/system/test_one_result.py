"""One scenario and seed, one trajectory: in one process or several, with any kernel and Python."""

import json
import os
import signal
import subprocess
from functools import cache
from pathlib import Path

import pytest
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, mecazen, options
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.simulate import collect, simulate, simulate_distributed

SCENARIO_NAMES = sorted(path.stem for path in SCENARIOS.glob("*.toml"))
SHORT = ("sim.duration_s=2.0",)
NEW = ROOT / "examples" / "new"
USER_NODES = (
    f"programs.follower={NEW}/my_follower.py:MyFollower",
    f"programs.my_sensor={NEW}/my_sensor.py:MySensor",
)
POLICY = (
    "programs.follower=mecazen_gym.policy:PolicyFollower",
    f"follower.policy={ROOT}/examples/weights.npz",
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
CLOSE = (
    "sim.duration_s=2.5",
    "target.path.start_after_s=0.2",
    "target.path.speed_m_s=0.4",
    # the second robot starts beside the first, and its person walks across the other's way
    "robots.two.target.path={kind='straight', y_m=-0.6, yaw_deg=60.0, start_after_s=0.2}",
    "robots.two.start={x_m=-1.0, y_m=-0.6}",
    "sensor.kind=fused",
    'crowd.walkers=[{ path = { kind = "goal", x_m = 2.0, goal_m = [-2.0, 0.5] } }]',
)
"""Robots come near each other, among a crowd."""


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


def path_of(scenario: str) -> Path:
    return SCENARIOS / f"{scenario}.toml"


@cache
def one_process(scenario: str, *settings: str) -> str:
    loaded = load_scenario(path_of(scenario), parse_settings(settings))
    return simulate(loaded, scenario)[0].trajectory_sha256


def many_processes(scenario: str, *settings: str) -> str:
    return simulate_distributed(path_of(scenario), settings, scenario)[0].trajectory_sha256


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        *((name, SHORT) for name in SCENARIO_NAMES),
        ("back", (*SHORT, *USER_NODES)),
        ("back", (*SHORT, *POLICY)),
        ("side", HARD),
        ("convoy", CLOSE),
        ("safety", KICKED),
    ],
)
def test_many_processes_give_the_trajectory_of_one(scenario, settings):
    alone = "processes=[]"
    assert many_processes(scenario, *settings, alone) == one_process(scenario, *settings)


def test_groups_of_services_tls_and_access_control_change_no_trajectory(access_control):
    pairs = 'processes=[["physics", "controller"], ["target", "follower"]]'
    for settings in ((pairs,), access_control):
        assert many_processes("back", *SHORT, *settings) == one_process("back", *SHORT)


def started(stack, *settings):
    """Start the services of a lockstep run, without its collector."""
    services = "services=['physics','controller','target','collector']"
    running = stack(SCENARIOS / "teleop.toml", *settings, "sim.mode=lockstep", services)
    running.launch("physics", "controller", "target")
    running.bus.close()  # the test does not read it, and the clock would wait for it
    return running


def test_a_run_that_others_started_is_collected_until_a_service_has_gone(stack):
    settings = (*SHORT, "sensor.also=[]")
    result, _ = collect(started(stack, *settings).scenario, "teleop")
    assert result.trajectory_sha256 == one_process("teleop", *settings)
    endless = started(stack, "sim.duration_s=1e6", "sensor.also=[]")
    target = endless.supervisor.pids["target"]
    with pytest.raises(MecazenError, match=r"^target: gone after \d+ ticks"):
        collect(endless.scenario, "teleop", lambda _: os.kill(target, signal.SIGKILL))


PINNED = json.loads(Path(__file__).with_name("hashes.json").read_text())
CPU_FLAGS = set(Path("/proc/cpuinfo").read_text().partition("flags")[2].split("\n")[0].split())


@pytest.mark.parametrize(("kernel", "needed"), [("Prescott", "pni"), ("Haswell", "avx2")])
def test_other_kernels_of_openblas_and_numpy_give_the_same_trajectory(kernel, needed):
    if needed not in CPU_FLAGS:
        pytest.skip(f"this processor has no {needed}")
    done = mecazen(
        *("simulate", "senses", "--json", *options(SHORT)),
        OPENBLAS_CORETYPE=kernel,
        NPY_DISABLE_CPU_FEATURES="X86_V4" if "avx512bw" in CPU_FLAGS else "",
        PYTHONHASHSEED="1",
    )
    assert done.returncode == 0, done.stderr
    trajectory = json.loads(done.stdout)["trajectory_sha256"]
    assert trajectory == one_process("senses", *SHORT)


@pytest.mark.parametrize("scenario", ["back", "senses", "safety"])
def test_every_python_gives_the_pinned_trajectory(scenario):
    programs = sorted(ROOT.glob(".venv-python*/bin/mecazen"))
    if not programs:
        pytest.skip("no environment of another Python: make test-pythons makes them")
    for program in programs:
        done = subprocess.run(
            [program, "simulate", scenario, "--duration", "10", "--json"],
            capture_output=True,
            timeout=COMMAND_GUARD_S,
            check=True,
        )
        trajectory = json.loads(done.stdout)["trajectory_sha256"]
        assert trajectory == PINNED[f"scenarios/{scenario}"]["trajectory_sha256"], program
