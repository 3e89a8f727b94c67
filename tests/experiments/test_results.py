"""The tables of documents: made from the runs of a study, and refused if they were edited."""

import importlib.util
import sys

import pytest
from experiments.conftest import STUDY
from harness import ROOT

PAGE = """# Results
The error is <!-- cell: short; Errors; short; D_err [m] --><!-- /cell --> m.
<!-- results: short Errors -->
<!-- /results -->
<!-- results: old -->
| x |
| --- |
| 1 |
<!-- /results -->

<!-- by hand: literature -->
| y |
| --- |
| 2 |
"""
RUNS = "case,walk,seed,key,d_err_m\nshort,,1,a,0.1\nshort,,2,b,0.2\n"
STAGES = """
[short]
command = "experiment run {study}"
[old]
command = "experiment run {study} --walks $ABSENT"
"""
ORIGINS = """
[short]
commit = "abc"
date = "2026-01-01"
machine = "A machine."
"""


@pytest.fixture(scope="module")
def make():
    """The script results/make.py as a module."""
    spec = importlib.util.spec_from_file_location("make", ROOT / "results" / "make.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["make"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def project(folder, make):
    """A project of two stages; the second has no runs yet, only a table."""
    folder.write("study.toml", STUDY)
    folder.write("results/stages.toml", STAGES.format(study=folder.path / "study.toml"))
    folder.write("results/origins.toml", ORIGINS)
    folder.write("results/short.csv", RUNS)
    folder.write("README.md", "")
    page = folder.write("docs/results.md", PAGE)
    page.write_text(make.Results(folder.path).updated(PAGE))
    return folder


def problems(make, project):
    return list(make.Results(project.path).problems())


def test_tables_are_made_from_the_runs(make, project):
    text = (project.path / "docs/results.md").read_text()
    assert "| short | 2 | 0.100, 0.200 |" in text
    assert "The error is <!-- cell: short; Errors; short; D_err [m] -->0.100, 0.200<!--" in text
    assert "Commit abc, 2026-01-01: A machine." in text
    assert problems(make, project) == []


WRONG = [
    ("0.200", "0.201", "docs/results.md: a table or cell is not"),
    ("-->0.100, 0.200<", "-->0.100, 0.201<", "docs/results.md: a table or cell is not"),
    ("short; D_err", "short; D_er", "short, Errors: 'short', 'D_er [m]' is not one cell"),
    ("<!-- by hand: literature -->\n", "", "docs/results.md:18: this table needs a line"),
    ("results: old", "results: odl", "stage odl is not in stages"),
    ("results: short Errors", "results: short Eror", "short: no table 'Eror'; there are Errors"),
    ("# Results", "# Results\n![A](a.png)", "docs/results.md:2: this picture needs"),
]


@pytest.mark.parametrize(("old", "new", "line"), WRONG)
def test_an_edited_document_is_refused(make, project, old, new, line):
    page = project.path / "docs/results.md"
    page.write_text(page.read_text().replace(old, new))
    try:
        shown = problems(make, project)
    except make.MecazenError as error:
        shown = [str(error)]
    assert any(problem.startswith(line) for problem in shown), shown


def test_a_stage_is_stale_when_a_key_of_its_runs_changes(make, project):
    results = make.Results(project.path)
    assert results.stale("old") == "no result yet"
    assert results.stale("short") == "inputs have changed since commit abc"
    results.origins["short"]["key"] = results.key("short")
    assert results.stale("short") == ""
    study = project.path / "study.toml"
    study.write_text(study.read_text().replace("seeds = 4", "seeds = 5"))
    assert results.stale("short") != ""
    project.write("results/old.csv", RUNS)
    assert results.stale("old") == "not known without ABSENT in the environment"
