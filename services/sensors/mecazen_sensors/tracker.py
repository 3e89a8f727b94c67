"""A body tracker: simulates the joints that an RGB-D camera with a body-tracking SDK reports.

The error of a reported joint has three parts: a bias that depends only on the view, an
Ornstein-Uhlenbeck process that drifts within a second, and white noise that grows with depth. White
noise of a typical size explains a sixth of the variance that gait studies find in knee angles (4.8°
of 12°); the rest is drift, bias and occlusion.

A joint is visible if the ray to it first hits a limb to which the joint belongs. A hidden joint is
noisier, lags behind, and is pulled towards the posture of the other leg.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from mecazen import messages as m
from mecazen.arrays import rotate
from mecazen.config.sensors import TrackerConfig
from mecazen.geometry import Pose2D
from mecazen.portable import Floats, product
from mecazen.robot import CameraMount
from mecazen.skeleton import INDEX, JOINTS, LIMBS, PARENTS
from mecazen.view import out_of_view
from mecazen.wire import NS_PER_S
from numpy.random import PCG64, Generator

from mecazen_sensors.camera import CameraView
from mecazen_sensors.raycast import CARRIER, RayScene

NOISE_SCALE = {"hip": 1.8, "knee": 1.2, "ankle": 1.4, "heel": 1.5, "foot": 1.5, "wrist": 1.5}
"""Factors of white noise and drift, by joint; 1 for others. They increase away from the trunk."""
BIAS_SCALE = {"pelvis": 1.5, "hip": 2.2, "knee": 0.8, "ankle": 1.0, "heel": 0.8, "foot": 0.8}
"""Factors of the bias, tuned: pelvis and hips, which no landmark shows, have the largest."""
GUESSED_STD_M = {"knee": 0.2, "ankle": 0.28, "heel": 0.4, "foot": 0.4}
"""Additional reported deviation of a hidden joint of a leg, per `hidden_pull`; tuned for lag and
pull together."""
WHITE_RANGE_M = 3.0
"""Depth at which white noise has twice the deviation near the camera [m]."""
BEHIND_RAD = math.radians(60.0)
"""Bearing from straight behind a person within which back and front may be confused."""
RESOLUTION = 4
"""Decimals of a reported position [m]."""

COUNT = len(JOINTS)
FOREIGN = len(LIMBS)
"""Stands for everything except the person's own limbs."""
_LEFT_HIP, _RIGHT_HIP = INDEX["left_hip"], INDEX["right_hip"]
_LEG = ("knee", "ankle", "heel", "foot")


def _opposite(name: str) -> str:
    side, _, joint = name.rpartition("_")
    return {"left": "right_", "right": "left_", "": ""}[side] + joint


def _limbs_at(*names: str) -> frozenset[int]:
    return frozenset(n for n, limb in enumerate(LIMBS) if {limb.begin, limb.end} & set(names))


def _showing(name: str) -> frozenset[int]:
    # the pelvis lies between the thighs, hips and spine in the trunk, the ankle above the foot
    if name == "pelvis":
        return _limbs_at(name, "left_hip", "right_hip")
    if name == "spine" or name.endswith("hip"):
        return _limbs_at(name, "pelvis")
    return _limbs_at(name, name.replace("ankle", "foot"))


def scales(table: dict[str, float]) -> Floats:
    """Return a factor for each joint (20,), by its name without the side; 1 by default."""
    return np.array([table.get(name.rpartition("_")[2], 1.0) for name in JOINTS])


IS_LEG: Floats = np.array([float(name.endswith(_LEG)) for name in JOINTS])
"""1 for each joint of a leg (20,); hips are not."""
MIRRORED = [INDEX[_opposite(name)] for name in JOINTS]
"""For each joint the joint of the other side."""
LEGS_SWAPPED = [MIRRORED[n] if is_leg else n for n, is_leg in enumerate(IS_LEG.tolist())]
"""For each joint the joint that is reported instead if the legs are confused."""
SHOWING = [_showing(name) for name in JOINTS]
"""For each joint the limbs that make it visible if a ray to the joint hits them first."""
OTHER_LEG = [
    _limbs_at(f"{_opposite(name).partition('_')[0]}_knee")
    if name.endswith(("knee", "ankle"))
    else frozenset[int]()
    for name in JOINTS
]
"""For knees and ankles the other leg's thigh and shank."""
CHAINS: Floats = np.eye(COUNT)
"""Matrix (20, 20) from bones to joints: a bone ends in the joint of its number."""
_BONES: Floats = np.eye(COUNT)
for _number, _parent in enumerate(PARENTS.values()):
    if _parent is not None:
        CHAINS[_number] += CHAINS[INDEX[_parent]]
        _BONES[_number, INDEX[_parent]] = -1.0
