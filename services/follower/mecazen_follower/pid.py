"""A PID controller of one axis."""

from __future__ import annotations

from mecazen.schema import NonNegative, Positive, Section


class Gains(Section):
    """Gains of one axis; the output is a velocity, so kp is per second and kd has no unit."""

    kp: NonNegative
    limit: Positive
    """Largest output, either way [m/s or rad/s]."""
    ki: NonNegative = 0.0
    kd: NonNegative = 0.0


class PID:
    """u = feed-forward + kp e + ki ∫e dt - kd dm/dt, limited, with anti-windup.

    The derivative acts on the measurement m and not on the error: a reference that jumps
    gives no kick. The caller gives m's rate; so an angle's wrap is no concern here.

    Anti-windup is by conditional integration: while the output is at its limit, an error
    that would push it further is not integrated.
    """

    def __init__(self, gains: Gains) -> None:
        self._gains = gains
        self._integral = 0.0

    def update(self, error: float, rate: float, dt: float, feed_forward: float = 0.0) -> float:
        """Return the output for `error` = reference - measurement, after `dt` [s].

        `rate` is the measurement's change per second; `feed_forward` is in the output's
        unit and falls under its limit.
        """
        gains = self._gains
        integral = self._integral + gains.ki * error * dt
        output = feed_forward + gains.kp * error + integral - gains.kd * rate
        if abs(output) <= gains.limit or output * error < 0.0:
            self._integral = integral
        return min(max(output, -gains.limit), gains.limit)

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = 0.0
