"""Results in one SQLite file, each under its key, for the next command."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import msgspec
from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Key
from mecazen_experiments.run import Record

BUSY_S = 60.0
"""How long to wait for the write of another command, which takes milliseconds."""

_TABLE = """
create table if not exists {0} (
    scenario_sha256 text not null,
    seed integer not null,
    version text not null,
    record text not null,
    primary key (scenario_sha256, seed, version)
) without rowid
"""
_ADD = "insert or ignore into {0} values (?, ?, ?, ?)"
_FIND = "select record from {0} where (scenario_sha256, seed, version) = (?, ?, ?)"


class Stored(Protocol):
    """What a run leaves: a struct with its key."""

    @property
    def key(self) -> Key:
        """What it is found by."""


R = TypeVar("R", bound=Stored)


class Records(Generic[R]):
    """Records of one kind by key, in a file that may be shared with other commands.

    Each record is a transaction: it is stored whole or not at all. The first of a key stays;
    another would be equal.

    Args:
        path: The file.
        kind: What a record is: a struct.
        table: The name of this kind.

    Raises:
        MecazenError: From any method: the file can't be used.
    """

    def __init__(self, path: Path, kind: type[R], table: str) -> None:
        self.path = path
        self._kind, self._table = kind, table
        with self._one_line():
            # autocommit: each statement is a transaction of its own
            self._database = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
            self._database.execute(_TABLE.format(table))

    def find(self, keys: Iterable[Key]) -> dict[Key, R]:
        """Return the records that are there already."""
        found: dict[Key, R] = {}
        with self._one_line():
            find = _FIND.format(self._table)
            for key in keys:
                values = msgspec.structs.astuple(key)
                row = self._database.execute(find, values).fetchone()
                if row is not None:
                    found[key] = msgspec.json.decode(row[0], type=self._kind)
        return found

    def add(self, record: R) -> None:
        """Keep a record."""
        values = (*msgspec.structs.astuple(record.key), msgspec.json.encode(record).decode())
        with self._one_line():
            self._database.execute(_ADD.format(self._table), values)

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, msgspec.ValidationError, msgspec.DecodeError) as error:
            raise MecazenError(f"{self.path}: can't be used as a store: {error}") from None


class Store(Records[Record]):
    """The records of runs; see `Records`."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, Record, "runs")
