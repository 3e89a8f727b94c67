"""Stores results in one SQLite file, by kind and key, for later commands."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec
from mecazen.errors import MecazenError

from mecazen_experiments.jobs import Key
from mecazen_experiments.report import Kind, Record

BUSY_S = 60.0
"""Time to wait for the write of another command, which takes milliseconds."""

_TABLE = """
create table if not exists records (
    kind text not null,
    scenario_sha256 text not null,
    seed integer not null,
    version text not null,
    record text not null,
    primary key (kind, scenario_sha256, seed, version)
) without rowid
"""
_ADD = "insert or ignore into records values (?, ?, ?, ?, ?)"
_FIND = """
select record from records where (kind, scenario_sha256, seed, version) = (?, ?, ?, ?)
"""

T = TypeVar("T")


class Store:
    """Records by kind and key, in a file that may be shared with other commands.

    Each record is a transaction: it is stored completely or not at all. The first record of a key
    is kept; a second one would be equal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._one_line():
            # autocommit: each statement is a separate transaction
            self._database = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
            self._database.execute(_TABLE)

    def find(self, kind: Kind[T], keys: Iterable[Key]) -> dict[Key, Record[T]]:
        """Return the stored records of some keys."""
        found: dict[Key, Record[T]] = {}
        with self._one_line():
            for key in keys:
                values = kind.name, *msgspec.structs.astuple(key)
                row = self._database.execute(_FIND, values).fetchone()
                if row is not None:
                    found[key] = msgspec.json.decode(row[0], type=kind.record)
        return found

    def add(self, kind: Kind[T], record: Record[T]) -> None:
        """Store a record."""
        text = msgspec.json.encode(record).decode()
        with self._one_line():
            values = kind.name, *msgspec.structs.astuple(record.key), text
            self._database.execute(_ADD, values)

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, msgspec.ValidationError, msgspec.DecodeError) as error:
            raise MecazenError(f"{self.path}: can't be used as a store: {error}") from None
