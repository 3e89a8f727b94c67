"""A PID controller of one axis."""

from __future__ import annotations

from mecazen.schema import NonNegative, Positive, Section


class Gains(Section):
    """Gains of one axis. The output is a velocity: kp in 1/s, ki in 1/s², kd without unit."""

    kp: NonNegative
    limit: Positive
    """Largest magnitude of the output [m/s or rad/s]."""
    ki: NonNegative = 0.0
    kd: NonNegative = 0.0


class PID:
    """u = feed-forward + kp e + ki ∫e dt - kd dm/dt, limited, with anti-windup.

    The derivative acts on the measurement m and not on the error, so a step of the reference
    gives no kick. The caller passes the rate of m, so angles need no unwrapping here.

    Anti-windup by conditional integration: while the output is saturated, an error that would
    push it further is not integrated.
    """

    def __init__(self, gains: Gains) -> None:
        self._gains = gains
        self._integral = 0.0

    def update(self, error: float, rate: float, dt: float, feed_forward: float = 0.0) -> float:
        """Return the output for `error` = reference - measurement, after `dt` [s].

        `rate` is the derivative of the measurement; `feed_forward` has the unit of the output
        and counts towards its limit.
        """
        gains = self._gains
        integral = self._integral + gains.ki * error * dt
        output = feed_forward + gains.kp * error + integral - gains.kd * rate
        if abs(output) <= gains.limit or output * error < 0.0:
            self._integral = integral
        return min(max(output, -gains.limit), gains.limit)

    def reset(self) -> None:
        """Set the integral to zero."""
        self._integral = 0.0
