"""Rerun's command is asked for what it can do; where it is missing or fails, one line says so."""

import pytest
from mecazen_recorder import rerun
from mecazen_recorder.writer import RecordingError


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Where Rerun's command is looked for; nothing is there yet."""
    monkeypatch.setattr("sysconfig.get_path", lambda _: str(tmp_path))
    return tmp_path / "rerun"


def test_without_rerun_expect_what_to_install(command):
    with pytest.raises(RecordingError, match=r"mecazen\[viewer\]"):
        rerun.converter()


def test_what_rerun_refuses_is_its_last_line(command, tmp_path):
    command.write_text("#!/bin/sh\necho first >&2\necho 'no such thing' >&2\nexit 3\n")
    command.chmod(0o755)
    with pytest.raises(RecordingError, match=r"a\.rrd: Rerun can't write it: no such thing$"):
        rerun.convert(tmp_path / "a.mcap")


def test_a_recording_becomes_one_of_rerun(make_recording):
    try:
        rerun.converter()
    except RecordingError:
        pytest.skip("Rerun is not installed")
    path = make_recording()
    assert rerun.convert(path) == path.with_suffix(".rrd")
    assert path.with_suffix(".rrd").read_bytes().startswith(b"RR")
