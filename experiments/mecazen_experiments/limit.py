"""How near following comes to its limit: the Cramér-Rao bound of the estimate, and an oracle.

The bound is the covariance of a Kalman filter that is linearised about the true motion: J. H.
Taylor, The Cramer-Rao estimation error lower bound computation for deterministic nonlinear systems,
IEEE Trans. Automatic Control 24, 1979. For one motion this is the recursion of P. Tichavsky et al.,
Posterior Cramer-Rao bounds for discrete-time nonlinear filtering, IEEE Trans. Signal Processing 46,
1998; the mean over the walkers is the Monte Carlo mean over motions. The bound has knowledge that a
filter lacks: the begin of each segment, its kind, and the walker's character. It takes the targets
of a kind as normal, with their covariance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from mecazen.config import SensorConfig
from mecazen.config.follower import Params
from mecazen.config.people import Wander
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.keys import (
    CMD_VEL,
    FOLLOWER_STATE,
    GROUND_TRUTH,
    OBSERVATION,
    ODOM,
    SCAN,
    TARGET_ODOM,
    Topic,
)
from mecazen.loading import load_scenario
from mecazen.messages import Observation
from mecazen.node import Inputs
from mecazen.portable import Floats
from mecazen.row import Row, due, every
from mecazen.wire import NS_PER_S
from mecazen_follower.estimators import Array, Estimate, Estimator
from mecazen_follower.measurement import Frame, Measurement
from mecazen_follower.node import FollowerNode
from mecazen_people.paths import make_path
from mecazen_people.wander import DIFFUSION, RELAXATION_1_S, Kind, segments, walker
from mecazen_tools.observe import observe
from numpy.random import PCG64, Generator

from mecazen_experiments.scores import SETTLING_S, score

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

SIZE = 9
"""The state: errors of the pose ahead, left and in yaw, of the three velocities, and of their
targets, in the person's frame."""
POSE, VELOCITY, TARGETS = slice(0, 3), slice(3, 6), slice(6, 9)
STEP_S = 0.01
"""Step of the linearised motion [s]."""
MOMENTS_OF = 2000
"""Number of segments from which the targets' covariances are computed."""
KNOWN, UNKNOWN = 1e-8, 1e6
"""Variances: of a target that does not vary, such as that of who stands, and of the start at rest;
of the pose before the first frame."""

ORACLE = {"programs.follower": "mecazen_experiments.limit:OracleFollower"}
MEAN_OF_ABS, MEAN_OF_LENGTH = math.sqrt(2.0 / math.pi), math.sqrt(math.pi / 2.0)
"""Means of |e| and, in the plane, of the length of errors that are normal with deviation 1."""
CERTAIN = (1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12)
"""Covariance of the known person; not 0, which would mean unknown."""
SLOW_M_S, FAST_M_S = 0.3, 0.6
"""Mean speeds of a run that divide the classes of speed."""


def walkers(job: Job) -> dict[str, float | str | None]:
    """Follow a random walker; return errors from 5 s on, those of the limit, and their ratios.

    The limit of D_err and Θ_err is the root of the sum of two squares: the mean error that the
    bound leaves, and that of the oracle, who knows the true person.
    """
    scenario = job.load()
    path = scenario.target.path
    if not isinstance(path, Wander):
        raise ConfigError("target.path.kind must be 'wander' for the program walkers")
    assert job.scenario is not None
    observed = observe(scenario)
    known = observe(load_scenario(job.scenario, {**job.options(), **ORACLE}))
    ours, oracle = (
        score(run.table, scenario.follower.standoff, SETTLING_S) for run in (observed, known)
    )
    if oracle["d_err_m"] is None or oracle["theta_err_deg"] is None:
        raise ConfigError(f"the walker is seen for less than {SETTLING_S} s; see sim.duration_s")
    begin = round((path.start_after_s + SETTLING_S) * scenario.sensor.rate_hz)
    bound = pose_covariances(path, scenario.sensor, scenario.sim.duration_s)[begin:]
    bearing = scenario.follower.standoff.bearing
    towards = np.array((math.cos(bearing), math.sin(bearing), 0.0))
    along = float(np.sqrt(np.einsum("i,nij,j->n", towards, bound, towards)).mean())
    place = float(np.sqrt((bound[:, 0, 0] + bound[:, 1, 1]) / 2.0).mean())
    heading = math.degrees(np.sqrt(bound[:, 2, 2]).mean())
    d_limit = math.hypot(oracle["d_err_m"], MEAN_OF_ABS * along)
    theta_limit = math.hypot(oracle["theta_err_deg"], MEAN_OF_ABS * heading)
    speeds = np.hypot(observed.table["target_vx_m_s"], observed.table["target_vy_m_s"])
    speed = float(speeds.mean())
    return {
        "speed": "slow" if speed < SLOW_M_S else "fast" if speed > FAST_M_S else "medium",
        "speed_m_s": speed,
        "d_err_m": ours["d_err_m"],
        "d_limit_m": d_limit,
        "d_over_limit": _ratio(ours["d_err_m"], d_limit),
        "theta_err_deg": ours["theta_err_deg"],
        "theta_limit_deg": theta_limit,
        "theta_over_limit": _ratio(ours["theta_err_deg"], theta_limit),
        "place_over_bound": _ratio(ours["estimate_position_err_m"], MEAN_OF_LENGTH * place),
        "yaw_over_bound": _ratio(ours["estimate_yaw_err_deg"], MEAN_OF_ABS * heading),
        "oracle_d_err_m": oracle["d_err_m"],
        "oracle_theta_err_deg": oracle["theta_err_deg"],
        "nees": ours["nees"],
        "lost_s": ours["lost_s"],
        "trajectory": observed.trajectory_sha256[:16],
    }


