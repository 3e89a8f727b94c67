import os
from pathlib import Path

import pytest
from mecazen.errors import MecazenError
from mecazen_tools.files import write, write_with


def test_what_fails_half_way_leaves_the_old_file_and_no_other(tmp_path):
    file = tmp_path / "run.csv"
    write(file, b"old")

    def half(path: Path) -> None:
        path.write_bytes(b"ne")
        raise OSError(28, os.strerror(28))

    with pytest.raises(MecazenError) as failed:
        write_with(file, half, "--trajectory")
    assert str(failed.value) == f"--trajectory {file}: No space left on device"
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]
    write(file, b"new")
    assert file.read_bytes() == b"new"


def test_a_device_is_written_itself():
    with pytest.raises(MecazenError, match=r"^/dev/full: No space left on device$"):
        write(Path("/dev/full"), b"x")
    write(Path(os.devnull), b"x")
    assert Path(os.devnull).is_char_device()


def test_the_file_that_is_saved_has_the_suffix_that_tells_its_format(tmp_path):
    seen = []
    write_with(tmp_path / "figure.svg", lambda path: seen.append(path.suffix) or path.touch())
    assert seen == [".svg"]
