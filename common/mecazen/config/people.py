"""People: `[target]`, whom the robot follows, and `[crowd]`, other pedestrians.

Every path starts at the pose `x_m`, `y_m`, `yaw_deg` in the world; its own coordinates
(waypoints, a recorded track) are in the frame of that pose.
"""

from __future__ import annotations

from pathlib import Path  # msgspec reads the annotations when the program runs
from typing import Annotated, Literal

import msgspec

from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Section

Turn = Literal["left", "right"]


FASTEST_M_S = 13.0
"""Largest speed of a person: no person runs faster [m/s]."""
HEIGHT_M, HEIGHTS_M = 1.75, (0.8, 2.3)
"""Height of a person where nothing else is known, and the range of heights [m]."""


class _Path(Section, tag_field="kind"):
    x_m: Finite = 0.0
    y_m: Finite = 0.0
    yaw_deg: AngleDeg = 0.0


class _Walk(_Path):
    start_after_s: NonNegative = 0.0
    """Time before the person sets off [s]."""
    back_and_forth: bool = False
    """Whether the person turns at the end and walks back, again and again."""


class SteadyWalk(_Walk):
    """A curve at constant speed."""

    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=FASTEST_M_S)] = 0.2


class UTrack(SteadyWalk, tag="u_track"):
    """A straight, a half circle of radius `speed_m_s / yaw_rate_rad_s`, a straight.

    The defaults are those of "A Virtual Mecanum Wheeled Robot ROS Simulator for Multi-view
    and Self-Following Motion Capture", section IV.B; the paper does not give the length.
    """

    length_m: Positive = 5.0
    """Length of each straight."""
    yaw_rate_rad_s: Positive = 0.1
    """Yaw rate on the half circle."""
    turn: Turn = "left"
    """Side to which the half circle turns."""


class Straight(SteadyWalk, tag="straight"):
    """A straight line; the person stands at its end."""

    length_m: Positive = 10.0


class Circle(SteadyWalk, tag="circle"):
    """An endless circle through the start."""

    radius_m: Positive = 2.0
    turn: Turn = "left"
    """Side on which the circle's centre lies."""


class FigureOfEight(SteadyWalk, tag="figure_of_eight"):
    """An endless lemniscate of Bernoulli that starts at its crossing."""

    length_m: Positive = 6.0
    """Distance between the far ends of the loops [m]; their radius there is `length_m / 6`."""
    turn: Turn = "left"
    """Side to which the first loop turns."""


class Waypoints(SteadyWalk, tag="waypoints", kw_only=True):
    """A smooth curve through points; the person stands at the last."""

    points_m: Annotated[
        tuple[tuple[Finite, Finite], ...], msgspec.Meta(min_length=2, max_length=1000)
    ]
    """Points [x, y] in the frame of the start pose [m]; the person starts at the first."""


class Standing(_Path, tag="standing"):
    """The person stands at the start."""


class Recorded(_Walk, tag="recorded", kw_only=True):
    """A recorded track, transformed so that it starts at the start pose."""

    file: Path
    """CSV with the columns `t_s`, `x_m`, `y_m`, or a motion file (.c3d, .trc)."""
    smoothing_s: Positive | None = None
    """Window of the moving average [s]; at least two periods of the recording. By default 0.8, and
    0.3 for a motion file."""


class ScriptStep(Section):
    """A velocity and its duration."""

    duration_s: Positive
    speed_m_s: Annotated[float, msgspec.Meta(ge=0.0, le=FASTEST_M_S)] = 0.0
    direction_deg: AngleDeg = 0.0
    """Direction of the velocity in the person's frame: 0 is ahead, 90 left, 180 backwards."""
    yaw_rate_deg_s: Annotated[float, msgspec.Meta(ge=-1080.0, le=1080.0)] = 0.0


class Script(_Walk, tag="script", kw_only=True):
    """Velocities one after the other, also sideways and backwards; then the person stands."""

    steps: Annotated[tuple[ScriptStep, ...], msgspec.Meta(min_length=1, max_length=1000)]
    acceleration_m_s2: Positive = 6.0
    """Largest acceleration; the default stops a person from 1.8 m/s in 0.3 s, within one
    footstep."""


class Wander(_Walk, tag="wander"):
    """A random walker: see `mecazen_people.wander`."""

    number: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0
    """Number of the walker; each number has another path and top speed."""
    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)] = 60.0
    """Time after which the person stands."""


class Driven(_Path, tag="driven"):
    """The person moves with the twists on `target/cmd_vel`."""

    timeout_s: Positive = 0.5
    """Time without a command after which the person stops [s]."""


