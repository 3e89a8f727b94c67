"""The paper's table from runs made up by hand."""

import pytest
from mecazen.errors import ConfigError
from mecazen_experiments.table2 import gain, tables

from experiments import made_up


@pytest.fixture
def rows():
    return made_up.six_rows()


def test_the_table_has_the_paper_s_figures_beside_ours(rows):
    text = made_up.shown(*tables(rows))
    for word in ("D_err back [m]", "Θ_err side [°]", "0.22", "12.2", "0.250, 0.350"):
        assert word in text


def test_gains_are_how_much_smaller_the_error_of_the_same_seed_is(rows):
    by_name = {row.name: row for row in rows}
    better = gain(by_name, "back with", "back without", "d_err_m")
    # differences of two seeds, 0.15 and 0.20; but for roundings
    assert better.mean == pytest.approx(0.175, abs=1e-12)
    assert better.values == pytest.approx((0.15, 0.20), abs=1e-12)
    best = gain(by_name, "side best", "side with", "theta_err_deg")
    assert best.mean == pytest.approx(0.95, abs=1e-12)


def test_a_case_that_has_no_errors_is_named(rows):
    with pytest.raises(ConfigError, match="no person walks in the case 'side best'"):
        tables([*rows, made_up.row("side best", None)])
