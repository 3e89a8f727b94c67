"""`[crowd]`: pedestrians besides the persons that robots follow."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from mecazen.config.people import Body, Goal, Walk
from mecazen.schema import Finite, Section

Interval = tuple[Finite, Finite]
"""Interval [from, to]."""


class Walker(Section, kw_only=True):
    """A pedestrian whom no robot follows."""

    path: Walk | Goal
    """Only a `goal` path gives way to others."""
    body: Body = Body()
    """A child of 6 has a `height_m` of about 1.15."""


class Reactive(Section, kw_only=True):
    """Walkers who cross an area back and forth between random places at its edges, and give way."""

    count: Annotated[int, msgspec.Meta(ge=1, le=50)]
    x_m: Interval
    """Extent of the area along x in the world; `y_m` is the extent along y."""
    y_m: Interval
    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 1.34
    """Mean of the preferred speeds, as `speed_std_m_s` of U. Weidmann, Transporttechnik der
    Fussgänger, ETH Zürich, 1993."""
    speed_std_m_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.26
    body: Body = Body()

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if low >= high:
                raise ValueError(f"{name}: {low:g} must be below {high:g}")
        (left, right), (near, far) = self.x_m, self.y_m
        if self.count > (right - left) * (far - near):
            raise ValueError("count: at most one walker for each square metre of x_m and y_m")


class CrowdConfig(Section):
    """All pedestrians besides the persons that robots follow."""

    walkers: tuple[Walker, ...] = ()
    reactive: Reactive | None = None
    manners: Literal["helbing", "orca", "sfm"] = "helbing"
    """How all persons with a goal give way. helbing: by the social force of Helbing & Molnár,
    straight to the goal. orca, sfm: as the pedestrians of Follow-Bench, by ORCA or by social
    forces, on planned paths round obstacles."""
    inflation_cells: Annotated[int, msgspec.Meta(ge=0, le=50)] = 5
    """Edge of the square to which each blocked cell grows in the grid that plans these paths; a
    cell is 0.2 m."""
