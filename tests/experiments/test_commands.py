"""`mecazen experiment` as a user meets it: every run is a real one, though a short one."""

import os
import signal
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest
from distributed import LocalCluster
from mecazen.errors import ConfigError, MecazenError
from mecazen_experiments import commands
from rich.table import Table
from rich.text import Text

STANDING = """
import os, signal
from pathlib import Path
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
        return {CMD_VEL: Twist()}

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


def write_standing(folder: Any, name: str) -> None:
    program = folder.write("standing.py", STANDING)
    scenario = (folder.path / "short.toml").read_text()
    folder.write("short.toml", f'programs.follower = "{program}:{name}"\n{scenario}')


@pytest.fixture
def held(folder):
    """An experiment whose run of seed 3 waits half-way, and a pipe in which it says so."""
    write_standing(folder, "Held")
    os.mkfifo(folder.path / "pid")
    return folder


@pytest.fixture(scope="module")
def undisturbed(make_folder, tmp_path_factory):
    """The rows of that experiment when nothing happens to it."""
    folder = make_folder(tmp_path_factory.mktemp("undisturbed"))
    write_standing(folder, "Held")
    folder.write("held", "")
    folder.mecazen("run", "short_experiment.toml", "--jobs", 1, "--json", "out.json")
    return folder.runs("out.json")


def stored(file: Path) -> dict[int, str]:
    with closing(sqlite3.connect(file)) as database:
        return dict(database.execute("select seed, record from records"))


def test_one_process_and_two_give_the_same_rows(folder):
    outputs = set()
    for jobs in (1, 2):
        out, errors = folder.mecazen(
            *("run", "short_experiment.toml", "--jobs", jobs),
            *("--store", f"{jobs}.sqlite", "--json", f"{jobs}.json"),
        )
        assert errors == f"results: {jobs}.sqlite and {jobs}.json"
        outputs.add(out)
    assert folder.runs("1.json") == folder.runs("2.json")
    assert len({sha256 for _, _, _, sha256, _ in folder.runs("1.json")}) == 4
    assert len(outputs) == 1
    report = msgspec.json.decode((folder.path / "1.json").read_bytes())
    (table,) = report["tables"]
    assert table["head"][:2] == ["case", "n"]
    assert table["rows"][0][0] == report["rows"][0]["name"]
    d_err_m = report["rows"][0]["means"]["d_err_m"]
    assert d_err_m["low"] <= d_err_m["mean"] <= d_err_m["high"]
    assert d_err_m["n"] == 4
    for run in report["rows"][0]["runs"]:
        assert run["record"]["wall_s"] > 0.0
        assert 0.0 < run["record"]["peak_rss_mb"] < 400.0  # what a worker may have


@pytest.mark.parametrize("jobs", [1, 2])
def test_after_ctrl_c_the_same_command_goes_on_from_there(held, undisturbed, jobs):
    command = ("run", "short_experiment.toml", "--jobs", jobs, "--json", "out.json")
    process = held.popen(*command)
    (held.path / "pid").read_text()
    while not (before := stored(held.path / "experiments.sqlite")):
        pass  # a run before it is done, but may be on its way to the store
    os.killpg(process.pid, signal.SIGINT)
    out, errors = held.finish(process, code=130)
    assert out == ""
    assert errors.splitlines() == [errors]
    for words in ("interrupted after", "of 4 runs", "experiments.sqlite", "same command continues"):
        assert words in errors
    assert 3 not in stored(held.path / "experiments.sqlite")
    held.mecazen(*command)
    after = stored(held.path / "experiments.sqlite")
    assert before.items() <= after.items()  # with the wall time of then: not done again
    assert held.runs("out.json") == undisturbed


@pytest.mark.parametrize(
    ("failure", "kind", "message"),
    [
        (ConfigError("no frames"), ConfigError, "^no frames$"),
        (PermissionError("no entry"), MecazenError, "^no report: no entry$"),
        (KeyError("nees"), KeyError, "nees"),  # a fault of the program is a traceback
    ],
)
def test_results_are_written_and_named_before_a_report_fails(
    tmp_path, capsys, failure, kind, message
):
    file = tmp_path / "out.json"
    options = commands.Options(1, None, tmp_path / "store.sqlite", file)
    with (
        pytest.raises(kind, match=message) as caught,
        commands._reporting(options, {"rows": [1]}),
    ):
        raise failure
    assert type(caught.value) is kind
    assert msgspec.json.decode(file.read_bytes())["rows"] == [1]
    assert capsys.readouterr().err == f"results: {options.store} and {file}\n"


def test_a_case_that_a_table_needs_is_missed_before_the_runs(folder):
    experiment = (folder.path / "short_experiment.toml").read_text()
    folder.write("paper.toml", f'kind = "paper"\n{experiment}')
    _, errors = folder.mecazen("run", "paper.toml", "--jobs", 1, code=2)
    assert errors == "error: kind = 'paper' needs a case named 'back without'"
    assert not (folder.path / "experiments.sqlite").exists()


def blocks_ctrl_c(pid: str) -> bool:
    (line,) = [
        line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "SigBlk" in line
    ]
    return bool(int(line.split()[1], 16) & 1 << signal.SIGINT - 1)


def test_ctrl_c_ends_the_command_and_no_worker_says_anything(held):
    process = held.popen("run", "short_experiment.toml", "--jobs", 2, "--runs", 10)
    assert blocks_ctrl_c((held.path / "pid").read_text())
    os.killpg(process.pid, signal.SIGINT)
    out, errors = held.finish(process, code=130)
    assert (out, len(errors.splitlines())) == ("", 1), errors


@pytest.fixture(params=["processes", "Dask"])
def workers(request):
    """The options for two workers: processes, or Dask's on loopback; one that dies is replaced."""
    if request.param == "processes":
        yield "--jobs", 2
        return
    # without an address of its own, the dashboard warns where another has the known port
    with LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield "--scheduler", cluster.scheduler_address


def test_a_worker_that_is_killed_loses_nothing(held, undisturbed, workers):
    process = held.popen("run", "short_experiment.toml", *workers, "--json", "out.json")
    os.kill(int((held.path / "pid").read_text()), signal.SIGKILL)
    _, errors = held.finish(process)
    assert errors == "results: experiments.sqlite and out.json"
    assert held.runs("out.json") == undisturbed


def test_a_run_that_takes_its_workers_with_it_is_named_and_the_rest_is_reported(folder):
    write_standing(folder, "Lethal")
    command = "run", "short_experiment.toml", "--jobs", 2, "--json", "out.json"
    out, errors = folder.mecazen(*command, code=1)
    assert errors.splitlines() == [
        "results: experiments.sqlite and out.json",
        "error: short, seed 3: its worker died, each time it was tried",
    ]
    assert stored(folder.path / "experiments.sqlite").keys() == {1, 2, 4}
    (row,) = msgspec.json.decode((folder.path / "out.json").read_bytes())["rows"]
    assert [run["record"]["key"]["seed"] for run in row["runs"]] == [1, 2, 4]
    assert "short" in out


def test_a_written_table_has_no_styles_and_intervals_in_brackets():
    table = Table("", "D_err\n\\[m]", title="Errors", caption="means")
    table.add_row(Text("back [raw]"), "0.10\n[dim]0.09 … 0.11[/]")
    table.add_row(Text("side"), "[green]✓[/]")
    assert commands.plain(table) == {
        "title": "Errors",
        "caption": "means",
        "head": ["", "D_err [m]"],
        "rows": [["back [raw]", "0.10 (0.09–0.11)"], ["side", "✓"]],
    }