def _ratio(error: float | None, limit: float) -> float | None:
    return None if error is None else error / limit


def pose_covariances(path: Wander, sensor: SensorConfig, duration: float) -> Floats:
    """Return the bound's covariances (n, 3, 3) of ahead, left and yaw, frame by frame.

    Args:
        path: The walker.
        sensor: Rate and noise of the sensor; each frame is seen, without latency.
        duration: Time from the walker's start [s].
    """
    character, plan = walker(path.number)
    spread = target_covariances(path.number)
    motion = make_path(path)
    position, yaw = sensor.position_std_m, math.radians(sensor.yaw_std_deg)
    R, H = np.diag(np.square((position, position, yaw))), np.eye(3, SIZE)
    Q = np.zeros((SIZE, SIZE))
    Q[VELOCITY, VELOCITY] = np.diag(np.square(character.evenness * DIFFUSION)) * STEP_S
    P = np.zeros((SIZE, SIZE))
    P[POSE, POSE], P[VELOCITY, VELOCITY] = UNKNOWN * np.eye(3), KNOWN * np.eye(3)
    steps_per_frame = round(1.0 / sensor.rate_hz / STEP_S)
    begin, end, segment = 0.0, 0.0, None
    covariances = []
    for step in range(round(duration / STEP_S)):
        time = step * STEP_S
        if segment is None or time >= end:
            segment = next(plan)
            begin, end = end, end + segment.duration
            P[TARGETS, :], P[:, TARGETS] = 0.0, 0.0
            P[TARGETS, TARGETS] = spread[segment.kind]
        if step % steps_per_frame == 0:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            P = P - K @ H @ P
            P = (P + P.T) / 2.0
            covariances.append(P[POSE, POSE])
        v, u, w = motion.at(path.start_after_s + time).twist
        A = np.zeros((SIZE, SIZE))
        A[0, 1:4], A[1, [0, 2, 4]], A[2, 5] = (w, -u, 1.0), (-w, v, 1.0), 1.0
        A[VELOCITY, VELOCITY] = -np.diag(RELAXATION_1_S)
        A[VELOCITY, TARGETS] = np.diag(RELAXATION_1_S * (1.0, 1.0, segment.wave(time - begin)))
        F = np.eye(SIZE) + A * STEP_S + A @ A * (STEP_S**2 / 2.0)
        P = F @ P @ F.T + Q
    return np.array(covariances)


def target_covariances(number: int) -> dict[Kind, Floats]:
    """Return the covariance (3, 3) of the targets of a walker's segments, by their kind."""
    drawn: dict[Kind, list[tuple[float, float, float]]] = {kind: [] for kind in Kind}
    drawn_segments = segments(Generator(PCG64([number, MOMENTS_OF])), walker(number)[0])
    for _, segment in zip(range(MOMENTS_OF), drawn_segments, strict=False):
        drawn[segment.kind].append(segment.targets)
    return {kind: np.cov(np.array(rows).T) + KNOWN * np.eye(3) for kind, rows in drawn.items()}


class Truth(Estimator):
    """The true person in place of an estimate."""

    predicts = False
    estimate: Estimate | None = None

    def reset(self) -> None:
        """Forget the person."""
        self.estimate = None

    def predict(self, dt: float) -> None:
        """Do nothing: the estimate is set."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        """Ignore the observation: the truth is known."""


class OracleFollower(FollowerNode):
    """Our follower with the true person instead of an estimate.

    The person's true pose relative to the true robot is transformed to odom with the odometry, like
    an observation.
    """

    ROW = Row(
        "follower",
        inputs=(every(ODOM), every(GROUND_TRUTH), every(TARGET_ODOM), due(SCAN)),
        outputs=(FOLLOWER_STATE, CMD_VEL),
    )

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        self._truth = Truth(Params())
        self.people.estimator = self._truth

    def _frame(self, now_ns: int, inputs: Inputs, topic: Topic[Observation]) -> Frame | None:
        if topic is not OBSERVATION:
            return None
        odom, robot, person = (
            inputs[topic].pose.pose.to_planar() for topic in (ODOM, GROUND_TRUTH, TARGET_ODOM)
        )
        seen = odom.compose(robot.between(person))
        twist = inputs[TARGET_ODOM].twist.twist.to_planar()
        velocity = Twist2D(*rotate(twist.x, twist.y, seen.yaw), twist.yaw)
        self._truth.estimate = Estimate(seen, velocity, CERTAIN)
        return Frame(now_ns / NS_PER_S, [Measurement(seen, CERTAIN)])
