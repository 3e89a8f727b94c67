"""The store of finished runs, the retries of failed ones, and the keys by which runs are found."""

from contextlib import closing

import pytest
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_scenario, parse_settings
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
        return {"x": job.seed / 3.0, "y": float("nan")}

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


def test_the_version_changes_with_what_a_run_loads_and_nothing_else(tmp_path, monkeypatch):
    caches = versions.version, versions.loaded, versions._file_of, versions._tree

    def version(**files):
        for name, text in files.items():
            file = tmp_path / "mecazen_made" / name.replace("_csv", ".csv")
            file.parent.mkdir(exist_ok=True)
            file.with_suffix(file.suffix or ".py").write_text(text)
        for cached in caches:
            cached.cache_clear()
        return versions.version("mecazen_made.run")

    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(versions, "SERVICES", ())
    late = "def f():\n    from mecazen_made import late\n"
    before = version(
        __init__="", run=f'"""Text."""\n{late}', late="A = 1", apart="A = 1", norm_csv="1"
    )
    assert version(apart="A = 2", late="# a comment\nA = 1", run=f'"""New."""\n\n{late}') == before
    assert len({before, version(late="A = 2"), version(norm_csv="2")}) == 3
    for cached in caches:
        cached.cache_clear()


def test_the_fingerprint_covers_the_content_of_files_and_not_their_names(folder):
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
