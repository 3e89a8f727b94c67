"""`mecazen view`: which files it opens."""

import pytest
from harness import error_of
from mecazen.errors import ConfigError
from mecazen_viewer import recorded
from mecazen_viewer.cli import view


@pytest.mark.parametrize("native", [False, True])
def test_a_file_is_opened_in_the_browser_or_in_a_window(monkeypatch, tmp_path, native):
    opened = []
    monkeypatch.setattr(recorded, "open_file", lambda file, native: opened.append((file, native)))
    file = tmp_path / "run.rrd"
    assert error_of(ConfigError, lambda: view(file, native)) == f"{file}: no such file"
    file.touch()
    view(file, native)
    assert opened == [(file, native)]
