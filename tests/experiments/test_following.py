"""The table of an experiment's cases as a terminal shows it."""

import msgspec
from mecazen_experiments.following import cases

from experiments import made_up


def test_the_table_has_means_intervals_and_marks():
    good = made_up.row("good [red]", 0.1, 0.1, limits={"d_err_m": 0.2})
    bad = made_up.row("bad", 0.1, 0.1, limits={"d_err_m": 0.05})
    text = made_up.shown(*cases([good, bad]))
    for word in ("good [red]", "0.1000", "0.1000 … 0.1000", "1.00", "D_err [m]", "✓", "✗"):
        assert word in text


def test_a_single_run_has_no_interval_and_a_ratio_to_its_reference():
    row = msgspec.structs.replace(made_up.row("fault", 0.2), d_err_ratio=2.0)
    text = made_up.shown(*cases([row]))
    assert "0.2000" in text
    assert "0.2000 … 0.2000" not in text
    assert "2.00" in text
