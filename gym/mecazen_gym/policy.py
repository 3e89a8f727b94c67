"""A policy whose constants are trained, and followers that run at the rate of a policy."""

from __future__ import annotations

import math
from pathlib import Path  # msgspec reads the annotations when the program runs
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
from mecazen.config import FollowerConfig, Scenario
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import CMD_VEL, OBSERVATION, ODOM, Topic
from mecazen.messages import Message, Twist
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.portable import Floats, arctan2, exp
from mecazen.wire import NS_PER_S
from mecazen_follower.node import FollowerNode
from mecazen_tools.table import wrap

from mecazen_gym.follow import Array, Sight, Task
from mecazen_gym.planar import arc, between, compose
from mecazen_gym.sensing import Mask

PERIOD_S = 0.1
"""Time between two actions of a policy."""
MODES = {
    "along": (0.1, 0.25, 0.45),
    "across": (0.1, 0.25, 0.45),
    "yaw": (0.04, 0.1, 0.25),
    "speed": (0.02, 0.08, 0.25),
    "turn": (0.01, 0.05, 0.2),
    "yaw_by_across": (0.05, 0.12, 0.25),
    "turn_by_across": (0.01, 0.05, 0.2),
    "straightens_1_s": (1.0, 0.5, 0.2),
    "along_std_m": (0.05, 0.06, 0.08),
    "across_std_m": (0.05, 0.06, 0.08),
    "yaw_std_rad": (0.09, 0.1, 0.13),
}
"""Start values for a person who walks steadily, changes, or turns at once: shares of an innovation
that correct the estimate, the rate at which a turn ends, and the innovations' deviations."""
REST = {"change": 0.05, "walks_m_s": 0.4, "lead_s": 0.1, "slack_s": 0.1}
"""Start values: the probability that the mode changes in a step, the speed above which the way
shows the heading, and times by which the goal and the robot are ahead."""
LAW = {"forward": (1.0, 1.0, 1.0), "gain_1_s": (1.5, 1.5, 1.5)}
"""Start values of the control law by axis: factor of the goal's velocity, gain of the error."""
SIZE = sum(map(len, (*MODES.values(), *LAW.values()))) + len(REST)
"""Number of weights: logarithms of the constants over their start values."""


class Policy:
    """Actions for `n` robots, each in an episode, from observations.

    Three alpha-beta filters of a person who walks along their heading, in base_link, are mixed as
    in an interacting multiple model (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33, 1988);
    the command is the goal's velocity and the error of the pose ahead, axis by axis. Weights are
    (n, SIZE), or (SIZE) for one robot.
    """

    def __init__(self, weights: npt.ArrayLike, task: Task) -> None:
        factors = exp(np.atleast_2d(np.asarray(weights, float)).T)
        values = iter(factors)

        def column(starts: tuple[float, ...]) -> Floats:
            return np.array([start * next(values) for start in starts])

        self._mode = {name: column(starts) for name, starts in MODES.items()}
        self._rest = {name: column((start,))[0] for name, start in REST.items()}
        self._law = {name: column(starts) for name, starts in LAW.items()}
        n = factors.shape[1]
        self._goal = np.array(task.follower.standoff.goal(Pose2D()))[:, None]
        self._scale, self._step_s = np.array(task.scale)[:, None], task.period_s
        self._lost_s = task.follower.lost_after_s
        self._twist, self._age = np.zeros((3, n)), np.full(n, math.inf)
        self._person, self._walk = np.zeros((3, 3, n)), np.zeros((3, 3, n))
        """Pose in base_link and twist of the person (3, modes, n)."""
        self._odds = np.full((3, n), 1.0 / 3.0)
        """Probability of each mode (modes, n)."""

    def act(self, observations: Array) -> Array:
        """Return the actions (n, 3) for the observations (n, 11) of the next step."""
        x, y, c, s, age, *measured = observations.T[:8].astype(float)
        twist, last, step_s = np.array(measured), self._twist, self._step_s
        self._mix()
        person = compose(self._person, arc(self._walk, step_s))
        person = between(arc(0.5 * (twist + last), step_s)[:, None], person)
        is_new = age < self._age + 0.5 * step_s
        past_s = np.where(is_new, age, 0.0)
        # the pose at the capture, in base_link of the present
        drove = arc((twist - last) * (0.5 * past_s / step_s) - twist, past_s)
        seen = compose(drove, np.array((x, y, arctan2(s, c))))
        person = self._correct(person, seen, is_new, past_s)
        begins = is_new & np.isinf(self._age)
        person[..., begins], self._walk[..., begins] = seen[:, None, begins], 0.0
        self._person, self._twist = person, twist
        self._age = np.where(is_new | np.isfinite(self._age), age, math.inf)
        is_known = self._age < self._lost_s
        actions: Array = np.where(is_known, self._command() / self._scale, 0.0).T.clip(-1.0, 1.0)
        return actions.astype(np.float32)

    def _mix(self) -> None:
        """Mix the modes' estimates by the probabilities of the changes into each mode."""
        change = np.minimum(self._rest["change"], 0.5)
        stays = np.eye(3)[:, :, None]
        into = (stays * (1.0 - 1.5 * change) + 0.5 * change) * self._odds[:, None]
        self._odds = into.sum(axis=0)
        shares = into / self._odds
        self._person = (self._person[:, :, None] * shares).sum(axis=1)
        self._walk = (self._walk[:, :, None] * shares).sum(axis=1)

    def _correct(self, person: Floats, seen: Floats, is_new: Mask, past_s: Floats) -> Floats:
        """Return the predicted poses of the modes (3, modes, n), corrected by new frames."""
        mode, (speed, _, turn) = self._mode, self._walk
        expected = compose(person, arc(-self._walk, past_s))
        along, across, yaw = between(expected, seen[:, None]) * is_new
        yaw = np.sin(yaw)
        stds = mode["along_std_m"], mode["across_std_m"], mode["yaw_std_rad"]
        squares = sum((z / std) ** 2 for z, std in zip((along, across, yaw), stds, strict=True))
        odds = self._odds * exp(0.5 * (squares.min(axis=0) - squares)) / np.prod(stds, axis=0)
        self._odds = np.where(is_new, odds / odds.sum(axis=0), self._odds)
        share = {name: np.minimum(gains, 1.0) for name, gains in mode.items()}
        veer = across * speed / (speed * speed + self._rest["walks_m_s"] ** 2)
        self._walk[0] = speed + share["speed"] * along / self._step_s
        turn = turn * (1.0 - np.minimum(mode["straightens_1_s"] * self._step_s, 1.0))
        correction = share["turn"] * yaw + share["turn_by_across"] * veer
        self._walk[2] = turn + correction / self._step_s
        turned = share["yaw"] * yaw + share["yaw_by_across"] * veer
        return compose(person, np.array((share["along"] * along, share["across"] * across, turned)))

    def _command(self) -> Floats:
        """Return the twists that lead to the goals (3, n)."""
        person = (self._person * self._odds).sum(axis=1)
        walk = (self._walk * self._odds).sum(axis=1)
        goal = compose(compose(person, arc(walk, self._rest["lead_s"])), self._goal)
        x, y, yaw = between(arc(self._twist, self._rest["slack_s"]), goal)
        error = np.array((x, y, wrap(yaw)))
        # a point fixed to the person: v + ω × r
        heading, (ahead, beside, _), (speed, _, turn) = goal[2] - self._goal[2], self._goal, walk
        x, y = speed - turn * beside, turn * ahead
        c, s = np.cos(heading), np.sin(heading)
        velocity = np.array((c * x - s * y, s * x + c * y, turn))
        command: Floats = self._law["forward"] * velocity + self._law["gain_1_s"] * error
        return command


