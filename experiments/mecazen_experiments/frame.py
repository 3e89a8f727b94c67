"""The frame of a study: one row a run, with labels, walk, seed, key, and the program's columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd
from mecazen.errors import ConfigError

from mecazen_experiments.study import Study, check_known

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

LABELS = ("case", "walk", "key")
"""Columns of the frame that are always text, like the axes of the grid."""


def to_csv(jobs: Iterable[Job], results: Mapping[str, Mapping[str, Any]]) -> str:
    """Return runs as CSV, in the order of the jobs; a job without a result is left out.

    `results` are the columns of the finished runs, by key. A number has as many digits as are
    needed to read the same number again; truth values are 1 and 0.
    """
    rows = [
        {**job.labels, "walk": job.walk, "seed": job.seed, "key": job.key, **results[job.key]}
        for job in jobs
        if job.key in results
    ]
    text = io.StringIO()
    names = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: int(v) if isinstance(v, bool) else v for k, v in row.items()})
    return text.getvalue()


def read(study: Study, text: str) -> pd.DataFrame:
    """Return the frame of a study from its CSV.

    The frame has further columns: `draw`, the walk, or the seed without one; `published_SCORE` and
    `limit_SCORE` of the cases; and those that the study derives.

    Raises:
        ConfigError: The CSV is not of the study, or a column can't be derived.
    """
    axes = [*study.label_names, *study.grid]
    head, *rows = csv.reader(io.StringIO(text))
    texts = {*LABELS, *axes}
    frame = pd.DataFrame(
        {
            name: list(values) if name in texts else _numbers(values)
            for name, values in zip(head, zip(*rows, strict=True), strict=True)
        }
    )
    for name in ("case", "walk", "seed", "key", *axes):
        check_known(name, frame.columns, "no column", ConfigError)
    frame["draw"] = frame["walk"].where(frame["walk"] != "", frame["seed"].astype(str))
    cases = {case.name: case for case in study.cases}
    for name in frame["case"].unique():
        check_known(name, cases, "no case", ConfigError)
    for prefix, key in (("published", "published"), ("limit", "limits")):
        for score in dict.fromkeys(name for case in study.cases for name in getattr(case, key)):
            values = {name: getattr(case, key).get(score) for name, case in cases.items()}
            frame[f"{prefix}_{score}"] = frame["case"].map(values).astype(float)
    for name, expression in study.derive.items():
        frame[name] = evaluate(frame, expression, f"derive.{name}")
    return frame


def evaluate(frame: pd.DataFrame, expression: str, where: str) -> Any:
    """Return the value of an expression of columns.

    Raises:
        ConfigError: One line with the place of the expression, and the problem.
    """
    try:
        return frame.eval(expression)
    except pd.errors.UndefinedVariableError as error:
        name = str(error).split("'")[1]
        check_known(name, [*frame.columns], f"{where} = {expression!r}: no column", ConfigError)
        raise
    except (SyntaxError, TypeError, ValueError, KeyError, AttributeError, NotImplementedError) as e:
        raise ConfigError(f"{where} = {expression!r}: {' '.join(str(e).split())}") from None


def select(frame: pd.DataFrame, query: str, where: str) -> pd.DataFrame:
    """Return the rows of a frame for which a query is true; raises as `evaluate`."""
    if not query:
        return frame
    selected = evaluate(frame, query, where)
    if not pd.api.types.is_bool_dtype(selected):
        raise ConfigError(f"{where} = {query!r}: must be true or false for each run")
    return frame[selected]


def _numbers(values: Sequence[str]) -> list[Any]:
    """Return the numbers of a column, NaN for an empty cell; or its texts if one is no number.

    pandas itself rounds the last digit in some versions.
    """
    for kind in (int, lambda value: float(value or "nan")):
        try:
            return [kind(value) for value in values]
        except ValueError:
            pass
    return list(values)
