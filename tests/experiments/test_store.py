"""Results in a file: found again, and safe from what may happen meanwhile."""

import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest
from harness import error_of
from mecazen.errors import MecazenError
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Key
from mecazen_experiments.report import Record
from mecazen_experiments.scores import Score, Scores
from mecazen_experiments.store import Store


def record(seed: int, d_err_m: float | None = 0.1, wall_s: float = 1.0) -> Record[Scores]:
    # a number without a short decimal form, and one that is not there
    scores = Scores(Score(d_err_m=d_err_m, nees=1.0 / 3.0), Score())
    return Record(Key("scenario", seed, "version"), "sha", scores, wall_s, 123.4)


def test_a_record_comes_back_equal_under_its_whole_key_and_the_first_stays(tmp_path):
    file = tmp_path / "store.sqlite"
    with closing(Store(file)) as one, closing(Store(file)) as other:  # two commands
        one.add(FOLLOWING, record(1))
        other.add(FOLLOWING, record(1, wall_s=2.0))
        other.add(FOLLOWING, record(2, None))
    with closing(Store(file)) as store:
        found = store.find(FOLLOWING, [record(seed).key for seed in (1, 2, 3)])
        others = [Key("other", 1, "version"), Key("scenario", 1, "other")]
        assert store.find(FOLLOWING._replace(name="other"), [record(1).key]) == {}
        assert store.find(FOLLOWING, others) == {}
    assert found == {record(1).key: record(1), record(2).key: record(2, None)}


KILLED = """
import os, signal, sys
from pathlib import Path
from mecazen_experiments.store import Store
store = Store(Path(sys.argv[1]))
store._database.execute("insert into records values ('following', 'scenario', 1, 'version', '{}')")
store._database.execute("begin immediate")
store._database.execute("insert into records values ('following', 'scenario', 2, 'version', '{}')")
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_command_that_is_killed_while_it_writes_leaves_what_it_had_written(tmp_path):
    file = tmp_path / "store.sqlite"
    killed = subprocess.run([sys.executable, "-c", KILLED, file], check=False)
    assert killed.returncode == -signal.SIGKILL
    with closing(Store(file)) as store, closing(sqlite3.connect(file)) as database:
        assert database.execute("select seed from records").fetchall() == [(1,)]
        store.add(FOLLOWING, record(2))
        assert store.find(FOLLOWING, [record(2).key]) == {record(2).key: record(2)}


@pytest.mark.parametrize("name", ["text.sqlite", "none/store.sqlite", "other.sqlite"])
def test_what_can_t_be_a_store_is_one_line(tmp_path, name):
    (tmp_path / "text.sqlite").write_text("no database, but long enough to look like one" * 10)
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as database:
        database.execute("create table records (name)")
    find = lambda: Store(tmp_path / name).find(FOLLOWING, [record(1).key])  # noqa: E731
    assert name in error_of(MecazenError, find)
