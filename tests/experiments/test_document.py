"""The study of docs/experiments.md and `mecazen new study`: a study of two tables and a figure."""

from pathlib import Path

from experiments.conftest import experiment
from harness import ROOT


def test_the_study_of_the_document_makes_two_tables_and_a_figure(tmp_path, monkeypatch, capsys):
    study = ROOT / "examples" / "new" / "my_study.toml"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mecazen.loading.OWN", ROOT)  # scenarios by name
    experiment(
        *("run", study, "--seeds", 1, "--only", "case=circle", "--jobs", 1),
        *("--set", "sim.duration_s=2.0", "--csv", "mine.csv", "--figures", "out"),
    )
    out = capsys.readouterr().out
    for words in ("Errors", "Gain of the filter", "circle", "raw", "D_err [m]", "D_err of raw"):
        assert words in out
    assert len(Path("mine.csv").read_text().splitlines()) == 1 + 2 * 2
    assert Path("out/standoff.png").read_bytes().startswith(b"\x89PNG")
    assert Path("out/standoff.svg").exists()
