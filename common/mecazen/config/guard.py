"""`[guard]`: whether there is a guard, and its margins."""

from __future__ import annotations

from mecazen.schema import Live, NonNegative, Positive, Section


class GuardConfig(Section):
    """The guard between `cmd_vel` and the wheels: docs/safety.md."""

    enabled: bool = True
    """Whether the guard runs, if a lidar is mounted."""
    margin_m: Live[NonNegative] = 0.06
    """Clearance between the robot's outline and obstacles."""
    person_margin_m: Live[NonNegative] = 0.3
    """Clearance from possible legs, since feet and trunk reach farther than the shanks."""
    least_margin_m: NonNegative = 0.05
    """Lower bound of both margins; for a smaller margin, this value must be lowered first."""
    reaction_s: NonNegative = 0.06
    """Time from a decision of the guard until the wheels follow it."""
    hold_s: NonNegative = 0.05
    """Time for which the controller obeys a silent guard, and the wheels a silent controller. The
    guard relies on this time."""
    person_stop_s: NonNegative = 0.3
    """Shortest time in which a walking person can come to rest."""
    person_speed_m_s: Positive = 2.0
    """Highest speed of a walking person."""
    silent_scans: Positive = 3.0
    """Number of scan periods without a scan after which a lidar counts as silent."""
    invalid_share: Positive = 0.5
    """Share of invalid beams above which a scan is refused."""

    def __post_init__(self) -> None:
        for name in ("margin_m", "person_margin_m"):
            if (margin_m := getattr(self, name)) < self.least_margin_m:
                raise ValueError(
                    f"guard.{name} = {margin_m} must not be below "
                    f"guard.least_margin_m = {self.least_margin_m}"
                )
