"""`mecazen experiment run` as a user meets it: every run is a real one, though a short one."""

import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import chdir, closing
from pathlib import Path

import pytest
from distributed import LocalCluster
from experiments.conftest import SCENARIO, STUDY, Folder, experiment
from harness import ROOT, command, error_of
from mecazen.errors import MecazenError

GUARD_S = 300
"""Far beyond the duration of all commands here: only a hang reaches it."""
STANDING = """
import os, signal
from pathlib import Path
from mecazen.geometry import Twist2D
from mecazen.row import Row, every
from mecazen.keys import CMD_VEL, ODOM
from mecazen.messages import Twist
from mecazen.node import Node

HERE = Path(__file__).parent

class Standing(Node):
    ROW = Row("follower", inputs=(every(ODOM),), outputs=(CMD_VEL,))

    def reset(self, seed):
        self.seed = seed

    def step(self, tick, inputs):
        if self.seed == 3 and tick.time_ns == 1_000_000_000:
            self.half_way()
        return {CMD_VEL: Twist.planar(Twist2D(0.05 * self.seed, 0.0, 0.0))}

    def half_way(self):
        pass

class Held(Standing):
    # the first time says who it is, and waits for its end
    def half_way(self):
        try:
            (HERE / "held").touch(exist_ok=False)
        except FileExistsError:
            return
        (HERE / "pid").write_text(str(os.getpid()))
        signal.pause()

class Lethal(Standing):
    def half_way(self):
        os.kill(os.getpid(), signal.SIGKILL)
"""
WALK = "t_s,x_m,y_m\n0,0,0\n1,0.5,0\n1.505,0.8,0\n"


