"""References are made of docstrings, types and help texts."""

from typing import Annotated, Literal

import typer
from mecazen_tools.references import commands, configuration

CONFIGURATION = configuration()


def chapter(title: str) -> str:
    return CONFIGURATION.partition(f"## {title}\n")[2].partition("\n## ")[0]


def test_a_setting_shows_default_range_and_docstring():
    row = (
        "| `margin_m` | `0.06`, ≥ 0, live | Clearance between the robot's outline and obstacles. |"
    )
    assert row in chapter("guard")


def test_a_setting_without_a_default_is_required_or_none():
    assert "| `base.mass_kg` | required, > 0 and ≤ 2000 |  |" in chapter("robot")
    assert "| `counts_per_turn` | none, > 0 |" in chapter("hardware")


def test_settings_that_differ_in_their_names_alone_share_a_row():
    assert "| `base.length_m`, `base.width_m`, `base.height_m` |" in chapter("robot")


def test_the_chapter_of_a_section_holds_its_tables():
    assert "[sensors](#sensors)" in chapter("top level")
    assert "| `lidar.beams` |" in chapter("sensors")
    assert "| `walls[].doors[].width_m` |" in chapter("world")


def test_a_table_of_several_sections_is_described_once():
    assert "| `robot` | none, as [robot](#robot) |" in chapter("robots")
    assert "as [target.path](#target)" in chapter("crowd")


def test_a_choice_of_tables_names_the_kinds_that_have_a_setting():
    assert '| `control.kind` | `"pid"` |' in chapter("follower")
    assert "| `control.feed_forward` (pid) |" in chapter("follower")
    assert "| `obstacles[].friction` |" in chapter("world")  # of boxes and cylinders


def test_an_inherited_setting_keeps_its_docstring():
    assert "Time before the person sets off" in chapter("target")


def test_a_command_shows_its_options_and_an_example_as_code():
    app = typer.Typer()

    @app.command()
    def walk(
        speed: Annotated[float, typer.Option(help="Speed | pace.")] = 1.0,
        how: Annotated[Literal["fast", "slow"], typer.Option(help="Manner.")] = "slow",
        quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing.")] = False,
    ) -> None:
        """Walk.

        Examples: mecazen walk · mecazen walk --quiet
        """

    @app.command()
    def stand() -> None:
        """Stand still."""

    text = commands(app)
    assert "## mecazen walk\n\nWalk.\n\n```sh\nmecazen walk\nmecazen walk --quiet\n```" in text
    assert "- `--speed NUMBER` (`1.0`): Speed | pace." in text
    assert "- `--how fast|slow` (`slow`): Manner." in text
    assert "- `--quiet`: Print nothing." in text
    assert "## mecazen stand\n\nStand still." in text


def test_an_option_of_several_commands_is_described_once():
    app = typer.Typer()
    for name in ("one", "two", "three"):

        @app.command(name)
        def command(seed: Annotated[int, typer.Option(help="Seed.")] = 1) -> None:
            """Run."""

    text = commands(app)
    assert text.count("Seed.") == 1
    assert text.count("[Shared](#options-of-several-commands): `--seed INTEGER`.") == 3


def test_an_option_with_another_meaning_stays_with_its_command():
    app = typer.Typer()
    for name, words in (("one", "Seed."), ("two", "Seed."), ("three", "First seed.")):

        @app.command(name)
        def command(seed: Annotated[int, typer.Option(help=words)] = 1) -> None:
            """Run."""

    assert "## mecazen three\n\nRun.\n\n- `--seed INTEGER` (`1`): First seed." in commands(app)
