"""Configurations of recorded runs, without the code and the files that they name."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.files import parse_toml
from mecazen.graph import NODES
from mecazen.loading import from_tables

WITH_FILES = ("target", "crowd", "bus")
"""Sections that refer to files, such as a recorded walk."""


def read_scenario(
    text: str, path: Path, sections: Collection[str] = (), *, trusted: bool = False
) -> Scenario:
    """Return a recorded scenario, with defaults for some sections unless they are named.

    These are the sections `WITH_FILES`, whose files may no longer exist, and the sections of user
    nodes. Unless the recording at `path` is trusted, programs that are not installed are left out,
    and so are their named sections if they have settings of their own.

    Raises:
        ValueError: The text is not TOML.
        ConfigError: The configuration is no longer valid.
        UntrustedError: The configuration names a file, and is not trusted.
    """
    tables = parse_toml(text)
    programs = tables["programs"] if isinstance(tables.get("programs"), dict) else {}
    left_out = {} if trusted else user_programs(tables)
    if left_out:
        tables["programs"] = _without(programs, left_out)
    optional = {*left_out, *programs.keys() - NODES.keys(), *WITH_FILES} - {*sections}
    kept = _without(tables, optional)
    if isinstance(robots := tables.get("robots"), list):
        kept["robots"] = [_without(robot, optional) for robot in robots]
    try:
        return from_tables(kept, path, opens_files=trusted)
    except ConfigError:
        if left_out.keys().isdisjoint(sections):
            raise
        return read_scenario(text, path, {*sections} - left_out.keys(), trusted=trusted)


def user_programs(tables: dict[str, Any]) -> dict[str, str]:
    """Return the programs of a scenario that are files or modules, not installed nodes."""
    programs = tables.get("programs")
    named = programs.items() if isinstance(programs, dict) else ()
    return {name: str(program) for name, program in named if ":" in str(program)}


def _without(tables: Any, names: Collection[str]) -> Any:
    """Return tables without some of them; another value is returned unchanged."""
    if not isinstance(tables, dict):
        return tables
    return {name: table for name, table in tables.items() if name not in names}
