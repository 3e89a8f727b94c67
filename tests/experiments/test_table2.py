"""The paper's table from runs made up by hand."""

import pytest
from mecazen.errors import ConfigError
from mecazen_experiments.table2 import gains

from experiments import made_up


@pytest.fixture
def rows():
    return made_up.six_rows()


def test_gains_are_how_much_smaller_the_error_of_the_same_seed_is(rows):
    found = {(g.view, g.score, g.variant, g.over): g.difference for g in gains(rows)}
    assert len(found) == 8
    better = found["back", "d_err_m", "with", "without"]
    # differences of two seeds, 0.15 and 0.20; but for roundings
    assert better.mean == pytest.approx(0.175, abs=1e-12)
    assert 0.15 - 1e-12 <= better.low <= better.high <= 0.20 + 1e-12
    assert found["side", "theta_err_deg", "best", "with"].mean == pytest.approx(0.95, abs=1e-12)


def test_a_missing_case_is_named(rows):
    with pytest.raises(ConfigError, match="needs a case named 'side best'"):
        gains(rows[:-1])


def test_a_case_without_errors_is_named(rows):
    with pytest.raises(ConfigError, match="no person walks in the case 'side best'"):
        gains([*rows, made_up.row("side best", None)])
