"""The README says what is so."""

import re
import tomllib

import pytest
import yaml
from harness import ROOT, SCENARIOS, mecazen

README = (ROOT / "README.md").read_text()


def test_the_example_shown_is_the_example_that_is_tested():
    assert (ROOT / "examples" / "my_follower.py").read_text().rstrip() in README


@pytest.mark.parametrize("page", ["README.md", "docs/api/simulation.md"])
def test_the_python_of_a_page_runs_as_it_stands(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first = "from mecazen import Simulation\n"
    code = (ROOT / page).read_text().partition(f"```python\n{first}")[2].partition("```")[0]
    for _ in range(2):  # the second time beside what the first has left
        exec(first + code, {})  # noqa: S102 - our own text
        assert "d_err_m=0.0" in capsys.readouterr().out


def test_its_links_lead_somewhere():
    targets = [part.partition(")")[0] for part in README.split("](")[1:]]
    files = [name.partition("#")[0] for name in targets if "://" not in name]
    missing = [name for name in files if not (ROOT / name).exists()]
    assert not missing


def test_every_extra_that_is_named_exists():
    patterns = ("*/mecazen*/**/*.py", "services/*/mecazen*/**/*.py", "*.md", "docs/*.md")
    texts = [file.read_text() for pattern in patterns for file in ROOT.glob(pattern)]
    extras = {extra for text in texts for extra in re.findall(r"mecazen\[(\w+)\]", text)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "gamepad" in extras
    assert extras <= project["optional-dependencies"].keys()


def test_every_scenario_is_named():
    names = [path.stem for path in SCENARIOS.glob("*.toml")]
    assert all(f"`{name}`" in README for name in names)


def test_the_citation_names_the_present_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert mecazen("--version").stdout.split()[-1] == citation["version"]
