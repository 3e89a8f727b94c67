"""Tables of the terminal as Markdown."""

from mecazen_tools.markdown import MarkdownTable
from rich.table import Table
from rich.text import Text


def test_markup_goes_and_an_interval_is_put_in_brackets():
    shown = Table("", "D_err\n\\[m]", title="Errors", caption="means")
    shown.add_row(Text("back [raw]"), "0.10\n[dim]0.09 … 0.11[/]")
    shown.add_row(Text("side"), "[green]✓[/]")
    assert str(MarkdownTable.of(shown)) == (
        "**Errors.** Means.\n\n| | D_err [m] |\n| --- | --- |\n"
        "| back [raw] | 0.10 (0.09–0.11) |\n| side | ✓ |\n"
    )


def test_a_table_without_a_title_begins_with_its_caption():
    assert str(MarkdownTable("", "so", ("a",), (("",),))) == "So.\n\n| a |\n| --- |\n| |\n"


def test_the_parts_of_a_caption_are_sentences():
    table = MarkdownTable("", "means; µs/tick: of one core; ripple: a height", ("a",), ())
    assert table.sentences == "Means. µs/tick: of one core. Ripple: a height."
