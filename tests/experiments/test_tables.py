"""Tables of made-up runs: rows, units and intervals; and how often intervals hold the truth."""

import math
from pathlib import Path

import pytest
from mecazen_experiments import frame
from mecazen_experiments.expansion import Job
from mecazen_experiments.identify.models import jackknife
from mecazen_experiments.study import Study, load_study
from mecazen_experiments.tables import make_tables, markdown, most_per_hour, share_interval
from mecazen_tools.statistics import Interval, mean_interval

STUDY = """
[[cases]]
name = "a"
limits = { x = 1.5, x_ratio = 2.0 }
published = { x = 0.5 }
[[cases]]
name = "b"
[grid.view]
back = []
side = []
[derive]
double = "2 * x"
"""


def study(tmp_path: Path, *tables: str) -> Study:
    file = tmp_path / "study.toml"
    file.write_text(STUDY + "".join(f"[[table]]\n{table}\n" for table in tables))
    return load_study(str(file))


def runs(rows):
    """Return a CSV of rows (case, view, walk, seed, columns)."""
    jobs, results = [], {}
    for number, (case, view, walk, seed, columns) in enumerate(rows):
        file = Path(walk) if walk else None
        labels = {"case": case, "view": view}
        jobs.append(Job("p", labels, case, seed, file, None, (), f"{number:04}", ""))
        results[f"{number:04}"] = columns
    return frame.to_csv(jobs, results)


def ten(case, view, offset=0.0, **more):
    return [(case, view, "", seed, {"x": 0.1 * seed + offset, **more}) for seed in range(1, 11)]


def test_a_csv_is_read_back_to_the_same_values(tmp_path):
    values = (0.1 + 0.2, 1e-17, math.pi, None)
    text = runs([("a", "back", "w", n, {"x": x, "name": "q,"}) for n, x in enumerate(values)])
    read = frame.read(study(tmp_path), text)
    assert read["x"].tolist()[:3] == list(values[:3])
    assert read["double"].tolist()[:3] == [2.0 * x for x in values[:3]]
    assert math.isnan(read["x"][3])
    assert read["draw"].tolist() == ["w"] * 4
    assert read["name"].tolist() == ["q,"] * 4


def test_a_unit_is_averaged_before_its_interval(tmp_path):
    columns = '[["x [m]", "x", 1], ["ok", "ok", 0, "share"]]'
    spec = study(tmp_path, f'rows = ["case"]\nunit = ["walk"]\ncolumns = {columns}')
    values = ("u", 1, 0.0, True), ("u", 2, 2.0, True), ("v", 1, 3.0, False)
    rows = [("b", "back", walk, seed, {"x": x, "ok": ok}) for walk, seed, x, ok in values]
    (table,) = make_tables(spec, frame.read(spec, runs(rows)))
    assert table.head == ("case", "n", "x [m]", "ok")
    assert table.rows == [("b", "2 (3 runs)", "1.0, 3.0", "0, 100")]  # two units are two values


def test_columns_summarise_in_several_ways(tmp_path):
    spec = study(
        tmp_path,
        'rows = ["case"]\ncolumns = [["ok", "ok", 0, "share"], ["sum", "x", 1, "sum"], '
        '["least", "x", 1, "min"], ["most", "x", 1, "max"], ["paper", "published_x", 1, "value"], '
        '["rate", "hits", 1, "most_per_hour"], ["gone", "gone", 1]]',
    )
    rows = ten("a", "back", ok=True, hits=0, time_s=360.0, gone=None)
    (table,) = make_tables(spec, frame.read(spec, runs(rows)))
    # Clopper and Pearson: 0.025 ** (1 / 10); Garwood: 3.0 events in an hour
    assert table.rows == [("a", "10", "100 (69–100)", "5.5", "0.1", "1.0", "0.5", "3.0", "-")]


