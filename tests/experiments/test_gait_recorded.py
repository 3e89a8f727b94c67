"""`mecazen gait`: from a recording to a report and to files."""

import csv

import pytest
from harness import error_of
from mecazen.errors import MecazenError
from mecazen_tools.cli.app import app


def run(*arguments):
    app(list(map(str, arguments)), standalone_mode=False)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    file = tmp_path_factory.mktemp("recording") / "run.mcap"
    run("simulate", "mocap", "--duration", 8, "--record", file)
    return file


def test_a_recorded_walk_is_reported_and_exported(recording, tmp_path, capsys):
    run("gait", recording, "--export", tmp_path / "walk")
    out = capsys.readouterr().out
    for words in (
        "Seen from: back",
        "norm at 1.24",
        "Strides:",
        "truth",
        "norm, slow",
        "CC BY 4.0",
    ):
        assert words in out
    assert "sagittal GPS (3 of 9 variables)" in out
    with (tmp_path / "walk" / "strides.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["stage"] for row in rows} == {"truth", "filtered", "refined"}
    for row in rows:
        if row["stage"] == "refined":
            assert float(row["speed_m_s"]) == pytest.approx(1.0, abs=0.05)


def test_a_recording_without_a_body_and_an_unknown_run_are_one_line(recording, tmp_path):
    file = tmp_path / "back.mcap"
    run("simulate", "back", "--duration", 1, "--record", file)
    assert "nothing on skeleton/observation" in error_of(MecazenError, lambda: run("gait", file))
    text = error_of(MecazenError, lambda: run("gait", recording, "--run", 7))
    assert "no body in run 7" in text
