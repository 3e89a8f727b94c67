"""Comparison of two results: which figures became worse by more than their spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from rich.table import Table

from mecazen_bench.figures import Figure, Name, named
from mecazen_bench.results import Results, ResultsError

LEAST = 0.001
"""Relative change that is ignored: figures that are computed, not timed, have no spread but
differ in their last digits between processors and library versions."""


class Change(NamedTuple):
    """One figure in both results."""

    name: Name
    before: Figure
    after: Figure

    @property
    def ratio(self) -> float | None:
        """The later over the earlier value; None where that is zero."""
        return None if self.before.value == 0.0 else self.after.value / self.before.value

    @property
    def verdict(self) -> Literal["worse", "better", ""]:
        """What the figure became; empty where the spread of both may be the cause."""
        worse_by = self.after.badness(self.after.value) - self.after.badness(self.before.value)
        noise = self.before.spread + self.after.spread
        if abs(worse_by) <= max(noise, LEAST * abs(self.before.value)):
            return ""
        return "worse" if worse_by > 0.0 else "better"


def compare(before: Results, after: Results) -> list[Change]:
    """Return the figures that are in both; the later ones define which way is better.

    Raises:
        ResultsError: There are none.
    """
    earlier = dict(named(before.groups))
    later = named(after.groups)
    changes = [Change(name, earlier[name], figure) for name, figure in later if name in earlier]
    if not changes:
        raise ResultsError("no figure is in both results")
    return changes


def notes(before: Results, after: Results) -> list[str]:
    """Return lines on other differences: machine, load, and figures that only one has."""
    lines = []
    if before.machine != after.machine:
        lines.append(f"different machines: {before.machine} / {after.machine}")
    unpaired = dict(named(before.groups)).keys() ^ dict(named(after.groups)).keys()
    if unpaired:
        groups = ", ".join(sorted({group for group, _, _ in unpaired}))
        lines.append(f"{len(unpaired)} figures are in only one of them: {groups}")
    return [*lines, f"before: {before.others}", f"after: {after.others}"]


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
        shown.add_row(
            subject if (group, subject) != last else "",
            title,
            *(_text(figure) for figure in (change.before, change.after)),
            "" if change.ratio is None else f"{change.ratio:.3f}",
            f"[{colours[change.verdict]}]{change.verdict}[/]",
        )
        last = (group, subject)
    return shown


def _text(figure: Figure) -> str:
    value, quartiles, _ = figure.texts()
    return f"{value} [dim]({quartiles})[/]" if quartiles else value
