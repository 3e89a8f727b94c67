"""The commands in this process, where a run is soon done, and what is said of wrong options."""

import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from experiments.conftest import experiment
from harness import error_of
from mecazen.errors import MecazenError
from mecazen_experiments.executor import RunsFailedError
from mecazen_experiments.jobs import Job, Key

SIX = """
[[cases]]
name = "{view} {variant}"
scenario = "short.toml"
set = ["follower.view={follower}", "follower.estimator={estimator}", "target.path.kind=circle"]
published = {{ d_err_m = 0.22, theta_err_deg = 12.2 }}
"""
SEARCH = """
trials = 3
training_seeds = [1, 2]
held_out_seeds = [3]
[parameters]
"follower.standoff_m" = { low = 0.8, high = 1.2 }
[[cases]]
name = "short"
scenario = "short.toml"
limits = { d_err_m = 0.2 }
"""
WALK = "t_s,x_m,y_m\n0,0,0\n1,0.5,0\n1.5,0.8,0\n"


@pytest.fixture(autouse=True)
def _in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder.path)


def report(file: str) -> Any:
    return msgspec.json.decode(Path(file).read_bytes())


def write_table2(folder: Any) -> None:
    cases = [
        SIX.format(view=view, follower=follower, variant=variant, estimator=estimator)
        for view, follower in (("back", "back"), ("side", "side_left"))
        for variant, estimator in (("without", "none"), ("with", "kf_cv"), ("best", "kf_cv"))
    ]
    folder.write("paper.toml", "kind = 'paper'" + "".join(cases))


def test_several_experiments_make_one_table(folder, capsys):
    text = (folder.path / "short_experiment.toml").read_text()
    folder.write("other.toml", text.replace('name = "short"', 'name = "other"'))
    both = "run", "short_experiment.toml", "other.toml"
    experiment(*both, "--runs", 1, "--jobs", 1, "--set", "sim.duration_s=0.5", "--json", "out.json")
    assert [row["name"] for row in report("out.json")["rows"]] == ["short", "other"]
    text = error_of(MecazenError, lambda: experiment("run", *2 * ["other.toml"]))
    assert text == "other.toml and other.toml: more than one case 'other'"


def test_options_are_laid_over_the_experiment(capsys):
    experiment(
        *("run", "short_experiment.toml", "--runs", 1, "--jobs", 1, "--json", "out.json"),
        *("--set", "sim.duration_s=0.5", "--sweep", "follower.standoff_m=1,1.5"),
    )
    rows = report("out.json")["rows"]
    assert [row["name"] for row in rows] == [
        "short, follower.standoff_m=1",
        "short, follower.standoff_m=1.5",
    ]
    assert [len(row["runs"]) for row in rows] == [1, 1]
    assert "standoff" in capsys.readouterr().out


def test_walks_of_a_folder_are_a_row_and_on_demand_one_each(folder, capsys):
    for name in ("eth_1", "eth_2"):
        folder.write(f"walks/{name}.csv", WALK)
    recorded = 'target.path={kind="recorded", file="walks/eth_1.csv"}'
    arguments = ("run", "short_experiment.toml", "--runs", 1, "--jobs", 1, "--set", recorded)
    experiment(*arguments, "--walks", "walks", "--json", "out.json")
    assert "eth_2" not in capsys.readouterr().out
    assert [run["walk"] for run in report("out.json")["rows"][0]["runs"]] == ["eth_1", "eth_2"]
    experiment(*arguments, "--walks", "walks", "--verbose")
    assert "short / eth_2" in capsys.readouterr().out
    experiment(*arguments, "--json", "own.json")
    assert [run["walk"] for run in report("own.json")["rows"][0]["runs"]] == [None]


def test_a_search_is_free_the_second_time(capsys, folder):
    folder.write("search.toml", SEARCH)
    experiment("tune", "search.toml", "--jobs", 1, "--json", "one.json")
    experiment("tune", "search.toml", "--jobs", 1, "--json", "two.json")
    assert report("one.json") == report("two.json")  # the wall times too: nothing was run again
    best = report("one.json")
    assert 0.8 <= best["settings"]["short"]["follower.standoff_m"] <= 1.2
    assert [run["record"]["key"]["seed"] for run in best["rows"][0]["runs"]] == [3]
    assert "follower.standoff_m" in capsys.readouterr().out


