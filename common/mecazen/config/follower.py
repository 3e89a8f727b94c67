"""`[follower]` and `[guard]`: where to stand, how to estimate, how to drive, how close to pass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

from mecazen.geometry import Standoff
from mecazen.schema import AngleDeg, Live, NonNegative, Positive, Section


class Params(Section):
    """Parameters of every estimator: the noise assumed for a sensor that reports none."""

    position_std_m: Positive = 0.05
    yaw_std_deg: Positive = 5.0


class DisplacementParams(Params):
    """Parameters of `kf_displacement`."""

    position_drift_m_sqrt_s: Positive = 0.1
    """Random walk of the position: its standard deviation after 1 s."""
    smoothing_s: Positive = 1.0
    """Time constant of the exponential smoothing of the displacement."""
    min_speed_m_s: NonNegative = 0.08
    """Below this speed the heading is not taken from the displacement."""


class TurnRateParams(Params):
    """Parameters of all filters of constant turn rate and velocity.

    A random walk is given by its standard deviation after 1 s.
    """

    sway_m_sqrt_m: Positive = 0.03
    """Isotropic random walk of the position: its standard deviation after 1 m walked."""


class CtrvParams(TurnRateParams):
    """Parameters of `ekf_ctrv`."""

    acceleration_std_m_s2: Positive = 0.3
    """Random walk of the speed."""
    yaw_acceleration_std_rad_s2: Positive = 0.3
    """Random walk of the turn rate."""


class ImmParams(TurnRateParams):
    """Parameters of `imm`."""

    sway_m_sqrt_m: Positive = 0.014


PARAMS: dict[str, type[Params]] = {
    "none": Params,
    "kf_displacement": DisplacementParams,
    "ekf_ctrv": CtrvParams,
    "imm": ImmParams,
}
"""The parameters of each estimator by its name; an estimator of a user program adds its own."""


def make_params(name: str, params: Mapping[str, float]) -> Params:
    """Return the parameters of the estimator `name`: those given, else their defaults.

    Raises:
        ValueError: The name or a parameter is unknown.
    """
    if name not in PARAMS:
        raise ValueError(f"unknown estimator {name!r}, allowed: {', '.join(sorted(PARAMS))}")
    kind = PARAMS[name]
    unknown = params.keys() - set(kind.__struct_fields__)
    if unknown:
        raise ValueError(
            f"{name} has no parameter {', '.join(sorted(unknown))}, "
            f"allowed: {', '.join(kind.__struct_fields__)}"
        )
    return msgspec.convert(params, kind)


VIEWS = {
    "back": (180.0, 0.0),
    "side_left": (90.0, -90.0),
    "side_right": (-90.0, 90.0),
    "front": (0.0, 180.0),
}
"""Bearing and heading [deg] of each named view. The robot faces the person in all of them."""
PRIORITIES = ("distance", "visibility", "bearing", "heading")


class Gains(Section):
    """Gains of one axis. The output is a velocity: kp in 1/s, ki in 1/s², kd without unit."""

    kp: Live[NonNegative]
    limit: Live[Positive]
    """Largest magnitude of the output [m/s or rad/s]."""
    ki: Live[NonNegative] = 0.0
    kd: Live[NonNegative] = 0.0


class LinearGains(Gains):
    """Gains along x or y of base_link."""

    kp: Live[NonNegative] = 1.5
    ki: Live[NonNegative] = 0.1
    limit: Live[Positive] = 2.0


class AngularGains(Gains):
    """Gains of the yaw axis."""

    kp: Live[NonNegative] = 2.0
    ki: Live[NonNegative] = 0.1
    limit: Live[Positive] = 2.5


class PidControl(Section, tag_field="kind", tag="pid"):
    """Three PIDs along the axes of base_link, on the error of the goal pose.

    The command is a velocity, so the error decays with the time constant 1/kp and a derivative
    term only slows it. The derivative is for a robot whose wheels lag.
    """

    x: LinearGains = LinearGains()
    y: LinearGains = LinearGains()
    yaw: AngularGains = AngularGains()
    feed_forward: Live[bool] = True
    """Whether the goal's estimated velocity is added to the command."""


