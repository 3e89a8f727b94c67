"""A run of a robot: wheel angles and a reference pose at the same instants, and its checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from mecazen.errors import ConfigError

Array = npt.NDArray[np.float64]

MAX_GAP = 5.0
"""Longest interval between two samples that does not count as a gap [sample periods]."""
MIN_SAMPLES = 50
MAX_PERIOD_S = 0.25
"""Maximum interval between two samples: a window of 0.5 s has two."""
MAX_SPEED_M_S = 10.0
"""Maximum speed of the reference; a faster reference has jumped, or has a wrong unit."""


@dataclass(frozen=True)
class Run:
    """One run; arrays have a row for each sample."""

    name: str
    session: str
    """Name of the session; its runs share all conditions that differ from day to day."""
    times: Array
    """Increasing times (n,) [s]."""
    poses: Array
    """x [m], y [m] and continuous yaw [rad] of the reference (n, 3)."""
    wheels: Array
    """Angles of the wheels in the order of `WHEELS`, forward is positive (n, 4) [rad]."""
    group: str = ""
    """Name of the group; its runs share noise and the mounting of the reference's markers."""
    missing: float = 0.0
    """Share of the reference's time that is missing in the log of the wheels; `wheels` are
    corrected for it."""
    gaps: tuple[int, ...] = field(default=())
    """Indices of the samples before gaps."""
    time_unit: str = "s"
    """Unit of the times in the file."""

    @property
    def kind(self) -> str:
        """Kind of path: the session's name up to the first "_"."""
        return self.session.split("_", maxsplit=1)[0]

    @property
    def period_s(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.times)))

    def as_logged(self) -> Run:
        """Return the run without the correction for time missing in the log of the wheels."""
        return replace(self, wheels=self.wheels * (1.0 - self.missing), missing=0.0)

    def starts(self, size: int, margin: int = 0) -> npt.NDArray[np.int_]:
        """Return the first samples of consecutive windows of `size` steps without a gap."""
        first = np.arange(margin, len(self.times) - size - margin, size)
        gaps = np.asarray(self.gaps, dtype=int)[:, None]
        whole: npt.NDArray[np.bool_] = ~np.any((gaps >= first) & (gaps < first + size), axis=0)
        return first[whole]


def checked(run: Run) -> Run:
    """Return a run with continuous yaw and its gaps.

    Raises:
        ConfigError: One line with the run, the sample and the reason.
    """
    count = len(run.times)
    if count < MIN_SAMPLES:
        raise ConfigError(f"{run.name}: has {count} samples; at least {MIN_SAMPLES} are needed")
    columns = {"time": run.times[:, None], "pose": run.poses, "wheels": run.wheels}
    for what, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise ConfigError(
                f"{run.name}: {what} of sample {bad[0] + 1} is not a finite number; "
                f"{len(bad)} of {count} samples are not"
            )
    steps = np.diff(run.times)
    if len(back := np.flatnonzero(steps <= 0.0)):
        first = back[0]
        raise ConfigError(
            f"{run.name}: time must increase, but sample {first + 2} is at "
            f"{run.times[first + 1]:g} s after {run.times[first]:g} s"
        )
    if (period := float(np.median(steps))) > MAX_PERIOD_S:
        raise ConfigError(
            f"{run.name}: has a sample every {period:.3g} s; at most {MAX_PERIOD_S:g} s is "
            "allowed, with time in seconds"
        )
    speeds = np.hypot(*np.diff(run.poses[:, :2], axis=0).T) / steps
    if (fastest := float(np.percentile(speeds, 99.0))) > MAX_SPEED_M_S:
        raise ConfigError(
            f"{run.name}: the reference moves at {fastest:.3g} m/s; x and y must be in metres, "
            "time in seconds"
        )
    yaw = run.poses[:, 2]
    if np.any(np.abs(np.abs(np.diff(yaw)) - 360.0) < 36.0):
        raise ConfigError(f"{run.name}: yaw jumps by 360: it must be in radians, not degrees")
    poses = run.poses.copy()
    poses[:, 2] = np.unwrap(yaw)
    gaps = np.flatnonzero(steps > MAX_GAP * period)
    return replace(run, poses=poses, gaps=tuple(int(gap) for gap in gaps))


def run_lines(runs: Sequence[Run]) -> list[str]:
    """Return a line for each run with gaps, or with times in another unit than seconds."""
    lines = []
    for run in runs:
        if run.time_unit != "s":
            lines.append(f"{run.name}: time is taken as {run.time_unit}, by its interval")
        if run.gaps:
            longest = max(float(run.times[gap + 1] - run.times[gap]) for gap in run.gaps)
            lines.append(
                f"{run.name}: {len(run.gaps)} gaps of up to {longest:.3g} s; "
                "windows with a gap are left out"
            )
    return lines
