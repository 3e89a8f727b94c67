"""The table of an experiment's cases as a terminal shows it."""

import mecazen_tools.__main__  # noqa: F401  # registers the marks
import msgspec
import pytest
from mecazen_experiments.following import cases
from mecazen_experiments.statistics import Interval

from experiments import made_up


def test_the_table_has_means_intervals_and_marks():
    good = made_up.row("good [red]", *[0.1] * 10, limits={"d_err_m": 0.2})
    bad = made_up.row("bad", *[0.1] * 10, limits={"d_err_m": 0.05})
    text = made_up.shown(*cases([good, bad]))
    for word in ("good [red]", "0.1000", "0.1000 … 0.1000", "1.00", "D_err [m]", "✓", "✗"):
        assert word in text
    assert "d_err_m ≤ 0.05" in text
    in_ascii = text.encode("ascii", "marks").decode()
    for words in ("+ d_err_m < 0.2", "- d_err_m < 0.05", "+ where all", "D_err [m]", "?_err [?]"):
        assert words in in_ascii


def test_a_single_run_has_no_interval_and_a_ratio_to_its_reference():
    row = msgspec.structs.replace(made_up.row("fault", 0.2), d_err_ratio=Interval(2.0, 2.0, 2.0, 1))
    text = made_up.shown(*cases([row]))
    assert "0.2000" in text
    assert "0.2000 … 0.2000" not in text
    assert "2.00" in text


@pytest.mark.parametrize("n", [1, 9])
def test_few_runs_are_neither_within_a_limit_nor_beyond_it(n):
    text = made_up.shown(*cases([made_up.row("few", *[0.1] * n, limits={"d_err_m": 0.2})]))
    assert "d_err_m ≤ 0.2" in text
    assert "✓ d_err_m" not in text  # the caption has this mark
    assert "✗" not in text
