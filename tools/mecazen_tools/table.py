"""A run as columns, and planar poses of many ticks at once: `mecazen.geometry` for arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D, Standoff

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


def wrap(angles: Floats) -> Floats:
    """Return `angles` [rad] brought into [-pi, pi]."""
    return angles - np.rint(angles / np.pi / 2.0) * np.pi * 2.0


class Poses(NamedTuple):
    """Planar poses: x, y [m], yaw [rad], one pose per tick, in one frame."""

    x: Floats
    y: Floats
    yaw: Floats

    def at(self, tick: int) -> Pose2D:
        """Return the pose in one row."""
        return Pose2D(float(self.x[tick]), float(self.y[tick]), float(self.yaw[tick]))

    def compose(self, poses: Poses | Pose2D) -> Poses:
        """Transform poses from these frames to their parent frame."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return Poses(
            self.x + c * poses.x - s * poses.y,
            self.y + s * poses.x + c * poses.y,
            wrap(self.yaw + poses.yaw),
        )

    def between(self, poses: Poses) -> Poses:
        """Transform poses from the parent frame of these frames to these frames."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        dx, dy = poses.x - self.x, poses.y - self.y
        return Poses(c * dx + s * dy, -s * dx + c * dy, wrap(poses.yaw - self.yaw))


class Table:
    """The columns of a run, with one number for each tick; NaN for missing numbers.

    Args:
        columns: Columns by their names in `mecazen_tools.trajectory.COLUMNS`; `tracking` is text,
            empty if missing.
        tick_s: The control period [s].
    """

    def __init__(self, columns: Mapping[str, npt.NDArray[Any]], tick_s: float) -> None:
        self._columns = columns
        self.tick_s = tick_s

    def __getitem__(self, name: str) -> Floats:
        return self._columns[name]

    def __len__(self) -> int:
        return len(self._columns["t_s"])

    @property
    def tracking(self) -> npt.NDArray[np.str_]:
        """The follower's tracking state, see `TrackingState`."""
        return self._columns["tracking"]

    def poses(self, who: str) -> Poses:
        """Return the poses of `robot` or `target` in world, of `odom` or `estimate` in odom."""
        return Poses(self[f"{who}_x_m"], self[f"{who}_y_m"], self[f"{who}_yaw_rad"])

    def ticks(self, t: Floats) -> npt.NDArray[np.int64]:
        """Return the rows at times [s]."""
        rows: npt.NDArray[np.int64]
        rows = np.rint((t - self["t_s"][0]) / self.tick_s).astype(np.int64)
        return rows

    def where(self, rows: slice | npt.NDArray[np.bool_]) -> Table:
        """Return some of the ticks."""
        columns = {name: column[rows] for name, column in self._columns.items()}
        return Table(columns, self.tick_s)

    def having(self, name: str) -> Table:
        """Return the ticks that have a number in a column."""
        return self.where(~np.isnan(self[name]))


def first_motion(table: Table) -> int | None:
    """Return the first tick in which the person's pose differs from the initial one."""
    person = np.stack(table.poses("target"))
    moved = np.flatnonzero((person != person[:, :1]).any(axis=0))
    return int(moved[0]) if moved.size and not np.isnan(person[:, 0]).any() else None


def deviations(table: Table, standoff: Standoff) -> Floats:
    """Return `Standoff.errors` of the true robot tick by tick (3, n): distance [m], two angles."""
    robots, persons = (np.transpose(table.poses(name)).tolist() for name in ("robot", "target"))
    pairs = zip(map(Pose2D._make, persons), map(Pose2D._make, robots), strict=True)
    return np.array([standoff.errors(*pair) for pair in pairs]).reshape(-1, 3).T
