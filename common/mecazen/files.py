"""Reads files and values in TOML, with errors of one line."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, BinaryIO

import tomli_w

from mecazen.errors import ConfigError
from mecazen.text import printable


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading.

    Raises:
        ConfigError: One line with the path and the reason.
    """
    try:
        if path.is_fifo() or path.is_char_device():  # without an end
            raise ConfigError(printable(f"{path}: must be a regular file, not a device or a pipe"))
        return path.open("rb")
    except OSError as error:
        raise ConfigError(printable(f"{path}: can't be read: {error.strerror}")) from None
    except ValueError as error:  # a name that no file can have
        raise ConfigError(printable(f"{path}: can't be read: {error}")) from None


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; raises as `open_regular`."""
    with open_regular(path) as file:
        return file.read()


def read_text(path: Path) -> str:
    """Return the content of a text file in UTF-8; raises as `open_regular`."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(printable(f"{path}: must be text in UTF-8")) from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; raises as `open_regular`."""
    try:
        return parse_toml(read_text(path))
    except ValueError as error:
        raise ConfigError(printable(f"{path}: not TOML: {error}")) from None


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a text.

    Raises:
        ValueError: The text is not TOML.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deep") from None


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
            raise ConfigError(printable(f"{text}: not TOML: {error}")) from None
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
    return tomli_w.dumps({"value": plain(value)}).removeprefix("value = ").removesuffix("\n")


def plain(value: Any) -> Any:
    """Return a value as TOML has it: a path as a string, a number of NumPy as one of Python.

    Raises:
        TypeError: TOML has no such value.
    """
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, bool | str):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    raise TypeError(f"TOML has no value of type {type(value).__name__}")
