"""Walking persons whom an estimator observes; tests of experiments use them too."""

import math

import numpy as np
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators import make_estimator
from mecazen_follower.estimators.imm import MIN_STEP, ctrv, process_noise

FRAME_S = 0.04
NOISE = np.diag([0.05**2, 0.05**2, math.radians(5.0) ** 2])
MATCHED = {
    "sway_m_sqrt_m": 0.05,
    "acceleration_std_m_s2": 0.3,
    "yaw_acceleration_std_rad_s2": 0.3,
}


def make(name, **params):
    return make_estimator(name, params)


def white(rng, covariance=NOISE):
    return rng.normal(size=3) * np.sqrt(np.diag(covariance))


def frame(estimator, pose, noise=NOISE):
    """Let a frame pass and observe a pose, whose heading `pose[2]` [rad] need not be wrapped."""
    estimator.predict(FRAME_S)
    estimator.update(Pose2D(float(pose[0]), float(pose[1]), wrap(float(pose[2]))), noise)


def simulate_turning(seconds, rng, name="ekf_ctrv"):
    """Yield truth, estimate and NIS after each frame; the truth moves as the filter assumes."""
    estimator = make(name, **MATCHED)
    variances = np.square([MATCHED["sway_m_sqrt_m"], MIN_STEP, 0.0, 0.3, 0.3])
    state = rng.normal(size=5) * [5.0, 5.0, 2.0, 1.0, 0.5]
    for _ in range(round(seconds / FRAME_S)):
        frame(estimator, state[:3] + white(rng))
        yield state[:3], estimator.estimate, estimator.nis
        root = np.linalg.cholesky(process_noise(variances, state, FRAME_S))
        state = ctrv(state, FRAME_S)[0] + root @ rng.normal(size=5)


def total_nees(simulate, runs):
    """Return the sum of the normalised squared errors at the ends of walks of 2 s."""
    rng, total = np.random.default_rng(7), 0.0
    for _ in range(runs):
        *_, (truth, estimate, _) = simulate(2.0, rng)
        error = truth - np.array(estimate.pose)
        error[2] = wrap(error[2])
        total += error @ np.linalg.solve(np.array(estimate.covariance), error)
    return total
