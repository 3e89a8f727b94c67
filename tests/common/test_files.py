"""Only regular files of bounded size are read."""

import math
import os
from pathlib import Path

import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen.files import (
    MAX_DEPTH,
    open_regular,
    parse_toml,
    parse_value,
    read_bytes,
    read_text,
    read_toml,
    to_value,
)


def test_a_regular_file_is_read_up_to_its_largest_size(tmp_path):
    (tmp_path / "a").write_bytes(bytes(1 << 20))
    assert len(read_bytes(tmp_path / "a", 1 << 20)) == 1 << 20
    (tmp_path / "link").symlink_to("a")
    assert len(read_bytes(tmp_path / "link")) == 1 << 20
    (tmp_path / "a").write_bytes(bytes((1 << 20) + 1))
    problem = error_of(ConfigError, lambda: read_bytes(tmp_path / "a", 1 << 20))
    assert problem == f"{tmp_path / 'a'}: must have at most 1 MiB"


def test_devices_and_pipes_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in (Path("/dev/zero"), Path("/dev/null"), tmp_path / "fifo"):
        problem = error_of(ConfigError, lambda path=path: open_regular(path))
        assert problem == f"{path}: must be a regular file, not a device or a pipe"


def test_what_can_not_be_opened_is_one_line_that_names_it(tmp_path):
    for path, reason in (
        (tmp_path / "none", "No such file or directory"),
        (tmp_path, "Is a directory"),
        (Path("a\0b\n"), "embedded null byte"),
    ):
        problem = error_of(ConfigError, lambda path=path: open_regular(path))
        assert problem.endswith(f": can't be read: {reason}")
        assert "\n" not in problem


def test_text_is_utf_8_with_or_without_a_mark(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfgr\xc3\xbcn")
    assert read_text(tmp_path / "a") == "grün"
    (tmp_path / "a").write_bytes(b"gr\xfcn")
    assert error_of(ConfigError, lambda: read_text(tmp_path / "a")).endswith("text in UTF-8")


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000 + "]" * 5000,
        "a = " + "{b=" * 5000 + "1" + "}" * 5000,
        ".".join("a" * 5000) + " = 1",
        "[" + ".".join("a" * 5000) + "]",
        "[[a]]\n" + "b." * MAX_DEPTH + "c = 1",
    ],
    ids=["lists", "tables", "key", "header", "list of tables"],
)
def test_toml_that_is_nested_too_deep_is_refused_in_one_line(text, tmp_path):
    (tmp_path / "deep.toml").write_text(text)
    problem = error_of(ConfigError, lambda: read_toml(tmp_path / "deep.toml"))
    assert problem == f"{tmp_path / 'deep.toml'}: not TOML: nested more than {MAX_DEPTH} deep"


def test_toml_that_is_nested_as_allowed_is_read():
    tables = parse_toml("b." * (MAX_DEPTH - 2) + "c = 1")
    for _ in range(MAX_DEPTH - 2):
        tables = tables["b"]
    assert tables == {"c": 1}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("é😀", '"é😀"'),
        ('a\x7f"\\\n', '"a\\u007f\\"\\\\\\n"'),
        ((1, 2.5, True, [math.inf, -math.inf]), "[1, 2.5, true, [inf, -inf]]"),
        ({"a b": {"c": []}, "d": Path("x")}, '{"a b" = {c = []}, d = "x"}'),
        (1e300, "1e+300"),
    ],
)
def test_a_value_is_written_in_toml_and_read_again(value, text):
    assert to_value(value) == text
    assert to_value(parse_value(text)) == text
