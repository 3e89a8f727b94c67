"""A wheel's speed controller."""

from __future__ import annotations

from mecazen.config.physics import Pid


class WheelPid:
    """PID from speed error to torque, as control_toolbox's: the integral term is clamped.

    Called once per physics step of `dt` [s].
    """

    def __init__(self, gains: Pid, max_torque: float, dt: float) -> None:
        self._gains = gains
        self._max_torque = max_torque
        self._dt = dt
        self._integral = 0.0
        self._last_error: float | None = None

    def update(self, error: float) -> float:
        """Return the torque [N·m] for the speed error goal - speed [rad/s]."""
        gains = self._gains
        clamp = gains.i_clamp_nm
        self._integral += gains.i_nm * error * self._dt
        self._integral = min(max(self._integral, -clamp), clamp)
        slope = 0.0 if self._last_error is None else (error - self._last_error) / self._dt
        self._last_error = error
        torque = gains.p_nms * error + self._integral + gains.d_nms2 * slope
        return min(max(torque, -self._max_torque), self._max_torque)
