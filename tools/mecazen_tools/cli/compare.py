"""`mecazen compare`: followers in one scenario, seed by seed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from mecazen.loading import load_scenario, scenario_path
from rich.markup import escape
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from mecazen_tools import drawing
from mecazen_tools.cli.options import Duration, ScenarioArgument, Settings, console, output
from mecazen_tools.cli.simulate import progress

if TYPE_CHECKING:
    from mecazen_tools.comparison import Comparison
    from mecazen_tools.statistics import Interval


def compare(
    scenario: ScenarioArgument,
    followers: Annotated[
        list[str],
        Argument(
            metavar="FOLLOWER...",
            help="Two or more: default, a program such as my_follower.py:MyFollower, a trained "
            "policy:weights.npz, or settings such as follower.estimator=none. The last is the "
            "reference.",
        ),
    ],
    seeds: Annotated[int, Option(min=1, max=10_000, help="Number of seeds, from 1 on.")] = 10,
    duration_s: Duration = None,
    output: Annotated[
        Path | None, output("Draw paths, errors and measures: PNG, SVG or PDF.")
    ] = None,
    as_json: Annotated[bool, Option("--json", help="Print the result as JSON.")] = False,
    settings: Settings = None,
) -> None:
    """Compare followers: the same scenario and seeds, and differences seed by seed.

    Examples: mecazen compare back my_follower.py:MyFollower default --seeds 30 -o comparison.pdf ·
    mecazen compare back follower.standoff_m=1.5 default
    """
    from mecazen_tools import comparison  # noqa: PLC0415  # imports SciPy

    if output is not None:
        drawing.refuse_undrawable(output, "-o")
    path = scenario_path(scenario)
    overrides = list(settings or ())
    if duration_s is not None:
        overrides.append(f"sim.duration_s={duration_s}")
    candidates = comparison.candidates(path, followers, overrides)
    numbers = range(1, seeds + 1)
    with progress(f"comparing in {path.stem}", len(candidates) * seeds) as done:
        runs = comparison.run_all(path, candidates, numbers, done)
    result = comparison.compare(path.stem, runs)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(result)).decode())
    else:
        _print(result, comparison.MEASURES)
    if output is not None:
        from mecazen_tools.run_figure import draw_comparison  # noqa: PLC0415  # an extra

        loaded = load_scenario(path, candidates[result.reference])
        figure = draw_comparison(result, runs, loaded, comparison.MEASURES)
        drawing.save(figure, output, "-o")
        if not as_json:
            typer.echo(f"picture: {output}")


def _print(result: Comparison, digits: Mapping[str, int]) -> None:
    from mecazen_tools.statistics import LEAST_UNITS, show  # noqa: PLC0415  # imports SciPy

    def verdict(difference: Interval) -> str:
        if difference.n < LEAST_UNITS:
            return ""
        if difference.low <= 0.0 <= difference.high:
            return "\nno difference shown"
        return "\nworse" if difference.low > 0.0 else "\nbetter"

    table = Table("follower", "n", *map(escape, digits))
    count = len(result.seeds)
    for name, means in result.means.items():
        cells = [show(means[key], digits[key]) if key in means else "-" for key in digits]
        table.add_row(*map(Text, (name, str(count), *cells)))
    table.add_section()
    for name, differences in result.differences.items():
        cells = [
            show(differences[key], digits[key], "+") + verdict(differences[key])
            if key in differences
            else "-"
            for key in digits
        ]
        table.add_row(*map(Text, (f"{name} − {result.reference}", str(count), *cells)))
    console(120).print(table)
    few = f"; no verdict below {LEAST_UNITS} seeds" if count < LEAST_UNITS else ""
    typer.echo(f"means with 95 % t intervals over {count} seeds, differences seed by seed{few}")
