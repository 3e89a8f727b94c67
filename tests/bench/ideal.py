"""A robot in no simulator: by the ideal equations."""

from collections.abc import Sequence

from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_bench.engine import Engine, Sample
from mecazen_bench.stack import robot

STEP_S = 0.001


class Ideal(Engine):
    """A robot by the ideal equations, whose wheels coast on for ever or slow down."""

    def __init__(self, slowing: float = 0.0) -> None:
        super().__init__("ideal", robot("nexus"), STEP_S)
        sizes = self.robot.wheels.radius_m, self.robot.half_wheelbase, self.robot.half_track
        self._kinematics = MecanumKinematics(*sizes)
        self._slowing = slowing
        self._speeds = self._angles = [0.0] * len(WHEELS)
        self._pose = Pose2D()

    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        self.spent_s += 20e-6 * steps
        for _ in range(steps):
            coasting = [speed * (1.0 - self._slowing * STEP_S) for speed in self._speeds]
            self._speeds = coasting if speeds is None else list(speeds)
            twist = self._kinematics.forward(WheelSpeeds(*self._speeds))
            self._pose = self._pose.integrate(twist, STEP_S)
            moved = zip(self._angles, self._speeds, strict=True)
            self._angles = [angle + speed * STEP_S for angle, speed in moved]
        x, y, yaw = self._pose
        return Sample(x, y, 0.0, yaw, self._angles)
