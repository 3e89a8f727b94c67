"""Files of experiments and searches, and what is said of wrong ones."""

import json
from pathlib import Path

import pytest
from harness import SCENARIOS, error_of
from mecazen.errors import ConfigError
from mecazen.loading import load_table
from mecazen_experiments.config import (
    Experiment,
    Tuning,
    experiment_path,
    load_cases,
    parse_sweeps,
)

CASE = """
[[cases]]
name = "short"
scenario = "short.toml"
"""
SEARCH = """
training_seeds = [1, 2]
held_out_seeds = [3]
[parameters]
"follower.standoff_m" = { low = 1, high = 4 }
"""


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        (Experiment, "seeds = 3", ("cases", "missing")),
        (Experiment, f"seeds = 0\n{CASE}", ("seeds", "got 0", ">= 1")),
        (Experiment, f"seed = 3\n{CASE}", ("seed", "did you mean seeds?")),
        (Experiment, CASE + CASE, ("cases: two are named 'short'",)),
        (Experiment, CASE + "published = { d_err = 1.0 }", ("unknown score 'd_err'", "d_err_m")),
        (Experiment, CASE + "limits = { d_err_m = 0 }", ("limits: got {'d_err_m': 0}", "> 0")),
        (Experiment, CASE + "sweep = { seed = 3 }", ("sweep: got {'seed': 3}",)),
        (Experiment, CASE + "set = 'seed=3'", ("set", "got 'seed=3'")),
        (Experiment, CASE.replace("short.toml", "none.toml"), ("none.toml: no such file",)),
        (Experiment, "cases = [", ("not TOML",)),
        (Tuning, SEARCH.replace("[3]", "[2, 3]") + CASE, ("held_out_seeds: 2 is a training seed",)),
        (Tuning, SEARCH.replace("= 4", "= 1") + CASE, ("high = 1 must be above low = 1",)),
        (Tuning, SEARCH.replace("= 1,", "= 0, log = true,") + CASE, ("low = 0 must be above 0",)),
        (Tuning, SEARCH.replace("= 1,", "= 0, prefer = 1,") + CASE, ("low = 0 must be above 0",)),
        (Tuning, SEARCH + CASE, ("case 'short' needs limits for objective = 'limits'",)),
        (Tuning, f"objective = 'match'\n{SEARCH}{CASE}", ("needs published for objective",)),
        (Tuning, SEARCH.partition("[parameters]")[0] + CASE, ("parameters: nothing to search",)),
    ],
)
def test_a_wrong_file_is_one_line_with_file_and_key(folder, kind, text, words):
    file = folder.write("wrong.toml", text)
    text = error_of(ConfigError, lambda: load_table(file, kind))
    for word in (str(file), *words):
        assert word in text


def test_an_experiment_is_found_by_path_and_by_name_here_and_above(folder, monkeypatch):
    named = folder.write("configs/experiments/mine.toml", CASE)
    below = folder.write("deep/down/other.toml", CASE).parent
    monkeypatch.chdir(below)
    assert experiment_path("mine") == named
    assert experiment_path("other.toml") == Path("other.toml")
    with pytest.raises(ConfigError, match=r"none: no such experiment; .* one of mine$"):
        experiment_path("none")


def test_the_paper_s_table_is_in_the_repository():
    assert experiment_path("table2").is_file()


def test_values_of_a_sweep_are_given_with_commas():
    sweeps = parse_sweeps(["a.b=1,2", "c=kf_cv, none"])
    assert sweeps == {"a.b": ("1", "2"), "c": ("kf_cv", "none")}


@pytest.mark.parametrize("option", ["a.b", "a.b=", "=1", "a=1,,2"])
def test_a_sweep_without_key_or_values_is_refused(option):
    with pytest.raises(ConfigError, match=f"--sweep {option}: must be key.path=value,value"):
        parse_sweeps([option])


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("programs.follower='mine.py:Mine'", 'programs.follower="{}:Mine"'),
        ("programs.follower=mine.py:Mine", 'programs.follower="{}:Mine"'),
        ('target.path={kind="a", file="mine.py"}', 'target.path={{kind="a", file="{}"}}'),
        ("a={x_m=$x_m, b=[1.5, 'mine.py']}", 'a={{x_m=$x_m, b=[1.5, "{}"]}}'),
        ("a={file='none.py'}", "a={{file='none.py'}}"),  # there is no such file
        ("seed=2", "seed=2"),
    ],
)
def test_a_path_in_set_and_grid_is_relative_to_the_file(folder, setting, expected):
    mine = folder.write("mine.py", "")
    text = (
        f"set = [{json.dumps(setting)}]\n{CASE}\n[grid]\nview = {{ a = [{json.dumps(setting)}] }}"
    )
    found = load_cases(folder.write("mine.toml", text), Experiment)
    assert found.settings == found.grid["view"]["a"] == (expected.format(mine),)


def test_a_scenario_may_be_named_and_a_path_in_set_is_relative_to_the_file(tmp_path, monkeypatch):
    (tmp_path / "mine.py").touch()
    file = tmp_path / "mine.toml"
    file.write_text(
        'set = ["programs.follower=\'mine.py:Mine\'", "seed=2"]\n'
        '[[cases]]\nname = "a"\nscenario = "back"\nset = ["robot=none.toml"]\n'
    )
    found = load_cases(file, Experiment)
    assert found.cases[0].scenario == (SCENARIOS / "back.toml").resolve()
    assert found.settings == (f'programs.follower="{tmp_path / "mine.py"}:Mine"', "seed=2")
    assert found.cases[0].settings == ("robot=none.toml",)  # there is no such file
    file.write_text('[[cases]]\nname = "a"\nscenario = "bak"\n')
    text = error_of(ConfigError, lambda: load_cases(file, Experiment))
    assert text.startswith(f"{file}: bak: no such scenario; did you mean back?")
