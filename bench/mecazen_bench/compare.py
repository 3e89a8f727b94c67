"""Two results beside each other: what got worse by more than the spread?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from rich.table import Table

from mecazen_bench.figures import Figure, named
from mecazen_bench.results import Results, ResultsError

LEAST = 0.001
"""Share of a figure below which a change is none: what is computed, not timed, has no spread
but changes in its last digits with the processor and the libraries."""


class Change(NamedTuple):
    """One figure in both results."""

    name: tuple[str, str, str]
    """Group, subject and title."""
    before: Figure
    after: Figure

    @property
    def ratio(self) -> float | None:
        """The later figure over the earlier; None where that is zero."""
        return None if self.before.value == 0.0 else self.after.value / self.before.value

    @property
    def verdict(self) -> Literal["worse", "better", ""]:
        """What the figure became; nothing where the spread of both may have made it."""
        worse_by = self.after.badness(self.after.value) - self.after.badness(self.before.value)
        noise = self.before.spread + self.after.spread
        if abs(worse_by) <= max(noise, LEAST * abs(self.before.value)):
            return ""
        return "worse" if worse_by > 0.0 else "better"


def compare(before: Results, after: Results) -> list[Change]:
    """Return the figures that are in both; which way is better, the later ones say.

    Raises:
        ResultsError: There are none.
    """
    earlier = dict(named(before.groups))
    changes = [
        Change(name, earlier[name], figure)
        for name, figure in named(after.groups)
        if name in earlier
    ]
    if not changes:
        raise ResultsError("no figure is in both results")
    return changes


def notes(before: Results, after: Results) -> list[str]:
    """Return lines on what is not alike in both but the figures."""
    lines = []
    if before.machine != after.machine:
        lines.append(f"different machines: {before.machine.text()} / {after.machine.text()}")
    earlier, later = dict(named(before.groups)), dict(named(after.groups))
    lonely = earlier.keys() ^ later.keys()
    if lonely:
        parts = ", ".join(sorted({group for group, _, _ in lonely}))
        lines.append(f"{len(lonely)} figures are in one of them only: {parts}")
    return [*lines, f"before: {before.others.text()}", f"after: {after.others.text()}"]


def table(changes: Sequence[Change]) -> Table:
    """Return the changes for the terminal, one a line."""
    shown = Table("", "", "before", "after", "ratio", "")
    colours = {"worse": "red", "better": "green", "": "default"}
    last = ("", "")
    for change in changes:
        group, subject, title = change.name
        if group != last[0]:
            shown.add_section()
            shown.add_row(f"[bold]{group}[/]")
        ratio = "" if change.ratio is None else f"{change.ratio:.3f}"
        shown.add_row(
            subject if (group, subject) != last else "",
            title,
            *(_text(figure) for figure in (change.before, change.after)),
            ratio,
            f"[{colours[change.verdict]}]{change.verdict}[/]",
        )
        last = (group, subject)
    return shown


def _text(figure: Figure) -> str:
    value, quartiles, _ = figure.texts()
    return f"{value} [dim]({quartiles})[/]" if quartiles else value
