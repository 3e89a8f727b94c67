"""`make pictures` makes exactly the pictures that documents say it makes."""

import re

from harness import ROOT

from docs.pictures import DOCS, PICTURES

MADE = re.compile(r"<!-- by hand: drawn by make pictures -->\n((?:.*!\[[^\]]*\]\([^)]*\).*\n)+)")
"""The comment, and the lines with pictures below it."""
SHOWN = re.compile(r"!\[([^\]]*)\]\(([^)]*)\)")


def shown():
    """Return the files and alternative texts of all pictures that documents say are made."""
    for document in (ROOT / "README.md", *sorted(DOCS.glob("*.md"))):
        for lines in MADE.findall(document.read_text()):
            for text, place in SHOWN.findall(lines):
                yield (document.parent / place).resolve(), text


def test_every_picture_that_a_document_shows_is_made_and_every_one_made_is_shown():
    made = {DOCS / place for place in PICTURES}
    assert {file for file, _ in shown()} == made
    assert all(file.exists() for file in made)
    assert all(text for _, text in shown())
