"""A run as columns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from mecazen.errors import ConfigError
from mecazen_tools.trajectory import COLUMNS, Trajectory

from mecazen_experiments.poses import Floats, Poses


class Table:
    """The columns of a run, one number for each tick; NaN where there is none.

    Args:
        columns: By their names in `mecazen_tools.trajectory.COLUMNS`; `tracking` is text, empty
            where there is none.
        tick_s: The control period.
    """

    def __init__(self, columns: Mapping[str, npt.NDArray[Any]], tick_s: float) -> None:
        self._columns = columns
        self.tick_s = tick_s

    @classmethod
    def of(cls, trajectory: Trajectory) -> Table:
        """Return the rows of a trajectory as columns; there is at least one row.

        Raises:
            ConfigError: It is of several robots.
        """
        if trajectory.columns != COLUMNS:
            raise ConfigError("robots: an experiment scores one robot, and there are several")
        columns: dict[str, npt.NDArray[Any]] = {
            name: np.array([value or "" for value in column])
            if name == "tracking"
            else np.array(column, dtype=np.float64)
            for name, column in zip(COLUMNS, zip(*trajectory.rows(), strict=True), strict=True)
        }
        t = columns["t_s"]
        return cls(columns, float(t[1] - t[0]) if len(t) > 1 else math.nan)

    def __getitem__(self, name: str) -> Floats:
        """Return the column of that name."""
        return self._columns[name]

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self._columns["t_s"])

    @property
    def tracking(self) -> npt.NDArray[np.str_]:
        """The follower's tracking state, see `TrackingState`."""
        return self._columns["tracking"]

    def poses(self, who: str) -> Poses:
        """Return the poses of `robot` or `target` in world, of `odom` or `estimate` in odom."""
        return Poses(self[f"{who}_x_m"], self[f"{who}_y_m"], self[f"{who}_yaw_rad"])

    def where(self, rows: slice | npt.NDArray[np.bool_]) -> Table:
        """Return some of the ticks."""
        columns = {name: column[rows] for name, column in self._columns.items()}
        return Table(columns, self.tick_s)
