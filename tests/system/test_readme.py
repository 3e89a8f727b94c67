"""The README says what is so."""

from harness import ROOT, SCENARIOS

README = (ROOT / "README.md").read_text()


def test_the_example_shown_is_the_example_that_is_tested():
    assert (ROOT / "examples" / "my_follower.py").read_text().rstrip() in README


def test_its_links_lead_somewhere():
    targets = [part.partition(")")[0] for part in README.split("](")[1:]]
    files = [name.partition("#")[0] for name in targets if "://" not in name]
    missing = [name for name in files if not (ROOT / name).exists()]
    assert not missing


def test_every_scenario_is_named():
    names = [path.stem for path in SCENARIOS.glob("*.toml")]
    assert all(f"`{name}`" in README for name in names)
