"""A search for the best settings, by Optuna."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import msgspec
import optuna
from mecazen.errors import MecazenError
from rich.table import Table

from mecazen_experiments.config import Experiment, Range, TunedCase, Tuning
from mecazen_experiments.executor import Progress, RunsFailedError
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Job, Key, expand
from mecazen_experiments.report import Record, Row, summarise
from mecazen_experiments.scores import Scores

SEED = 1
"""Seed of the search, which is deterministic."""
PREFERENCE = 0.001
"""Weight of preferred values: less than any relevant difference between runs."""
EXCESS = 100.0
"""Cost of a score at twice its limit: far above the cost of scores within limits."""
DIGITS = 4
"""Significant digits of a parameter, in the runs and in the table."""

Do = Callable[[Iterable[Job]], Mapping[Key, Record[Scores]]]


class Best(msgspec.Struct, frozen=True):
    """The result of `mecazen experiment tune`."""

    objective: str
    trials: int
    failed_trials: int
    """Number of trials in which a run failed."""
    settings: dict[str, dict[str, float]]
    """The best settings by case; each case includes the common parameters."""
    training_cost: float
    held_out_cost: float
    rows: tuple[Row[Scores], ...]
    """The held-out runs."""


def tune(tuning: Tuning, do: Do, progress: Progress = lambda *_: None) -> Best:
    """Search with the training seeds; return the best settings and their held-out runs.

    `do` executes runs and returns their records, see `mecazen_experiments.executor.run_all`.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=SEED))
    best: tuple[float, dict[str, dict[str, float]]] | None = None
    failed: list[RunsFailedError] = []
    for number in range(tuning.trials):
        progress(number, tuning.trials)
        trial = study.ask()
        settings = suggest(tuning, trial.suggest_float)
        try:
            rows = _run(tuning.cases, settings, tuning.training_seeds, do)
        except RunsFailedError as error:
            study.tell(trial, state=optuna.trial.TrialState.PRUNED)  # avoided from now on
            failed.append(error)
            continue
        found = cost(tuning, rows, settings)
        study.tell(trial, found)
        if best is None or found < best[0]:
            best = found, settings
    progress(tuning.trials, tuning.trials)
    if best is None:
        raise MecazenError(f"every trial failed; the last: {failed[-1]}")
    training_cost, settings = best
    rows = _run(tuning.cases, settings, tuning.held_out_seeds, do)
    costs = training_cost, cost(tuning, rows, settings)
    return Best(tuning.objective, tuning.trials, len(failed), settings, *costs, tuple(rows))


def suggest(tuning: Tuning, choose: Callable[..., float]) -> dict[str, dict[str, float]]:
    """Return each case's settings, chosen by `choose(name, low, high, log=...)`."""

    def chosen(ranges: Mapping[str, Range], prefix: str = "") -> dict[str, float]:
        found = {}
        for key, within in ranges.items():
            value = choose(f"{prefix}{key}", within.low, within.high, log=within.log)
            for setting, factor in {key: 1.0, **within.also}.items():
                found[setting] = float(f"{value * factor:.{DIGITS}g}")
        return found

    shared = chosen(tuning.parameters)
    return {case.name: shared | chosen(case.parameters, f"{case.name}: ") for case in tuning.cases}


def cost(
    tuning: Tuning, rows: Sequence[Row[Scores]], settings: Mapping[str, Mapping[str, float]]
) -> float:
    """Return the cost to minimise: see `match_cost`, `limits_cost` and `preference`."""
    costs = map(match_cost if tuning.objective == "match" else limits_cost, rows)
    preferences = [
        preference(settings[case.name][key], within.prefer)
        for case in tuning.cases
        for key, within in (tuning.parameters | case.parameters).items()
        if within.prefer is not None
    ]
    return math.fsum([*costs, *preferences])


def match_cost(row: Row[Scores]) -> float:
    """Return the sum of the squared relative errors of the means from the published means."""
    return math.fsum(
        ((_mean(row, score) - published) / published) ** 2
        for score, published in row.published.items()
    )


def limits_cost(row: Row[Scores]) -> float:
    """Return the sum of the means relative to their limits, and far more for any excess."""
    parts = [_mean(row, score) / limit for score, limit in row.limits.items()]
    return math.fsum(part + EXCESS * max(0.0, part - 1.0) for part in parts)


def preference(value: float, preferred: float) -> float:
    """Return the cost of a deviation from a preferred value; it decides between equal costs."""
    return PREFERENCE * math.log(value / preferred) ** 2


def _mean(row: Row[Scores], score: str) -> float:
    interval = row.means.get(score)
    if interval is None:
        raise MecazenError(f"{row.name}: there is no {score} in its runs")
    return interval.mean


def _run(
    cases: Sequence[TunedCase],
    settings: Mapping[str, Mapping[str, float]],
    seeds: Sequence[int],
    do: Do,
) -> list[Row[Scores]]:
    todo = []
    for case in cases:
        overrides = tuple(f"{key}={value!r}" for key, value in settings[case.name].items())
        todo += expand(Experiment(cases=(case,)), seeds, overrides)
    records = do([job for one in todo for job in one.jobs])
    return [summarise(FOLLOWING, one, records) for one in todo]


def table(found: Best) -> Table:
    """Return the settings that a search has found."""
    costs = f"cost {found.training_cost:.4g} in training, {found.held_out_cost:.4g} held out"
    failed = f"{found.failed_trials} of {found.trials} trials failed"
    shown = Table("case", "setting", "value", caption=f"{found.objective}: {costs}; {failed}")
    for case, settings in found.settings.items():
        for key, value in settings.items():
            shown.add_row(case, key, f"{value:g}")
    return shown
