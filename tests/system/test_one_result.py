"""One scenario and seed, one trajectory: in one process or several, idle or under load."""

import ctypes
import hashlib
import json
import multiprocessing
import os
import random
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, mecazen, options
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen_physics import body, world
from mecazen_tools.simulate import collect, simulate, simulate_distributed

HARD = (
    "sensor.dropout_probability=0.2",
    "sensor.occlusions_s=[[2.5, 4.0]]",
    "sensor.latency_s=0.04",
    "target.gait.step_length_m=0.3",
    "target.path.length_m=0.5",
    "target.path.start_after_s=0.5",
    "sim.duration_s=5.0",
)
"""Dropouts, an occlusion, latency and gait, and a track so short that its bend is in it."""


@cache
def one_process(scenario: str, *settings: str) -> str:
    path = SCENARIOS / f"{scenario}.toml"
    return simulate(load_scenario(path, parse_settings(settings)), scenario)[0].trajectory_sha256


def many_processes(scenario: str, *settings: str) -> str:
    path = SCENARIOS / f"{scenario}.toml"
    return simulate_distributed(path, settings, scenario)[0].trajectory_sha256


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("side", (*HARD, "physics.drive=effort")),
        ("back", ("sim.duration_s=3.0", "controller.update_rate_hz=20")),
    ],
    ids=["efforts", "odometry at a rate of its own"],
)
def test_processes_over_zenoh_give_the_trajectory_of_one_process(scenario, settings):
    assert many_processes(scenario, *settings) == one_process(scenario, *settings)


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
"""A person who leaps back at the robot, so hard that it leans and slides: one of the experiment
`unpromised`."""


def scatter_memory(places: random.Random) -> None:
    """Leave holes in memory, so that objects come to lie in another order than before."""
    libc = ctypes.CDLL(None)
    libc.malloc.restype = ctypes.c_void_p
    libc.free.argtypes = [ctypes.c_void_p]
    blocks = [libc.malloc(places.randrange(24, 1000)) for _ in range(3000)]
    places.shuffle(blocks)
    for block in blocks[:1500]:
        libc.free(block)


def test_where_objects_lie_in_memory_changes_no_collision(monkeypatch):
    places = random.Random(1)

    def scattered(build: Callable[..., Any]) -> Callable[..., Any]:
        def scatter_and_build(*args: Any) -> Any:
            scatter_memory(places)
            return build(*args)

        return scatter_and_build

    built = (body, "_build"), (world, "build_legs"), (body.RobotBody, "add_rims")
    for owner, name in built:
        monkeypatch.setattr(owner, name, scattered(getattr(owner, name)))
    scenario = load_scenario(SCENARIOS / "safety.toml", parse_settings(KICKED))
    found = [simulate(scenario, "safety")[0].trajectory_sha256 for _ in range(5)]
    assert len(set(found)) == 1


SCENARIO_NAMES = sorted(path.stem for path in SCENARIOS.glob("*.toml"))
SHORT = ("sim.duration_s=2.0",)


@pytest.mark.parametrize("together", [False, True], ids=["each alone", "all in one"])
@pytest.mark.parametrize("scenario", SCENARIO_NAMES)
def test_every_scenario_gives_one_trajectory_in_one_process_and_in_many(scenario, together):
    services = load_scenario(SCENARIOS / f"{scenario}.toml").services
    groups = [services] if together else []
    settings = (*SHORT, f"processes={json.dumps(groups)}")
    assert many_processes(scenario, *settings) == one_process(scenario, *SHORT)


def test_services_that_share_processes_in_pairs_give_the_same_trajectory():
    groups = 'processes=[["physics", "controller"], ["target", "follower"]]'
    assert many_processes("back", *SHORT, groups) == one_process("back", *SHORT)


BLIND = "sensor.also=[]"
COLLECTED = ("sim.mode=lockstep", "services=['physics','controller','target','collector']", BLIND)
"""Settings for the scenario `teleop`, without its lidar and its guard."""


def test_a_run_of_services_that_others_started_is_collected_with_the_same_result(stack):
    settings = ("sim.duration_s=3.0", BLIND)
    running = stack(SCENARIOS / "teleop.toml", *settings, *COLLECTED)
    running.launch("physics", "controller", "target")
    result, _ = collect(running.scenario, "teleop")
    assert result.trajectory_sha256 == one_process("teleop", *settings)


def test_who_collects_says_who_has_gone(stack):
    running = stack(SCENARIOS / "teleop.toml", *COLLECTED, "sim.duration_s=1e6")
    running.launch("physics", "controller", "target")

    def kill(ticks):
        running.supervisor.stop()

    with pytest.raises(MecazenError, match=r"gone after \d+ ticks"):
        collect(running.scenario, "teleop", kill)


def _burn(stop):
    while not stop.is_set():
        sum(range(10_000))


def test_load_from_other_processes_does_not_change_the_trajectory():
    settings = (*HARD, "seed=5")
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    hogs = [context.Process(target=_burn, args=(stop,)) for _ in range(2 * (os.cpu_count() or 1))]
    for hog in hogs:
        hog.start()
    try:
        loaded = many_processes("back", *settings)
    finally:
        stop.set()
        for hog in hogs:
            hog.join()
    assert loaded == one_process("back", *settings)


PINNED = json.loads(Path(__file__).with_name("hashes.json").read_text())
CPU_FLAGS = set(Path("/proc/cpuinfo").read_text().partition("flags")[2].split("\n")[0].split())


def is_pinned(scenario, output):
    """Whether 10 s of a scenario have the trajectory of test_hashes."""
    sha256 = PINNED[f"scenarios/{scenario}"]["trajectory_sha256"]
    return json.loads(output)["trajectory_sha256"] == sha256


@pytest.mark.parametrize("scenario", ["back", "senses"])
@pytest.mark.parametrize(("kernel", "needed"), [("Prescott", "pni"), ("Haswell", "avx2")])
def test_other_kernels_of_openblas_and_numpy_give_the_pinned_trajectory(scenario, kernel, needed):
    if needed not in CPU_FLAGS:
        pytest.skip(f"this processor has no {needed}")
    done = mecazen(
        *("simulate", scenario, "--duration", 10, "--json"),
        OPENBLAS_CORETYPE=kernel,
        NPY_DISABLE_CPU_FEATURES="X86_V4" if "avx512bw" in CPU_FLAGS else "",
    )
    assert done.returncode == 0, done.stderr
    assert is_pinned(scenario, done.stdout)


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
        assert is_pinned(scenario, done.stdout), program


def test_a_fresh_interpreter_gives_the_same_trajectory(tmp_path):
    file = tmp_path / "run.csv"
    how = ("--json", "--trajectory", file, *options(HARD))
    done = mecazen("simulate", SCENARIOS / "back.toml", *how, PYTHONHASHSEED="1")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["trajectory_sha256"] == one_process("back", *HARD)
    assert result["trajectory_sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert result["ticks"] == len(file.read_text().splitlines()) - 1 == 500
