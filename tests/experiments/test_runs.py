"""Runs over made-up workers, and the store that keeps them."""

import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest
from harness import error_of
from mecazen.errors import ConfigError, MecazenError
from mecazen_experiments import runs, versions
from mecazen_experiments.expansion import Job
from mecazen_experiments.runs import RunsFailedError, Store, local_workers, run_all


@pytest.fixture
def done(monkeypatch):
    """Seeds of the jobs that are run in place of simulations; the seed 9 can't be."""
    seeds = []

    def run(job):
        if job.seed == 9:
            raise MecazenError("out of the world")
        seeds.append(job.seed)
        return {"x": job.seed / 3.0, "y": None}

    monkeypatch.setattr(runs, "run", run)
    return seeds


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as store:
        yield store


def jobs(*seeds):
    labels = {"case": "row"}
    return [Job("p", labels, "row", seed, None, None, (), f"key {seed}", "") for seed in seeds]


def test_what_is_stored_or_shared_by_two_rows_is_done_once(store, done):
    reported, checked = [], []
    run_all([*jobs(1), *jobs(1, 2)], store, local_workers(1))
    report, check = (lambda *n: reported.append(n)), lambda job, _: checked.append(job.seed)
    results = run_all(jobs(1, 2, 3), store, local_workers(1), report, check)
    assert done == [1, 2, 3]
    assert reported == [(2, 3), (3, 3)]
    assert checked == [1]  # the first result only
    assert results == {f"key {n}": {"x": n / 3.0, "y": None} for n in (1, 2, 3)}


def test_names_are_checked_after_the_first_run(store, done):
    def refuse(*_):
        raise ConfigError("no column")

    with pytest.raises(ConfigError, match="no column"):
        run_all(jobs(1, 2, 3), store, local_workers(1), check=refuse)
    assert done == [1]
    assert store.find(["key 1"]).keys() == {"key 1"}


@pytest.mark.usefixtures("done")
def test_a_run_that_fails_is_named_and_all_others_are_kept(store):
    with pytest.raises(RunsFailedError, match=r"^row, seed 9: out of the world$"):
        run_all(jobs(1, 9, 3), store, local_workers(1))
    assert store.find(f"key {n}" for n in (1, 9, 3)).keys() == {"key 1", "key 3"}


def test_a_result_that_is_not_finite_is_missing_and_the_first_stays(store):
    assert store.add("a", {"x": float("nan"), "n": 1}) == {"x": None, "n": 1}
    assert store.add("a", {"x": 2.0, "n": 1}) == {"x": None, "n": 1}
    assert store.find(["a", "b"]) == {"a": {"x": None, "n": 1}}


KILLED = """
import os, signal, sys
from pathlib import Path
from mecazen_experiments.runs import Store
store = Store(Path(sys.argv[1]))
store.add("a", {"x": 1.0})
store._database.execute("begin immediate")
store.add("b", {"x": 1.0})
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_command_that_is_killed_while_it_writes_keeps_earlier_runs(tmp_path):
    file = tmp_path / "store.sqlite"
    killed = subprocess.run([sys.executable, "-c", KILLED, file], check=False)
    assert killed.returncode == -signal.SIGKILL
    with closing(Store(file)) as store:
        assert store.find(["a", "b"]) == {"a": {"x": 1.0}}
        store.add("b", {"x": 2.0})


@pytest.mark.parametrize("name", ["text.sqlite", "none/store.sqlite", "other.sqlite"])
def test_what_can_t_be_a_store_is_one_line(tmp_path, name):
    (tmp_path / "text.sqlite").write_text("no database, but long enough to look like one" * 10)
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as database:
        database.execute("create table runs (name)")
    assert name in error_of(MecazenError, lambda: Store(tmp_path / name).find(["a"]))


def test_the_version_changes_with_what_a_run_loads_and_nothing_else(tmp_path, monkeypatch):
    def write(name, text):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)

    def version():
        for cached in (versions.version, versions.loaded, versions._file_of, versions._tree):
            cached.cache_clear()
        return versions.version("mecazen_made.run")

    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(versions, "SERVICES", ())
    write("mecazen_made/__init__.py", "")
    write("mecazen_made/run.py", '"""Text."""\ndef f():\n    from mecazen_made import late\n')
    write("mecazen_made/late.py", "A = 1\n")
    write("mecazen_made/apart.py", "A = 1\n")
    write("mecazen_made/norm.csv", "1")
    before = version()
    write("mecazen_made/apart.py", "A = 2\n")
    write("mecazen_made/late.py", "# a comment\nA = 1\n")
    write("mecazen_made/run.py", '"""Other."""\n\ndef f():\n    from mecazen_made import late\n')
    assert version() == before
    write("mecazen_made/late.py", "A = 2\n")
    code = version()
    write("mecazen_made/norm.csv", "2")
    assert len({before, code, version()}) == 3
    for cached in (versions.version, versions.loaded, versions._file_of, versions._tree):
        cached.cache_clear()


def test_the_fingerprint_covers_the_content_of_files_and_not_their_names(folder):
    from mecazen.loading import load_scenario, parse_settings

    def key(*settings):
        settings = parse_settings(settings)
        return versions.fingerprint(load_scenario(folder.path / "short.toml", settings))

    def walked(name, text):
        file = folder.write(name, text)
        return key(f'target.path={{kind="recorded", file="{file}"}}')

    assert key("seed=7") == key() == key("sim.mode=real_time")
    assert key("follower.standoff_m=1.1") != key()
    assert key("robot.rollers.mass_kg=0.03") != key()
    walk = "t_s,x_m,y_m\n0,0,0\n1,0.5,0\n"
    assert walked("a.csv", walk) == walked("deep/b.csv", walk)
    assert walked("a.csv", walk) != walked("c.csv", walk.replace("0.5", "0.6"))
    program = folder.write("mine.py", "A = 1")
    first = key(f'programs.follower="{program}:A"')
    program.write_text("A = 2")
    assert key(f'programs.follower="{program}:A"') != first
    with pytest.raises(ConfigError, match="no_module"):
        key('programs.follower="no_module:A"')