class Goal(SteadyWalk, tag="goal", kw_only=True):
    """A straight walk to a place; the person gives way to others and obstacles.

    A person whom a robot follows gives way to all but the robots.
    """

    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=2.5)] = 1.3
    """Preferred speed."""
    goal_m: tuple[Finite, Finite]
    """The goal in the world."""
    via_m: Annotated[tuple[tuple[Finite, Finite], ...], msgspec.Meta(max_length=1000)] = ()
    """Way-points in the world before the goal."""


Walk = (
    UTrack | Straight | Circle | FigureOfEight | Waypoints | Standing | Recorded | Script | Wander
)
"""A path known in advance, unlike `Driven` and `Goal`."""


class Gait(Section):
    """Gait oscillation of the pelvis; sources in `mecazen_people.motion`."""

    sway_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.025
    """Amplitude of the lateral sway [m]."""
    speed_ripple: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.1
    """Amplitude of the forward speed oscillation, relative to the speed."""
    step_length_m: Annotated[float, msgspec.Meta(ge=0.05, le=2.0)] = 0.6
    """Step length [m]; typically 0.3 at 0.2 m/s and 0.7 at 1.3 m/s."""


class Limp(Section):
    """A limp that spares one leg: its stance is shorter, and its step is longer."""

    side: Turn = "right"
    stance_asymmetry: Annotated[float, msgspec.Meta(ge=0.0, le=0.12)] = 0.06
    """The other leg's stance share minus the affected leg's."""
    step_asymmetry: Annotated[float, msgspec.Meta(ge=0.0, le=0.4)] = 0.15
    """The affected leg's step length minus the other leg's, over their mean."""


class StiffKnee(Section):
    """The knee flexes less in swing."""

    side: Literal["left", "right", "both"] = "both"
    flexion: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.5
    """Share of the flexion above 15 deg that remains."""


class Shuffle(Section):
    """Short steps at a high cadence."""

    step_length: Annotated[float, msgspec.Meta(ge=0.3, le=1.0)] = 0.5
    """Step length relative to that of healthy people at the same speed."""


class Body(Section):
    """The person's body and how it walks; see `mecazen_people.body`."""

    height_m: Annotated[float, msgspec.Meta(ge=HEIGHTS_M[0], le=HEIGHTS_M[1])] | None = None
    """Height of the person; default: the motion file's height, else 1.75."""
    limp: Limp | None = None
    stiff_knee: StiffKnee | None = None
    shuffle: Shuffle | None = None
    stride_cv: Annotated[float, msgspec.Meta(ge=0.0, le=0.1)] = 0.0
    """Coefficient of variation of the stride time; healthy adults have 0.01 to 0.03."""
    motion_file: Path | None = None
    """Recorded walk (.c3d, .mot, .trc) whose cycle replaces the normative curves."""


class TargetConfig(Section):
    """The person."""

    path: Walk | Driven | Goal = UTrack()
    """Where the person walks; `kind` selects the type of path."""
    gait: Gait | None = None
    body: Body = Body()


Interval = tuple[Finite, Finite]
"""Interval [from, to]."""


class Walker(Section, kw_only=True):
    """A pedestrian whom no robot follows."""

    path: Walk | Goal
    """Only people on a `goal` path give way."""
    body: Body = Body()
    """A child of 6 has a `height_m` of about 1.15."""
    enters_and_leaves: bool = False
    """Whether the person is absent before and after a recorded walk."""

    def __post_init__(self) -> None:
        if self.enters_and_leaves and not isinstance(self.path, Recorded):
            raise ValueError("enters_and_leaves: the path must be recorded")


class Passerby(Section, tag_field="kind", tag="person"):
    """A person whom no robot follows, added while a simulation runs; nothing of it is a file."""

    path: UTrack | Straight | Circle | FigureOfEight | Standing | Script | Wander = Standing()
    """Its times count from when the person is added."""
    height_m: Annotated[float, msgspec.Meta(ge=HEIGHTS_M[0], le=HEIGHTS_M[1])] = HEIGHT_M


class Reactive(Section, kw_only=True):
    """Walkers who cross an area back and forth between random places at its edges, and give way."""

    count: Annotated[int, msgspec.Meta(ge=1, le=50)]
    x_m: Interval
    """Extent of the area along x in the world; `y_m` is the extent along y."""
    y_m: Interval
    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 1.34
    """Mean of the preferred speeds. Default and standard deviation, 0.26 m/s, are from U. Weidmann,
    Transporttechnik der Fussgänger, ETH Zürich, 1993."""
    body: Body = Body()

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if low >= high:
                raise ValueError(f"{name}: {low:g} must be below {high:g}")
        (left, right), (near, far) = self.x_m, self.y_m
        if self.count > (right - left) * (far - near):
            raise ValueError("count: at most one walker for each square metre of x_m and y_m")


class CrowdConfig(Section):
    """All pedestrians except those whom robots follow."""

    walkers: tuple[Walker, ...] = ()
    reactive: Reactive | None = None
