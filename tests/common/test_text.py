"""Text of files, of errors, of logs and of others."""

import math
import os
from pathlib import Path

import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen.files import open_regular, parse_value, read_text, to_value
from mecazen.text import printable


def test_an_unreadable_file_is_one_line(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path, reason in (
        (tmp_path / "none", "can't be read: No such file or directory"),
        (tmp_path, "can't be read: Is a directory"),
        (Path("a\0b\n"), "can't be read: embedded null byte"),
        (Path("/dev/zero"), "must be a regular file, not a device or a pipe"),
        (tmp_path / "fifo", "must be a regular file, not a device or a pipe"),
    ):
        line = error_of(ConfigError, lambda path=path: open_regular(path))
        assert line == f"{printable(str(path))}: {reason}"


def test_text_is_utf_8_with_or_without_a_mark(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfgr\xc3\xbcn")
    assert read_text(tmp_path / "a") == "grün"
    (tmp_path / "a").write_bytes(b"gr\xfcn")
    assert error_of(ConfigError, lambda: read_text(tmp_path / "a")).endswith("text in UTF-8")


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
def test_a_value_in_toml_is_read_again(value, text):
    assert to_value(value) == text
    assert to_value(parse_value(text)) == text


def test_received_text_does_not_move_the_cursor():
    assert printable("[/oops] né |") == "[/oops] né |"
    assert printable("a\x1b[2Jb\n\x9bc\u202e") == "a\\u001b[2Jb\\n\\u009bc\\u202e"