class PolicyConfig(FollowerConfig):
    """The section `follower` of a policy."""

    policy: Path | None = None
    """File of the weights; without one all are 0, as before a training."""


class PolicyFollower(Node):
    """A follower that acts as a policy does in its environment: every `PERIOD_S`.

    Raises:
        ConfigError: The scenario's sensor is another than "pose", or the file has no weights.
    """

    SECTION = PolicyConfig

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.task = Task(scenario, period_s=PERIOD_S)
        assert isinstance(scenario.follower, PolicyConfig)
        file = scenario.follower.policy
        self._weights = np.zeros(SIZE) if file is None else read_weights(file)

    def reset(self, seed: int) -> None:
        self._policy, self._sight = Policy(self._weights, self.task), Sight(self.task)
        self._action, self._due_ns = np.zeros(3, np.float32), 0

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        self._sight.look(inputs[ODOM], inputs.get(OBSERVATION))
        if tick.time_ns >= self._due_ns:
            self._due_ns = tick.time_ns + round(PERIOD_S * NS_PER_S)
            observation = self._sight.observation(tick.time_ns / NS_PER_S, self._action.tolist())
            self._action = self._policy.act(observation[None])[0]
        twist = Twist2D(*(self._action * self.task.scale).tolist())
        return {CMD_VEL: Twist.planar(twist)}


class SampledFollower(FollowerNode):
    """The default follower at the rate of a policy, with the newest frame of each period."""

    def reset(self, seed: int) -> None:
        super().reset(seed)
        self._waiting: dict[Topic[Any], Message] = {}
        self._outputs: Outputs = {}
        self._due_ns, self._period_s = 0, 0.0

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        frame = inputs.get(OBSERVATION)
        if frame is not None and frame.poses:
            self._waiting = {OBSERVATION: frame}
        self._period_s += tick.period_s
        if tick.time_ns >= self._due_ns:
            self._due_ns = tick.time_ns + round(PERIOD_S * NS_PER_S)
            sampled = tick._replace(period_s=self._period_s)
            self._outputs = super().step(sampled, Inputs({**self._waiting, ODOM: inputs[ODOM]}))
            self._waiting, self._period_s = {}, 0.0
        return self._outputs


def read_weights(file: Path) -> Floats:
    """Return the weights (SIZE) in a file of `numpy.savez(file, weights=weights)`.

    Raises:
        ConfigError: It has none.
    """
    try:
        weights: Floats = np.asarray(np.load(file)["weights"], float)
    except (OSError, KeyError, ValueError, TypeError, BadZipFile):
        made = "numpy.savez(file, weights=weights)"
        raise ConfigError(f"{file}: no weights of a policy, as {made} writes them") from None
    if weights.shape != (SIZE,) or not np.isfinite(weights).all():
        raise ConfigError(f"{file}: weights: {SIZE} numbers are needed, got {weights.shape}")
    return weights
