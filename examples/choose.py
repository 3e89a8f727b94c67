"""A search by Optuna for how people walk: the modes of the follower's filter, docs/following.md.

It maximises the likelihood of what three sensors see of random walkers, and of the recorded walks
for choosing in a folder. Trials are kept in choose.sqlite, and a second call continues; choose.csv
has all of them, as results/choose.csv those of one search.
Run from the repository: python examples/choose.py [FOLDER]
"""

import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import optuna
from mecazen.config.people import Recorded, Wander
from mecazen.errors import MecazenError
from mecazen.geometry import wrap
from mecazen_follower.estimators.imm import MODES, OBSERVED, SIZE, YAW, ImmBank, Mode, V, W
from mecazen_people.paths import make_path

FRAME_S, SECONDS, SWAY = 0.04, 10.0, 0.014
SENSORS = ((0.05, 5.0), (0.02, 20.0), (0.05, 68.0))
"""Standard deviations of place [m] and yaw [deg]."""
CHOOSING, CHECKING = range(1000, 1012), range(1048, 1060)
"""Numbers of walkers."""
SPLIT = tomllib.loads(Path("configs/walks/split.toml").read_text())
FACTOR = 2.0
"""Each constant is searched within this factor of its present value."""

Frames = list[tuple[np.ndarray, np.ndarray]]


def seen(path: Wander | Recorded, seed: int) -> Frames:
    """Return what each sensor sees of a walk: poses (n, 3), and their covariance (3, 3)."""
    walk, random = make_path(path), np.random.default_rng(seed)
    poses = np.array([walk.at(k * FRAME_S).pose for k in range(round(SECONDS / FRAME_S))])
    stds = [np.array((place, place, math.radians(yaw))) for place, yaw in SENSORS]
    return [(poses + random.normal(size=poses.shape) * std, np.diag(std**2)) for std in stds]


def likelihood(modes: list[Mode], runs: Frames) -> float:
    """Return the mean logarithm of the likelihood of a frame."""
    logs = []
    for poses, R in runs:
        x, P = np.zeros(SIZE), np.eye(SIZE)
        x[:OBSERVED], P[:OBSERVED, :OBSERVED], P[V, V], P[W, W] = poses[0], R, 1.0, 0.25
        bank = ImmBank(modes, SWAY, x, P)
        for z in poses[1:]:
            bank.predict(FRAME_S)
            yaw = float(bank.mu @ bank.x[:, YAW])
            bank.update(np.array((*z[:2], yaw + wrap(z[YAW] - yaw))), R)
            logs.append(bank.log_likelihood)
    return float(np.mean(logs))


def changed(trial: optuna.trial.BaseTrial) -> list[Mode]:
    """Return the modes with the constants of a trial."""
    modes = []
    for number, mode in enumerate(MODES):
        constants = {
            name: value * trial.suggest_float(f"{number} {name}", 1 / FACTOR, FACTOR, log=True)
            for name, value in mode._asdict().items()
            if value and name not in ("moves", "turns")
        }
        modes.append(mode._replace(**constants))
    return modes


if __name__ == "__main__":
    walks = [Path(sys.argv[1]) / f"{name}.csv" for name in SPLIT["choosing"] if len(sys.argv) > 1]
    paths = [Wander(number=number) for number in CHOOSING] + [Recorded(file=file) for file in walks]
    try:
        runs = [frames for seed, path in enumerate(paths) for frames in seen(path, seed)]
    except MecazenError as error:
        sys.exit(f"error: {error}")
    search = optuna.create_study(
        storage="sqlite:///choose.sqlite",
        study_name="modes",
        load_if_exists=True,
        direction="maximize",
        sampler=optuna.samplers.TPESampler(seed=1),
    )
    if not search.trials:  # the present constants come first
        names = [f"{n} {name}" for n, mode in enumerate(MODES) for name in mode._fields]
        search.enqueue_trial(dict.fromkeys(names, 1.0), skip_if_exists=True)
    search.optimize(lambda trial: likelihood(changed(trial), runs), n_trials=150)
    trials = search.trials_dataframe(attrs=("number", "value", "params"))
    trials.to_csv("choose.csv", index=False, float_format="%.6g")
    check = [frames for n in CHECKING for frames in seen(Wander(number=n), n)]
    best = changed(optuna.trial.FixedTrial(search.best_params))
    print(f"best {search.best_value:.4f}; of walkers for checking {likelihood(best, check):.4f},")
    print(f"with the present modes {likelihood(list(MODES), check):.4f}")
    print(*best, sep="\n")
