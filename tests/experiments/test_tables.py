"""Tables of experiments as a terminal shows them."""

import msgspec
from mecazen_experiments.table2 import gains
from mecazen_experiments.tables import cases, table2

from experiments import made_up


def test_the_table_has_means_intervals_and_marks():
    good = made_up.row("good [red]", 0.1, 0.1, limits={"d_err_m": 0.2})
    bad = made_up.row("bad", 0.1, 0.1, limits={"d_err_m": 0.05})
    text = made_up.shown(cases([good, bad]))
    for word in ("good [red]", "0.1000", "0.1000 … 0.1000", "1.00", "D_err [m]", "✓", "✗"):
        assert word in text


def test_a_single_run_has_no_interval():
    text = made_up.shown(cases([made_up.row("one", 0.1)]))
    assert "0.1000" in text
    assert "0.1000 … 0.1000" not in text


def test_the_table_has_the_ratio_to_the_reference():
    row = msgspec.structs.replace(made_up.row("fault", 0.2), d_err_ratio=2.0)
    assert "2.00" in made_up.shown(cases([row]))


def test_the_table_has_the_paper_s_figures_beside_ours():
    rows = made_up.six_rows()
    text = made_up.shown(*table2(rows, gains(rows)))
    for word in ("D_err back [m]", "Θ_err side [°]", "0.22", "12.2", "0.300", "3.00", "0.175"):
        assert word in text