class PolarControl(Section, tag_field="kind", tag="polar"):
    """Decoupled control of distance, bearing and heading, with feed-forward of the person."""

    linear_gain_1_s: Live[Positive] = 5.0
    """Proportional gain of distance and bearing; the error decays with the time constant 1/gain."""
    heading_gain_1_s: Live[Positive] = 5.0
    max_speed_m_s: Live[Positive] = 2.0
    """Largest magnitude of the planar velocity of base_link."""
    max_yaw_rate_rad_s: Live[Positive] = 3.0


class PlannerConfig(Section):
    """The planner of paths round obstacles and people that the lidar sees."""

    samples: Annotated[int, msgspec.Meta(ge=100, le=20_000)] = 1000
    clearance_m: Live[Positive] = 0.12
    """Minimum distance between the robot and everything else."""
    priorities: Live[tuple[str, ...]] = PRIORITIES
    """Properties of the robot's place, the most important first; the planner gives up the last
    property first."""

    def __post_init__(self) -> None:
        if sorted(self.priorities) != sorted(PRIORITIES):
            raise ValueError(f"priorities must be {', '.join(PRIORITIES)}, each once, in any order")

    @property
    def turns_to_see(self) -> bool:
        """Whether the planner gives up the heading in order to see the person."""
        return self.priorities.index("visibility") < self.priorities.index("heading")


class FollowerConfig(Section):
    """The follower: where to stand, how to estimate, how to drive.

    The place is a named `view`; `bearing_deg` and `heading_deg` together override it.
    """

    view: Live[Literal["back", "side_left", "side_right", "front"]] = "back"
    bearing_deg: Live[AngleDeg | None] = None
    """Direction from the person to the robot: 0 is ahead of the person, 90 to their left."""
    heading_deg: Live[AngleDeg | None] = None
    """The robot's heading minus the person's."""
    standoff_m: Live[Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]] = 1.0
    """Distance from the person to the robot."""
    estimator: str = "imm"
    estimator_params: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters of the estimator by name; missing parameters have their defaults."""
    control: PolarControl | PidControl = PolarControl()
    """The control law; `kind` selects it."""
    planner: PlannerConfig | None = None
    """If left out, the robot drives straight to its place and ignores obstacles."""
    response_s: NonNegative = 0.0
    """Dead time from a command to the robot's motion; commands are computed for that time ahead."""
    lost_after_s: Positive = 4.0
    """Time without an observation after which the person is `lost`: the robot searches or stops."""
    search_s: Live[NonNegative] = 60.0
    """Time without an observation up to which the robot searches; 0: no search."""

    def __post_init__(self) -> None:
        if (self.bearing_deg is None) != (self.heading_deg is None):
            raise ValueError("bearing_deg and heading_deg must be given together")
        make_params(self.estimator, self.estimator_params)

    @property
    def standoff(self) -> Standoff:
        """The place to keep beside the person, with angles in radians."""
        bearing, heading = VIEWS[self.view]
        if self.bearing_deg is not None and self.heading_deg is not None:
            bearing, heading = self.bearing_deg, self.heading_deg
        return Standoff(self.standoff_m, math.radians(bearing), math.radians(heading))


Margin = Annotated[float, msgspec.Meta(ge=0.05, le=1e9)]
"""Clearance [m]; no client can lower it further."""


class GuardConfig(Section):
    """The guard between `cmd_vel` and the wheels: docs/safety.md."""

    enabled: bool = True
    """Whether the guard runs, if a lidar is mounted."""
    margin_m: Live[Margin] = 0.06
    """Clearance between the robot's outline and obstacles."""
    person_margin_m: Live[Margin] = 0.3
    """Clearance from possible legs, since feet and trunk reach farther than the shanks."""
    reaction_s: NonNegative = 0.06
    """Time from a decision of the guard until the wheels follow it."""
    hold_s: NonNegative = 0.05
    """Time for which the last command of a silent guard or controller is obeyed. The guard relies
    on this time."""
