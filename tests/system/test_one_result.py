"""One scenario and seed, one trajectory: in one process or several, with any kernel and Python."""

import ctypes
import json
import random
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, mecazen
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen_physics import body, world
from mecazen_tools.simulate import collect, simulate, simulate_distributed

SCENARIO_NAMES = sorted(path.stem for path in SCENARIOS.glob("*.toml"))
SHORT = ("sim.duration_s=2.0",)
NEW = ROOT / "examples" / "new"
HARD = (
    "sensor.dropout_probability=0.2",
    "sensor.occlusions_s=[[2.5, 4.0]]",
    "sensor.latency_s=0.04",
    "target.gait.step_length_m=0.3",
    "target.path.length_m=0.5",
    "target.path.start_after_s=0.5",
    "sim.duration_s=5.0",
    "physics.drive=effort",
    "controller.update_rate_hz=20",
)
"""Dropouts, an occlusion, latency and gait, odometry at a lower rate, and a track so short that its
bend is in it."""
CLOSE = (
    "sim.duration_s=6.0",
    "target.path.start_after_s=0.2",
    "target.path.speed_m_s=0.4",
    # the second robot starts beside the first, and its person walks across the other's way
    "robots.two.target.path={kind='straight', y_m=-0.6, yaw_deg=60.0, start_after_s=0.2}",
    "robots.two.start={x_m=-1.0, y_m=-0.6}",
    "sensor.kind=fused",
    'crowd.walkers=[{ path = { kind = "goal", x_m = 2.0, goal_m = [-2.0, 0.5] } }]',
)
"""Robots come near each other, among a crowd."""


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
        ("back", (*SHORT, f"programs.follower={NEW}/my_follower.py:MyFollower")),
        ("back", (*SHORT, f"programs.my_sensor={NEW}/my_sensor.py:MySensor")),
        ("side", HARD),
        ("convoy", CLOSE),
    ],
)
def test_many_processes_give_the_trajectory_of_one(scenario, settings):
    alone = "processes=[]"
    assert many_processes(scenario, *settings, alone) == one_process(scenario, *settings)


@pytest.mark.parametrize(
    "groups",
    [
        '[["physics", "controller"], ["target", "follower"]]',
        '[["physics", "controller", "target", "follower"]]',
    ],
    ids=["pairs", "all in one"],
)
def test_the_grouping_of_services_changes_no_trajectory(groups):
    assert many_processes("back", *SHORT, f"processes={groups}") == one_process("back", *SHORT)


def test_tls_and_access_control_change_no_trajectory(access_control):
    assert many_processes("back", *SHORT, *access_control) == one_process("back", *SHORT)


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
    hashes = [simulate(scenario, "safety")[0].trajectory_sha256 for _ in range(3)]
    assert len(set(hashes)) == 1


@pytest.fixture
def collected(stack):
    """Start the services of a lockstep run, without its collector."""

    def start(*settings):
        services = "services=['physics','controller','target','collector']"
        running = stack(SCENARIOS / "teleop.toml", *settings, "sim.mode=lockstep", services)
        running.launch("physics", "controller", "target")
        return running

    return start


BLIND = "sensor.also=[]"


def test_a_run_of_services_that_others_started_is_collected_with_the_same_result(collected):
    settings = ("sim.duration_s=3.0", BLIND)
    result, _ = collect(collected(*settings).scenario, "teleop")
    assert result.trajectory_sha256 == one_process("teleop", *settings)


def test_who_collects_says_who_has_gone(collected):
    running = collected("sim.duration_s=1e6", BLIND)
    with pytest.raises(MecazenError, match=r"gone after \d+ ticks"):
        collect(running.scenario, "teleop", lambda _: running.supervisor.stop())


PINNED = json.loads(Path(__file__).with_name("hashes.json").read_text())
CPU_FLAGS = set(Path("/proc/cpuinfo").read_text().partition("flags")[2].split("\n")[0].split())


def is_pinned(scenario, output):
    """Whether 10 s of a scenario have the trajectory of test_hashes."""
    sha256 = PINNED[f"scenarios/{scenario}"]["trajectory_sha256"]
    return json.loads(output)["trajectory_sha256"] == sha256


@pytest.mark.parametrize(("kernel", "needed"), [("Prescott", "pni"), ("Haswell", "avx2")])
def test_other_kernels_of_openblas_and_numpy_give_the_pinned_trajectory(kernel, needed):
    if needed not in CPU_FLAGS:
        pytest.skip(f"this processor has no {needed}")
    done = mecazen(
        *("simulate", "senses", "--duration", 10, "--json"),
        OPENBLAS_CORETYPE=kernel,
        NPY_DISABLE_CPU_FEATURES="X86_V4" if "avx512bw" in CPU_FLAGS else "",
        PYTHONHASHSEED="1",
    )
    assert done.returncode == 0, done.stderr
    assert is_pinned("senses", done.stdout)


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
