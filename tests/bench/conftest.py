"""Every benchmark returns finite figures; how fast it is, is not tested."""

import math

import pytest


@pytest.fixture
def figures():
    """The figures of groups by row."""

    def of(groups):
        rows = {}
        for group in groups:
            text = str(group.table())
            for subject, row in group.rows.items():
                assert f"| {subject} |" in text
                assert all(math.isfinite(figure.value) for figure in row.values())
                rows[subject] = row
        return rows

    return of