def test_the_paper_s_table_is_printed_and_its_figures_drawn_of_four_cases(
    folder, capsys, monkeypatch
):
    write_table2(folder)
    drawn = {}

    def draw(tables, out):
        drawn.update(tables)
        return [out / "figure.svg"]

    monkeypatch.setattr("mecazen_experiments.figures.draw", draw)
    options = ("--runs", 2, "--jobs", 1, "--json", "out.json", "--figures", "new/folder")
    experiment("run", "paper.toml", *options)
    assert [len(row["runs"]) for row in report("out.json")["rows"]] == [2] * 6
    assert drawn.keys() == {"back without", "back with", "side without", "side with"}
    assert {len(table) for table in drawn.values()} == {200}  # of 2 s, a tick each 10 ms
    assert Path("new/folder").is_dir()
    out = capsys.readouterr().out
    for words in ("Table II", "D_err back [m]", "Θ_err side [°]", "12.2", "Gains", "figure.svg\n"):
        assert words in out


@pytest.fixture(autouse=True)
def hasty(monkeypatch):
    """Wait only a moment for a scheduler that does not answer."""
    monkeypatch.setattr("mecazen_experiments.executor.CONNECT_S", 0.1)


WRONG = [
    (("run", "nowhere"), ("nowhere",)),
    (("run", "short.toml"), ("short.toml", "unknown key")),
    (("run", "short_experiment.toml", "--set", "sim.x=1"), ("sim.x", "unknown key")),
    (("run", "short_experiment.toml", "--sweep", "seed"), ("--sweep seed", "key.path=value")),
    (("run", "short_experiment.toml", "--walks", "none"), ("--walks none",)),
    (("run", "short_experiment.toml", "--json", "none/out.json"), ("none/out.json", "folder")),
    (("run", "short_experiment.toml", "--store", "short.toml"), ("short.toml", "store")),
    (("run", "short_experiment.toml", "--scheduler", "here"), ("here", "tcp://HOST:PORT")),
    (
        ("run", "short_experiment.toml", "--scheduler", "tcp://127.0.0.1:1"),
        ("tcp://127.0.0.1:1: no Dask scheduler answers there",),
    ),
    (
        ("run", "short_experiment.toml", "--scheduler", "tcp://127.0.0.1:1", "--jobs", 2),
        ("--jobs", "--scheduler"),
    ),
    (("run", "short_experiment.toml", "--only", "case=x"), ("--only case=x", "allowed: short")),
    (("run", "short_experiment.toml", "--only", "view=x"), ("--only view=x", "case=NAME")),
    (("run", "short_experiment.toml", "--films", "short.toml"), ("--films short.toml",)),
    (("run", "short_experiment.toml", "--figures", "new"), ("--figures", "'following'")),
    (("run", "short_experiment.toml", "mocap"), ("short_experiment.toml and mocap", "kinds")),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_what_a_user_gets_wrong_is_one_line(arguments, words):
    text = error_of(MecazenError, lambda: experiment(*arguments))
    for word in words:
        assert word in text


def test_a_run_that_fails_is_one_line_with_case_and_seed(folder, capsys):
    folder.write("broken.py", "A = 1")
    program = f'programs.follower="{folder.path}/broken.py:A"'
    with pytest.raises(MecazenError, match=r"^short, seed 1: .*broken\.py:A: not a subclass"):
        experiment("run", "short_experiment.toml", "--runs", 1, "--jobs", 1, "--set", program)
    assert capsys.readouterr().out == ""


def test_without_dask_the_cluster_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MecazenError, match=r"--scheduler needs Dask: .*\[cluster\]"):
        experiment("run", "short_experiment.toml", "--scheduler", "tcp://127.0.0.1:1")


def test_the_minutes_of_a_fuzz_are_written_if_one_fails(monkeypatch, capsys):
    job = Job("minute", None, Path("none.toml"), (), Key("", 1, ""))

    def fail(*_):
        raise RunsFailedError([(job, MecazenError("out of the world"))])

    monkeypatch.setattr("mecazen_experiments.commands.run_all", fail)
    with pytest.raises(MecazenError, match=r"^minute, seed 1: out of the world$"):
        experiment("fuzz", "--jobs", 1, "--json", "out.json")
    assert report("out.json")["minutes"] == []
    assert capsys.readouterr().out == "nothing is driven yet\n"


def test_more_hours_than_a_machine_can_list_are_refused():
    text = error_of(Exception, lambda: experiment("fuzz", "--hours", "1e300"))
    assert "less than or equal to 10000" in text
