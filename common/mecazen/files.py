"""Reads files that a user, a scenario or a recording names: regular ones, of bounded size."""

from __future__ import annotations

import os
import stat
import tomllib
from collections.abc import Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, BinaryIO

import tomli_w

from mecazen.errors import ConfigError
from mecazen.explain import one_line

MAX_BYTES = 64 << 20
"""Maximum size of a file that is read whole: half an hour of motion capture, as text."""
MAX_TOML_BYTES = 4 << 20
MAX_DEPTH = 32
"""Maximum nesting of tables and lists in TOML; a scenario has 8."""


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading; refuse files that could block or never end.

    Raises:
        ConfigError: One line with the path and the reason.
    """
    try:
        file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115  # the caller closes
    except OSError as error:
        raise ConfigError(one_line(f"{path}: can't be read: {error.strerror}")) from None
    except ValueError as error:  # a name that no file can have
        raise ConfigError(one_line(f"{path}: can't be read: {error}")) from None
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise ConfigError(one_line(f"{path}: must be a regular file, not a device or a pipe"))
    return file


def _open_at_once(path: str, flags: int) -> int:
    """Open a file without waiting for the other end of a pipe."""
    return os.open(path, flags | os.O_NONBLOCK)


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Return the content of a regular file of at most `most` bytes.

    Raises:
        ConfigError: One line with the path and the reason.
    """
    with open_regular(path) as file:
        try:
            content = file.read(most + 1)
        except OSError as error:
            raise ConfigError(one_line(f"{path}: can't be read: {error.strerror}")) from None
    if len(content) > most:
        raise ConfigError(one_line(f"{path}: must have at most {most >> 20} MiB"))
    return content


def read_text(path: Path, most: int = MAX_BYTES) -> str:
    """Return the content of a text file in UTF-8; raises as `read_bytes`."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(one_line(f"{path}: must be text in UTF-8")) from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; raises as `read_bytes`."""
    text = read_text(path, MAX_TOML_BYTES)
    try:
        return parse_toml(text)
    except ValueError as error:
        raise ConfigError(one_line(f"{path}: not TOML: {error}")) from None


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a text.

    Raises:
        ValueError: The text is not TOML, or it is nested more than `MAX_DEPTH` deep.
    """
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"nested more than {MAX_DEPTH} deep") from None
    level: list[Any] = [tables]
    for _ in range(MAX_DEPTH):
        level = [
            below
            for one in level
            for below in (one.values() if isinstance(one, dict) else one)
            if isinstance(below, dict | list)
        ]
        if not level:
            return tables
    raise ValueError(f"nested more than {MAX_DEPTH} deep")


def parse_value(text: str) -> Any:
    """Return the value of a text in TOML; a bare word is a string.

    Raises:
        ConfigError: The text begins as a string, a list or a table, and is not TOML.
    """
    text = text.strip()
    try:
        parsed = parse_toml(f"value = {text}")
    except ValueError as error:
        if text.startswith(("[", "{", '"', "'")):
            raise ConfigError(one_line(f"{text}: not TOML: {error}")) from None
        return text
    return parsed["value"] if len(parsed) == 1 else text


def to_value(value: Any) -> str:
    """Return a value in TOML on one line: the inverse of `parse_value`.

    Raises:
        TypeError: TOML has no such value.
    """
    if isinstance(value, Mapping):
        keys = (tomli_w.dumps({key: 0}).removesuffix("0\n") for key in value)
        items = (key + to_value(item) for key, item in zip(keys, value.values(), strict=True))
        return f"{{{', '.join(items)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(to_value, value))}]"
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    elif isinstance(value, bool):
        return str(value).lower()
    elif isinstance(value, Integral):
        value = int(value)  # of NumPy
    elif isinstance(value, Real):
        value = float(value)
    return tomli_w.dumps({"value": value}).removeprefix("value = ").removesuffix("\n")