BONES: Floats = _BONES[MIRRORED] - _BONES
"""Matrix (20, 20) from joints to the differences of the other side's bones from their own."""


class _TrackedBody:
    """The tracker's state for one person, whose errors are drawn from `random`."""

    def __init__(self, random: Generator, bias_weights: Floats) -> None:
        self.random = random
        self.bias: Floats = random.standard_normal((3 * COUNT, 5)) * bias_weights
        """The bias (60, 5) over the basis of views, in base_link."""
        self.drift: Floats = random.standard_normal((COUNT, 3))
        """The drift (20, 3), of unit variance."""
        self.relative: Floats | None = None  # (20, 3): the joints about the pelvis, with lag
        self.swapped = self.flipped = False
        self.identity = ""
        self.unseen = 0


class BodyTracker:
    """A body tracker on a robot.

    The number of random draws per frame and person does not depend on visibility. Each person has a
    separate generator, so an additional person does not change the errors of the others. Frames
    follow each other after `frame_s` [s].
    """

    def __init__(
        self, config: TrackerConfig, mount: CameraMount, seed: int, frame_s: float
    ) -> None:
        self._config, self._seed = config, seed
        self._mount, self._camera = mount, CameraView(mount, config)
        self._place = np.array(mount.position_m)
        self._keep = math.exp(-frame_s / config.drift_time_s)
        self._fresh = math.sqrt(1.0 - self._keep**2)
        self._follow = 1.0 - math.exp(-frame_s / config.hidden_lag_s)
        self._unswap = 1.0 - math.exp(-frame_s / config.swap_time_s)
        self._flip = 1.0 - math.exp(-frame_s * config.flip_rate_hz)
        self._unflip = 1.0 - math.exp(-frame_s / config.flip_time_s)
        self._memory = config.identity_memory_s / frame_s
        scale, bias = scales(NOISE_SCALE), scales(BIAS_SCALE) * config.bias_std_m
        self._drift_std, self._white_std = scale * config.drift_std_m, scale * config.white_std_m
        self._bias_variance = bias * bias
        self._pull = config.hidden_pull * IS_LEG
        self._guess_variance = (scales(GUESSED_STD_M) * self._pull) ** 2
        # over three orders of harmonics
        self._bias_weights: Floats = np.repeat(bias, 3)[:, None] / math.sqrt(3.0)
        self._bodies: dict[str, _TrackedBody] = {}
        self._names = 0

    def capture(
        self, scene: RayScene, robot: Pose2D, people: Mapping[str, Floats], time: m.Time
    ) -> m.Skeletons:
        """Return the frame from a true pose of the robot; `header.stamp` is `time`.

        Its `reason` is that of the first of the people, whom the robot follows. All of them are
        placed in the scene, with their joints (20, 3) [m], in the order of its numbers.
        """
        for name in people:
            if name not in self._bodies:
                number = len(self._bodies)
                bits = PCG64([self._seed, number] if number else self._seed)
                self._bodies[name] = _TrackedBody(Generator(bits), self._bias_weights)
        for name, body in self._bodies.items():
            if name not in people:
                body.unseen += 1
        camera = self._camera.position(robot)
        rays = np.concatenate(list(people.values())) - camera
        distances = np.sqrt(np.einsum("ij,ij->i", rays, rays))
        ranges, hits = scene.cast(camera, rays / distances[:, None], CARRIER)
        vectors = rotate(rays, -robot.yaw)
        depths, inside = self._camera.look(vectors)
        occlusions = self._config.occlusions_s
        is_blind = any(begin <= time.ns / NS_PER_S <= end for begin, end in occlusions)
        if is_blind:
            inside[:] = False
        reached, numbers, seen = (ranges >= distances).tolist(), hits.tolist(), inside.tolist()
        header = m.Header(stamp=time, frame_id="base_link")
        skeletons, reason = [], ""
        for number, name in enumerate(people):
            rows = slice(number * COUNT, (number + 1) * COUNT)
            first = scene.limbs(number).start
            limbs = [n - first if 0 <= n - first < FOREIGN else FOREIGN for n in numbers[rows]]
            view = vectors[rows], depths[rows], seen[rows], reached[rows], limbs
            skeleton = self._report(self._bodies[name], header, *view)
            if skeleton is not None:
                skeletons.append(skeleton)
            elif number == 0:
                hidden = m.Unseen.BLIND if is_blind else scene.hidden_by(numbers[0])
                reason = out_of_view(self._mount, self._config, vectors[0].tolist()) or hidden
        return m.Skeletons(header=header, skeletons=tuple(skeletons), reason=reason)

    def _report(
        self,
        body: _TrackedBody,
        header: m.Header,
        vectors: Floats,
        depths: Floats,
        inside: Sequence[bool],
        reached: Sequence[bool],
        limbs: Sequence[int],
    ) -> m.Skeleton | None:
        """Return the reported joints of a person; None if the pelvis is not seen.

        The joints are at `vectors` (20, 3) [m] from the camera, in base_link. They are `inside` the
        view, hidden or not; `reached` if nothing is in front of them. The rays to them hit `limbs`
        first: indices of `LIMBS`, or `FOREIGN`.
        """
        config = self._config
        normals: Floats = body.random.standard_normal((2, COUNT, 3))
        chances = body.random.random(2).tolist()
        body.drift = self._keep * body.drift + self._fresh * normals[0]
        if not inside[0] or (limbs[0] == FOREIGN and not reached[0]):
            body.unseen += 1
            return None
        if not body.identity or body.unseen > self._memory:
            self._names += 1
            body.identity, body.relative = str(self._names), None
            body.swapped = body.flipped = False
        body.unseen = 0
        visible = [
            i and (r or limb in showing)
            for i, r, limb, showing in zip(inside, reached, limbs, SHOWING, strict=True)
        ]
        hidden = np.array([0.0 if v else 1.0 for v in visible])
        relative = vectors - vectors[0]
        to_left = (vectors[_LEFT_HIP] - vectors[_RIGHT_HIP]).tolist()
        x, y, _ = vectors[0].tolist()
        # bearing of the camera about the person, 0 straight ahead of the person
        bearing = math.atan2(-y, -x) - math.atan2(-to_left[0], to_left[1])
        c, s = math.cos(bearing), math.sin(bearing)
        crossing = any(limb in leg for limb, leg in zip(limbs, OTHER_LEG, strict=True))
        self._confuse(body, chances, crossing, c < -math.cos(BEHIND_RAD))

        if not all(visible):
            pull = (self._pull * hidden)[:, None]
            relative += hidden[:, None] * product(CHAINS, pull * product(BONES, relative))
            if body.relative is not None:
                lag = ((1.0 - self._follow) * hidden)[:, None]
                relative += lag * (body.relative - relative)
        body.relative = relative

        factor = 1.0 + (config.hidden_factor - 1.0) * hidden
        near = depths / WHITE_RANGE_M
        white = self._white_std * (1.0 + near * near) * factor
        drift = self._drift_std * factor
        harmonics = (1.0, c, s, c * c - s * s, 2.0 * s * c)
        joints = product(body.bias, harmonics).reshape(COUNT, 3)
        joints += relative + (vectors[0] + self._place)
        joints += drift[:, None] * body.drift + white[:, None] * normals[1]
        variance = self._bias_variance + drift * drift + white * white
        std = np.sqrt(variance + self._guess_variance * hidden)
        confidence = [2 if v else int(i) for v, i in zip(visible, inside, strict=True)]
        if body.swapped or body.flipped:
            order = LEGS_SWAPPED if body.swapped else list(range(COUNT))
            order = [order[n] for n in MIRRORED] if body.flipped else order
            joints, std, confidence = joints[order], std[order], [confidence[n] for n in order]
        return m.Skeleton(
            header=header,
            id=body.identity,
            joints=tuple([m.Point(*point) for point in joints.round(RESOLUTION).tolist()]),
            std=tuple(std.round(RESOLUTION).tolist()),
            confidence=tuple(confidence),
        )

    def _confuse(
        self, body: _TrackedBody, chances: list[float], crossing: bool, behind: bool
    ) -> None:
        """Start or end a confusion of left and right: two Markov chains of two states."""
        swap, flip = chances
        if body.swapped:
            body.swapped = swap >= self._unswap
        else:
            body.swapped = crossing and swap < self._config.swap_probability
        if body.flipped:
            body.flipped = flip >= self._unflip
        else:
            body.flipped = behind and flip < self._flip
