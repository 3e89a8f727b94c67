"""Tables of results in Markdown, as documents show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from rich.table import Table


class MarkdownTable(msgspec.Struct, frozen=True):
    """A table of a result, with its title and its caption."""

    title: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, table: Table) -> MarkdownTable:
        """Convert a table of the terminal; the second line of a cell is put in brackets."""
        from rich.text import Text  # noqa: PLC0415  # slow to import

        def plain(shown: object) -> str:
            return shown.plain if isinstance(shown, Text) else Text.from_markup(str(shown)).plain

        def cell(shown: object) -> str:
            first, _, second = plain(shown).partition("\n")
            return f"{first} ({second.replace(' … ', '–')})" if second else first

        rows = zip(*(column.cells for column in table.columns), strict=True)
        return cls(
            plain(table.title or ""),
            plain(table.caption or ""),
            tuple(plain(column.header).replace("\n", " ") for column in table.columns),
            tuple(tuple(map(cell, row)) for row in rows),
        )

    @property
    def sentences(self) -> str:
        """The caption as sentences, one for each of its parts."""
        parts = [part.strip() for part in self.caption.split(";")]
        # µs/tick keeps its small letter
        return " ".join(f"{'µ' if p[:1] == 'µ' else p[:1].upper()}{p[1:]}." for p in parts)

    def __str__(self) -> str:
        title = f"**{self.title}.** " if self.title else ""
        return f"{title}{self.sentences}\n\n{lines(self.head, self.rows)}"


def lines(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table's lines."""
    every = [head, ["---"] * len(head), *rows]
    return "".join(f"|{''.join(f' {cell} |' if cell else ' |' for cell in li)}\n" for li in every)
