"""References are made of docstrings, types and help texts."""

from typing import Annotated, Literal

import typer
from mecazen_tools.references import commands, configuration

CONFIGURATION = configuration()


def test_a_setting_shows_type_range_default_and_docstring():
    row = (
        "| `margin_m` | number ≥ 0, live | `0.06` | Clearance of the robot's outline from things. |"
    )
    assert row in CONFIGURATION


def test_each_table_has_one_chapter_that_rows_link_to():
    chapters = [line for line in CONFIGURATION.splitlines() if line.startswith("## ")]
    assert len(set(chapters)) == len(chapters)
    assert "## sensors.lidar" in chapters
    assert "[table](#sensorslidar)" in CONFIGURATION


def test_a_choice_of_tables_names_the_value_that_selects_each():
    assert "## follower.control, kind pid" in CONFIGURATION
    assert '| `kind` | `"pid"` |  | selects this table |' in CONFIGURATION


def test_an_inherited_setting_keeps_its_docstring():
    *_, straight = CONFIGURATION.partition("## target.path, kind straight")
    assert "Time before the person sets off" in straight.partition("\n## ")[0]


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
    assert "| `--speed NUMBER` | `1.0` | Speed \\| pace. |" in text
    assert "| `--how fast\\|slow` | `slow` | Manner. |" in text
    assert "| `--quiet` |  | Print nothing. |" in text
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
