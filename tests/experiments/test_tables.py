"""Tables of rows: labels, and means, sums and least values of scores."""

import msgspec
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.report import summarise
from mecazen_experiments.tables import table

from experiments import made_up


def test_a_row_shows_its_labels_and_each_score_as_it_was_summarised():
    row = msgspec.structs.replace(
        made_up.row("door, back", 0.1, 0.2, 0.3),
        labels={"case": "[door]", "view": "back"},
        sums={"contacts": 3.0},
        least={"gap": -0.25, "none": None},
    )
    columns = [("touched", "contacts", 0), ("gap", "gap", 2), ("far", "none", 2)]
    columns += [("D_err", "d_err_m", 3), ("NEES", "nees", 2)]
    text = made_up.shown(table(["situation", "view"], columns, [row]))
    cells = next(line for line in text.splitlines() if "door" in line).split("│")[1:-1]
    assert [cell.strip() for cell in cells] == (
        ["[door]", "back", "3", "3", "-0.25", "", "0.200", "-"]
    )
    # 4.303 (Student's distribution, n = 3) times 0.1 / sqrt(3)
    assert "-0.048 … 0.448" in text


def test_two_units_are_shown_as_two_values():
    text = made_up.shown(table(["case"], [("D_err", "d_err_m", 3)], [made_up.row("a", 0.2, 0.1)]))
    assert "0.100, 0.200" in text
    assert "…" not in text


def test_runs_that_are_not_independent_are_counted_with_their_units():
    runs = {("a", 1): 0.1, ("a", 2): 0.2, ("b", 1): 0.4, ("b", 2): 0.4}
    found = summarise(FOLLOWING, *made_up.series("walks", runs))
    text = made_up.shown(table(["case"], [("D_err", "d_err_m", 3)], [found]))
    row = next(line for line in text.splitlines() if "walks" in line)
    assert row.split("│")[2].strip() == "2"
    assert "4 runs" in text
