"""One recorded walk: the true joints, and the joints that the robot's body tracker reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.keys import SKELETONS, TARGET_SKELETON
from mecazen.skeleton import JOINTS
from mecazen_people.body.posture import sagittal_angles
from mecazen_tools.observe import observe_bodies
from mecazen_tools.table import Floats, Poses, Table

SEEN = 2
"""Confidence of a joint that is in view and not hidden."""


class Motion(NamedTuple):
    """Joints over time, in a fixed, level frame; the floor is at z = 0.

    In frames without a reported body, joints are NaN and confidence is 0.
    """

    t: Floats
    """Times (n,) [s]."""
    joints: Floats
    """Positions (n, 20, 3) [m], in the order of `mecazen.skeleton.JOINTS`."""
    std: Floats
    """Reported standard deviation of each joint (n, 20) along any axis [m]."""
    confidence: npt.NDArray[np.int64]
    """Confidence as in `messages.Skeleton` (n, 20)."""
    phases: Floats
    """Share of the gait cycle since the last foot strike (n, 2), left and right; NaN if unknown."""

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return 1.0 / float(np.mean(np.diff(self.t)))

    @property
    def reported(self) -> npt.NDArray[np.bool_]:
        """Whether a body was reported (n,)."""
        return ~np.isnan(self.joints[:, 0, 0])

    def where(self, rows: npt.NDArray[Any]) -> Motion:
        """Return some of the frames."""
        return Motion(*(values[rows] for values in self))

    def evenly(self) -> Motion:
        """Return the frames at a constant rate; missing frames have no body."""
        period = float(np.median(np.diff(self.t)))
        at = np.rint((self.t - self.t[0]) / period).astype(np.int64)
        n, joints = int(at[-1]) + 1, len(JOINTS)
        even = Motion(
            self.t[0] + period * np.arange(n),
            np.full((n, joints, 3), np.nan),
            np.zeros((n, joints)),
            np.zeros((n, joints), np.int64),
            np.full((n, 2), np.nan),
        )
        for values, known in zip(even[1:], self[1:], strict=True):
            values[at] = known
        return even

    def placed(self, robot: Poses) -> Motion:
        """Transform joints from the robot's frame to the frame of its poses, one pose per frame."""
        c, s = np.cos(robot.yaw)[:, None], np.sin(robot.yaw)[:, None]
        x, y, z = np.moveaxis(self.joints, -1, 0)
        joints = (robot.x[:, None] + c * x - s * y, robot.y[:, None] + s * x + c * y, z)
        return self._replace(joints=np.stack(joints, axis=-1))


class Capture(NamedTuple):
    """The joints and the table of a run."""

    truth: Motion
    """True joints in world, at the rate of `sensors.skeleton_rate_hz`; deviations are 0."""
    seen: Motion
    """Reported joints at the tracker's frames, in odom: the robot knows no other fixed frame."""
    table: Table
    """Robot and person at every tick."""
    trajectory_sha256: str

    def since(self, t_s: float) -> Capture:
        """Return the joints from a time [s] on, and the whole table."""
        return self._replace(
            truth=self.truth.where(self.truth.t >= t_s), seen=self.seen.where(self.seen.t >= t_s)
        )

    @property
    def truth_at_frames(self) -> Motion:
        """The truth at the captures of `seen`."""
        return self.truth.where(np.searchsorted(self.truth.t, self.seen.t - 1e-6))


def angles(joints: Floats) -> Floats:
    """Return the sagittal angles (n, 6) [deg] of joints (n, 20, 3), as `sagittal_angles`."""
    return np.degrees([sagittal_angles(frame) for frame in joints.tolist()])


def capture(scenario: Scenario) -> Capture:
    """Simulate a scenario; return the true joints and the reported joints."""
    observed = observe_bodies(scenario)
    table = observed.table
    truth, seen = motions(observed.samples[TARGET_SKELETON.key], observed.samples[SKELETONS.key])
    odom = table.poses("odom")
    at = table.ticks(seen.t)
    seen = seen.placed(Poses(*(column[at] for column in odom)))
    return Capture(truth, seen, table, observed.trajectory_sha256)


def motions(bodies: list[m.Skeleton], frames: list[m.Skeletons]) -> tuple[Motion, Motion]:
    """Return the true joints, and the first body of each frame in the frame's coordinates."""
    truth = motion_of([(body.header, body) for body in bodies])
    # frames taken before the start have no stamp
    seen = motion_of(
        [
            (frame.header, frame.skeletons[0] if frame.skeletons else None)
            for frame in frames
            if frame.header.stamp.ns
        ]
    )
    return truth, seen


def motion_of(bodies: Sequence[tuple[m.Header, m.Skeleton | None]]) -> Motion:
    """Return stamped bodies as columns."""
    n = len(JOINTS)
    nobody = [[np.nan] * 3] * n
    return Motion(
        np.array([header.stamp.ns / 1e9 for header, _ in bodies]),
        np.array([[(j.x, j.y, j.z) for j in b.joints] if b else nobody for _, b in bodies]),
        np.array([b.std if b and b.std else [0.0] * n for _, b in bodies]),
        np.array([b.confidence if b and b.confidence else [0] * n for _, b in bodies]),
        np.array([b.phases if b and b.phases else [np.nan] * 2 for _, b in bodies]),
    )