def test_a_row_is_compared_with_its_reference_in_pairs(tmp_path):
    spec = study(
        tmp_path,
        'rows = ["case", "view"]\nreference = { view = "back" }\n'
        'columns = [["x", "x", 2], ["more", "x", 2, "difference"], ["ratio", "x", 2, "ratio"]]',
    )
    rows = [*ten("a", "back"), *ten("a", "side", 1.0), *ten("b", "side")[:3]]
    (table,) = make_tables(spec, frame.read(spec, runs(rows)))
    back, side, alone = table.rows
    assert back[3:] == ("0.55 (0.33–0.77) ≤ 1.5 ✓", "", "")
    assert side[3:5] == ("1.55 (1.33–1.77) ≤ 1.5 ✗", "1.00 (1.00–1.00)")
    assert side[5].endswith("≤ 2 ✗")  # of the ratio
    assert alone[2:] == ("3", "0.20 (-0.05–0.45)", "", "")
    assert "✓" in table.note


def test_no_verdict_below_ten_units(tmp_path):
    spec = study(tmp_path, 'rows = ["case"]\ncolumns = [["x", "x", 2]]')
    (table,) = make_tables(spec, frame.read(spec, runs(ten("a", "back")[:9])))
    assert table.rows[0][2].endswith("≤ 1.5")
    assert "✓" not in table.note


def test_words_of_each_make_rows_and_where_selects(tmp_path):
    spec = study(
        tmp_path,
        'where = "view == \'back\'"\neach = { stage = ["raw", "fine"] }\n'
        'columns = [["error | [m]", "{stage}_x", 0]]',
    )
    columns = {"x": 0.0, "raw_x": 2.0, "fine_x": 1.0}
    text = runs([("a", view, "", 1, columns) for view in ("back", "side")])
    (table,) = make_tables(spec, frame.read(spec, text))
    assert table.rows == [("raw", "1", "2"), ("fine", "1", "1")]
    lines = markdown(table).splitlines()
    assert (lines[2], lines[-1]) == ("| stage | n | error \\| [m] |", "| fine | 1 | 1 |")


def test_an_interval_is_that_of_student():
    # n = 2: tan(0.475 pi) = 12.706 times the half distance of the values, 0.5
    interval = mean_interval([1.0, 2.0])
    assert (interval.low, interval.high) == pytest.approx((1.5 - 6.353, 1.5 + 6.353), abs=1e-3)
    assert interval.ends == pytest.approx((1.0, 2.0), abs=1e-12)  # a few roundings
    # n = 5: 2.776 (table of Student's distribution) times the deviation sqrt(2.5) / sqrt(5)
    interval = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776 * math.sqrt(2.5 / 5.0)
    assert (interval.low, interval.high) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-3)


def test_a_jackknife_of_means_is_their_interval():
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    (interval,) = jackknife(lambda kept: [math.fsum(kept) / len(kept)], values)
    direct = mean_interval(values)
    assert (interval.low, interval.high) == pytest.approx((direct.low, direct.high))
    assert jackknife(lambda kept: [kept[0]], [2.0]) == [Interval(2.0, 2.0, 2.0, 1)]
    (interval,) = jackknife(lambda kept: [math.nan if 1.0 not in kept else 7.0], values)
    assert (interval.mean, math.isnan(interval.low), math.isnan(interval.high)) == (7.0, True, True)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (15, 15, 100.0 * 0.025 ** (1.0 / 15.0), 100.0),  # all: the limit solves p^15 = 0.025
        (0, 15, 0.0, 100.0 - 100.0 * 0.025 ** (1.0 / 15.0)),
        (1, 10, 0.2529, 44.5016),  # Clopper and Pearson's table has 0.3 to 44.5
    ],
)
def test_a_share_of_successes_has_its_exact_interval(successes, n, low, high):
    interval = share_interval([True] * successes + [False] * (n - successes))
    assert (interval.mean, interval.n) == (pytest.approx(100.0 * successes / n), n)
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-3)


@pytest.mark.parametrize(("events", "most"), [(0, 2.996), (1, 4.744), (3, 7.754)])
def test_the_limit_of_a_rate_is_that_of_the_published_table(events, most):
    # one-sided 95 % limits of Poisson's distribution, Garwood 1936
    assert most_per_hour(events, 1.0) == pytest.approx(most, abs=5e-4)
    assert most_per_hour(events, 4.0) == pytest.approx(most / 4.0, abs=5e-4)
