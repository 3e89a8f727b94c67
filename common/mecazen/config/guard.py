"""`[guard]`: whether there is a guard, and its margins."""

from __future__ import annotations

from mecazen.schema import Live, NonNegative, Positive, Section


class GuardConfig(Section):
    """The guard between `cmd_vel` and the wheels: docs/safety.md."""

    enabled: bool = True
    """Whether there is one where a lidar is mounted."""
    margin_m: Live[NonNegative] = 0.06
    """Clearance of the robot's outline from things."""
    person_margin_m: Live[NonNegative] = 0.3
    """The same from possible legs: feet and trunk reach farther than the shanks."""
    least_margin_m: NonNegative = 0.05
    """Both margins are at least this; a smaller one must be allowed here first."""
    reaction_s: NonNegative = 0.06
    """From a decision until the wheels follow it."""
    hold_s: NonNegative = 0.05
    """Time for which the controller obeys a silent guard, and the wheels a silent controller. The
    guard counts on it."""
    person_stop_s: NonNegative = 0.3
    """Shortest time in which a walking person can come to rest."""
    person_speed_m_s: Positive = 2.0
    """Highest speed of a walking person."""
    silent_scans: Positive = 3.0
    """A lidar is silent after so many periods without a scan."""
    invalid_share: Positive = 0.5
    """With a larger share of invalid beams a scan is refused."""

    def __post_init__(self) -> None:
        for name in ("margin_m", "person_margin_m"):
            if (margin_m := getattr(self, name)) < self.least_margin_m:
                raise ValueError(
                    f"guard.{name} = {margin_m} must not be below "
                    f"guard.least_margin_m = {self.least_margin_m}"
                )
