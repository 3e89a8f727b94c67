"""The default filter on recorded pedestrians to whom nothing was fitted, frame by frame."""

import math

import numpy as np
import pytest
from harness import ROOT
from mecazen.config.people import Recorded
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators import make_estimator
from mecazen_people.paths import make_path

FOLDERS = [folder / "shared" / "data" / "pedestrians" for folder in ROOT.parents]
PEDESTRIANS = next((folder for folder in FOLDERS if folder.exists()), None)
"""Recorded pedestrians, which are no part of the project."""
HELD_OUT = "eth_2", "eth_238", "eth_257"
FRAME_S = 0.04
STD = 0.05, 0.05, math.radians(5.0)
NOISE = np.diag(np.square(STD))
BEST_SINGLE = {"acceleration_std_m_s2": 0.3, "yaw_acceleration_std_rad_s2": 1.3}
"""The disturbances of `ekf_ctrv` with the least error of the heading on these walks."""


WALKING_M_S = 0.4
"""Slower, the recorded heading is held while the person shuffles sideways, which no mode allows:
NEES is 7 there."""


def scores(name, params):
    """Return mean NEES while walking, and mean error of the heading [deg], of all walks."""
    nees, turns = [], []
    for walk in HELD_OUT:
        path = make_path(Recorded(file=PEDESTRIANS / f"{walk}.csv"))
        estimator = make_estimator(name, params)
        rng = np.random.default_rng(1)
        for number in range(int(path.duration / FRAME_S)):
            estimator.predict(FRAME_S)
            truth, twist, _ = path.at(number * FRAME_S)
            x, y, yaw = (np.array(truth) + rng.normal(size=3) * STD).tolist()
            estimator.update(Pose2D(x, y, wrap(yaw)), NOISE)
            pose, covariance = estimator.estimate.pose, np.array(estimator.estimate.covariance)
            turn = wrap(pose.yaw - truth.yaw)
            error = np.array([pose.x - truth.x, pose.y - truth.y, turn])
            if math.hypot(twist.x, twist.y) >= WALKING_M_S:
                nees.append(error @ np.linalg.solve(covariance, error))
            turns.append(math.degrees(abs(turn)))
    return np.mean(nees), np.mean(turns)


@pytest.mark.skipif(PEDESTRIANS is None, reason="no ../shared/data/pedestrians")
def test_the_filter_is_consistent_and_better_than_the_best_single_one():
    nees, turn_deg = scores("imm", {})
    _, single_deg = scores("ekf_ctrv", BEST_SINGLE)
    assert 2.2 < nees < 4.0
    assert turn_deg < 0.93 * single_deg  # 11 % over four seeds
