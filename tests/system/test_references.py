"""The reference of commands agrees with the commands; a whole installation has all of them."""

from harness import ROOT
from mecazen_tools.generated import command_reference


def test_the_reference_of_commands_is_up_to_date():
    path, text = command_reference(ROOT)
    assert path.read_text() == text, "`make graph` writes it again"


def test_it_names_the_commands_of_all_projects():
    text = (ROOT / "docs" / "cli.md").read_text()
    for name in ("up", "view", "record", "experiment run", "identify", "hardware", "bench run"):
        assert f"\n## mecazen {name}\n" in text
