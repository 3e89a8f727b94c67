"""A search by Optuna over the runs of a study: the calibration in docs/results.md.

It finds the yaw noise of the sensor and the heading's gain of each view with which the errors
without optimisation are the published ones. Run from the repository: python examples/tune.py.
"""

from pathlib import Path
from statistics import fmean

import optuna
from mecazen_experiments.expansion import expand
from mecazen_experiments.runs import Store, local_workers, run_all
from mecazen_experiments.study import load_study

CASES = ("back without", "side without")
TRAINING, HELD_OUT = (101, 102), (103, 104, 105, 106, 107, 108)


def errors(parameters: dict[str, float], seeds: tuple[int, ...]) -> dict[str, float]:
    """Return the relative error of each published mean; finished runs are kept."""
    study, deviations = load_study("table2"), {}
    for case in (case for case in study.cases if case.name in CASES):
        name = case.name
        settings = tuple(
            f"{key.removeprefix(f'{name}: ')}={value:.4g}"
            for key, value in parameters.items()
            if ":" not in key or key.startswith(name)
        )
        jobs = expand(study, seeds, settings, only=[f"case={name}"])
        runs = run_all(jobs, Store(Path("experiments.sqlite")), local_workers())
        for score, published in case.published.items():
            mean = fmean(float(columns[score] or 0.0) for columns in runs.values())
            deviations[f"{name}, {score}"] = mean / published - 1.0
    return deviations


def cost(trial: optuna.Trial) -> float:
    """Return the sum of the squared relative errors."""
    parameters = {"sensor.yaw_std_deg": trial.suggest_float("sensor.yaw_std_deg", 60, 72, log=True)}
    for name in CASES:
        key = f"{name}: follower.control.yaw.kp"
        parameters[key] = trial.suggest_float(key, 1.0, 2.5, log=True)
    return sum(error**2 for error in errors(parameters, TRAINING).values())


if __name__ == "__main__":
    search = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=1))
    search.optimize(cost, n_trials=24)
    print(search.best_params)
    for score, error in errors(search.best_params, HELD_OUT).items():
        print(f"{score}: {100.0 * error:+.1f} % of the published mean, on held-out seeds")