def start(folder: Folder, *options: object) -> subprocess.Popen[str]:
    """Start the study as a shell does, in its own process group."""
    words = ["experiment", "run", "study.toml", *options, "--csv", "out.csv"]
    call = command(words) | {"cwd": folder.path, "process_group": 0}
    return subprocess.Popen(**call, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finish(process: subprocess.Popen[str], code: int = 0) -> tuple[str, str]:
    """Wait for a process that is to end with `code`; return its output and its errors."""
    out, errors = process.communicate(timeout=GUARD_S)
    assert process.returncode == code, errors
    return out, errors.strip()


def standing(path: Path, name: str) -> Folder:
    """Write the study with a follower of the program above; return its folder."""
    folder = Folder(path)
    program = folder.write("standing.py", STANDING)
    folder.write("short.toml", f'programs.follower = "{program}:{name}"\n{SCENARIO}')
    folder.write("study.toml", STUDY)
    return folder


@pytest.fixture
def held(tmp_path):
    """A study whose run of seed 3 waits half-way, and a pipe in which it says so."""
    folder = standing(tmp_path, "Held")
    os.mkfifo(folder.path / "pid")
    return folder


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return the rows of that study when no run waits, from this process."""
    folder = standing(tmp_path_factory.mktemp("undisturbed"), "Held")
    folder.write("held", "")
    with chdir(folder.path):
        experiment("run", "study.toml", "--jobs", 1, "--csv", "out.csv")
    rows = folder.runs("out.csv")
    assert [row["seed"] for row in rows] == ["1", "2", "3", "4"]
    assert len({row["trajectory"] for row in rows}) == 4
    return rows


def stored(file: Path) -> int:
    with closing(sqlite3.connect(file)) as database:
        return database.execute("select count(*) from runs").fetchone()[0]


def test_after_ctrl_c_the_same_command_goes_on_from_there(held, undisturbed):
    process = start(held, "--jobs", 2)
    (held.path / "pid").read_text()
    while not stored(held.path / "experiments.sqlite"):
        pass  # a run before it is done, but may be on its way to the store
    os.killpg(process.pid, signal.SIGINT)
    out, errors = finish(process, code=130)
    assert out == ""
    assert errors.splitlines() == [errors]
    for words in ("interrupted after", "of 4 runs", "experiments.sqlite", "same command continues"):
        assert words in errors
    assert 1 <= stored(held.path / "experiments.sqlite") <= 3
    finish(start(held, "--jobs", 2))
    assert held.runs("out.csv") == undisturbed


def test_a_worker_of_dask_that_is_killed_loses_nothing(held, undisturbed):
    # without an address of its own, the dashboard warns where another has the known port
    with LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        process = start(held, "--cluster", cluster.scheduler_address)
        os.kill(int((held.path / "pid").read_text()), signal.SIGKILL)
        finish(process)
    assert held.runs("out.csv") == undisturbed


def test_a_run_that_kills_its_workers_is_named_and_the_others_are_shown(tmp_path):
    folder = standing(tmp_path, "Lethal")
    out, errors = finish(start(folder, "--jobs", 2), code=1)
    assert errors.splitlines() == [
        "results: experiments.sqlite and out.csv",
        "error: short, seed 3: its worker died, each time it was tried",
    ]
    assert [row["seed"] for row in folder.runs("out.csv")] == ["1", "2", "4"]
    assert "short" in out


@pytest.fixture
def inside(folder, monkeypatch):
    """The folder as the working directory; an absent scheduler is waited for shortly."""
    monkeypatch.chdir(folder.path)
    monkeypatch.setattr("mecazen_experiments.runs.CONNECT_S", 0.1)
    return folder


def test_options_replace_those_of_the_study(inside, capsys):
    for name in ("eth_1", "eth_2"):
        inside.write(f"walks/{name}.csv", WALK)
    experiment(
        *("run", "study.toml", "--seeds", "7", "--jobs", 1, "--csv", "out.csv"),
        *("--set", 'target.path={kind="recorded", file="walks/eth_1.csv"}', "--walks", "walks"),
        *("--sweep", "follower.standoff_m=1,1.5"),
    )
    rows = inside.runs("out.csv")
    labels = [(row["walk"], row["follower.standoff_m"], row["seed"]) for row in rows]
    assert labels == [(w, s, "7") for s in ("1", "1.5") for w in ("eth_1", "eth_2")]
    assert "(4 runs)" in capsys.readouterr().out


WRONG = [
    (("run", "nowhere"), "nowhere: no such experiment"),
    (("run", "short.toml"), "short.toml: robot: unknown key"),
    (("run", "study.toml", "--set", "sim.x=1"), "sim.x: unknown key"),
    (("run", "study.toml", "--sweep", "seed"), "--sweep seed: must be key.path=value,value"),
    (("run", "study.toml", "--seeds", "3-1"), "--seeds 3-1: must be a range or a list"),
    (("run", "study.toml", "--walks", "none"), "--walks none: no such folder"),
    (("run", "study.toml", "--csv", "none/out.csv"), "--csv none/out.csv: no such folder"),
    (("run", "study.toml", "--store", "short.toml"), "short.toml: can't be used as a store"),
    (("run", "study.toml", "--cluster", "here"), "--cluster here: must be tcp://HOST:PORT"),
    (
        ("run", "study.toml", "--cluster", "tcp://127.0.0.1:1"),
        "tcp://127.0.0.1:1: no Dask scheduler answers there",
    ),
    (
        ("run", "study.toml", "--cluster", "tcp://127.0.0.1:1", "--jobs", 2),
        "--jobs: the workers of",
    ),
    (("run", "study.toml", "--only", "case=x"), "--only case: unknown 'x'; allowed: short"),
    (("run", "study.toml", "--only", "view=x"), "--only view=x: no such axis; allowed: case"),
    (("run", "study.toml", "--figures", "new"), "--figures: the study has no [[figure]]"),
]


@pytest.mark.parametrize(("arguments", "line"), WRONG)
def test_a_wrong_option_is_one_line(inside, arguments, line):
    assert line in error_of(MecazenError, lambda: experiment(*arguments))


def test_without_dask_the_cluster_names_what_to_install(inside, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MecazenError, match=r"--cluster needs Dask: .*\[cluster\]"):
        experiment("run", "study.toml", "--cluster", "tcp://127.0.0.1:1")


def test_the_study_of_the_document_makes_two_tables_and_a_figure(tmp_path, monkeypatch, capsys):
    study = ROOT / "examples" / "new" / "my_study.toml"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mecazen.loading.OWN", ROOT)  # scenarios by name
    experiment(
        *("run", study, "--seeds", 1, "--only", "case=circle", "--jobs", 1),
        *("--set", "sim.duration_s=2.0", "--csv", "mine.csv", "--figures", "out"),
    )
    out = capsys.readouterr().out
    for words in ("Errors", "Gain of the filter", "circle", "raw", "D_err [m]", "D_err of raw"):
        assert words in out
    assert len(Path("mine.csv").read_text().splitlines()) == 1 + 2 * 2
    assert Path("out/standoff.png").read_bytes().startswith(b"\x89PNG")
    assert Path("out/standoff.svg").exists()
