"""The world for ray casts: uses only MuJoCo's shapes and ray tests.

Ground, obstacles, robots and people are MuJoCo geoms. MuJoCo simulates nothing: poses are written
directly into `geom_xpos` and `geom_xmat`, the outputs of its kinematics, and lengths into
`geom_size`. An exact ray test reads only these arrays.

`mj_multiRay` first excludes bodies and geoms by the bounds `geom_aabb` and `bvh_aabb`, which the
compiler has computed from each geom's size. A limb that became longer would exceed its bounds and
miss rays. So moving bodies have no bounds (`body_bvhadr` = -1): their geoms are tested exactly.
Static bodies keep their bounds, which makes a scan a third cheaper.

`cutoff` also excludes by bounds, so some hits are beyond it. Such hits were the only differences of
a scan of 12 m from a closed form, one in some hundred; here they are discarded. The remaining
difference is a ray that grazes a silhouette within the rounding error.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt
from mecazen.arrays import rotate
from mecazen.config import WorldConfig
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.messages import Unseen
from mecazen.portable import Floats, product
from mecazen.robot import WHEELS, Robot
from mecazen.skeleton import INDEX, JOINTS, LIMBS

Ints = npt.NDArray[np.int32]

NOWHERE_M = -1e6
"""Height of absent bodies: below the ground, beyond every range [m]."""
CARRIER = 0
"""The number of the robot that carries the sensor."""
SHOWN = np.ones(mujoco.mjNGROUP, np.uint8)
"""All groups of geoms."""

_EYE = np.eye(len(JOINTS))
_BEGINS: Floats = _EYE[[INDEX[limb.begin] for limb in LIMBS]]
_ENDS: Floats = _EYE[[INDEX[limb.end] for limb in LIMBS]]
_ALONG, _MIDDLES = _ENDS - _BEGINS, (_BEGINS + _ENDS) / 2
"""Matrices from joints (20, 3) to limbs (12, 3)."""
_RADII = np.array([limb.radius for limb in LIMBS])


class RayScene:
    """Ground, obstacles, robots and a number of people, who are absent until they are placed."""

    def __init__(self, world: WorldConfig, robots: Sequence[Robot] = (), people: int = 1) -> None:
        self.people = people
        shapes = [_geom("plane", (0.0, 0.0, 1.0)), *map(_solid, world.solids)]
        self._obstacles, self._solids = len(world.obstacles), len(world.solids)
        self._walls = sum(1 for wall in world.walls for _ in wall.boxes())
        person = "".join(_geom("capsule", (0.1, 0.1)) for _ in LIMBS)
        bodies = [*map(_robot, robots), *[person] * people]
        moving = "".join(f'<body mocap="true">{body}</body>' for body in bodies)
        self._model = mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody>{''.join(shapes)}{moving}</worldbody></mujoco>"
        )
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        first, number = self._model.body_geomadr[1:].tolist(), self._model.body_geomnum[1:].tolist()
        geoms = [slice(at, at + n) for at, n in zip(first, number, strict=True)]
        self._robots, self._people = geoms[: len(robots)], geoms[len(robots) :]
        self._model.body_bvhadr[1:] = -1
        self._positions: Floats = self._data.geom_xpos
        self._rotations: Floats = self._data.geom_xmat.reshape(-1, 3, 3)
        self._sizes: Floats = self._model.geom_size
        self._robot_poses = [
            (self._positions[robot].copy(), self._rotations[robot].transpose(0, 2, 1).copy())
            for robot in self._robots
        ]
        self._positions[len(shapes) :, 2] = NOWHERE_M

    def limbs(self, person: int) -> slice:
        """Return the numbers of a person's geoms, in the order of `mecazen.skeleton.LIMBS`."""
        return self._people[person]

    def hidden_by(self, geom: int) -> Unseen:
        """Return the word for a person behind a geom."""
        if geom > self._solids:
            return Unseen.ROBOT if geom < self._people[0].start else Unseen.PERSON
        return Unseen.WALL if 0 < geom - self._obstacles <= self._walls else Unseen.OBSTACLE

    def place_robot(self, robot: int, pose: Pose2D) -> None:
        """Put a robot at a pose in the world, on the ground."""
        geoms, (positions, axes) = self._robots[robot], self._robot_poses[robot]
        self._positions[geoms] = rotate(positions, pose.yaw) + np.array((pose.x, pose.y, 0.0))
        self._rotations[geoms] = rotate(axes, pose.yaw).transpose(0, 2, 1)

    def place_person(self, person: int, joints: Floats, height: float) -> None:
        """Place the body of the person of a number.

        Joints are in the world, in the order of `mecazen.skeleton.JOINTS` (20, 3) [m]; the limbs'
        radii are shares of the height [m].
        """
        geoms = self._people[person]
        along = product(_ALONG, joints)
        along[:, 2] += 1e-12  # a sphere has no direction: use upwards
        lengths = np.sqrt(np.einsum("ij,ij->i", along, along))
        axes = along / lengths[:, None]
        self._positions[geoms] = product(_MIDDLES, joints)
        _set_frames(self._rotations[geoms], axes)
        self._sizes[geoms, 0], self._sizes[geoms, 1] = _RADII * height, lengths / 2

    def remove_person(self, person: int) -> None:
        """Make a person absent until they are placed again."""
        self._positions[self._people[person], 2] = NOWHERE_M

    def cast(
        self,
        origin: Floats,
        directions: Floats,
        robot: int | None = None,
        max_range: float = 1e9,
    ) -> tuple[Floats, Ints]:
        """Return the distance to the first geom that each ray hits, and the geom's number.

        Rays begin at `origin` (3,) [m] in the world, along unit vectors (n, 3). They pass through
        the robot that carries the sensor. If nothing is hit within `max_range` [m], the distance
        (n,) [m] is inf and the number (n,) -1.
        """
        distances, hits = np.empty(len(directions)), np.empty(len(directions), np.int32)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            origin,
            directions.ravel(),
            SHOWN,
            1,
            -1 if robot is None else robot + 1,  # body 0 is the world
            hits,
            distances,
            None,
            len(directions),
            max_range,
        )
        hits[distances > max_range] = -1
        distances[hits < 0] = np.inf
        return distances, hits


def _set_frames(frames: Floats, axes: Floats) -> None:
    """Set `frames` (n, 3, 3) to rotations whose z axes are the unit vectors `axes` (n, 3).

    Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017.
    """
    x, y, z = axes.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    ax, ay = a * x, a * y
    b, flipped = x * ay, sign * x
    frames[:, 0, 0], frames[:, 1, 0], frames[:, 2, 0] = 1.0 + flipped * ax, sign * b, -flipped
    frames[:, 0, 1], frames[:, 1, 1], frames[:, 2, 1] = b, sign + y * ay, -y
    frames[:, :, 2] = axes


def _geom(
    kind: str,
    size: tuple[float, ...],
    position: tuple[float, ...] = (0.0, 0.0, 0.0),
    yaw_deg: float = 0.0,
    roll_deg: float = 0.0,
) -> str:
    sizes, place = (" ".join(map(repr, numbers)) for numbers in (size, position))
    return f'<geom type="{kind}" size="{sizes}" pos="{place}" euler="{roll_deg} 0 {yaw_deg}"/>'


def _solid(solid: Box | Cylinder) -> str:
    (x, y), height = solid.position_m, solid.size_m[-1]
    if isinstance(solid, Box):
        return _geom("box", _half(solid.size_m), (x, y, solid.bottom_m + height / 2), solid.yaw_deg)
    return _geom("cylinder", (solid.size_m[0], height / 2), (x, y, height / 2))


def _robot(robot: Robot) -> str:
    """Return the shapes of a robot in base_link: base, camera, lidar, wheels and payload."""
    base, camera, lidar, load = robot.base, robot.camera, robot.lidar, robot.payload
    size = _half((base.length_m, base.width_m, base.height_m))
    hub = robot.wheels.radius_m, robot.wheels.hub_width_m / 2
    shapes = [_geom("box", size, (*robot.wheels.centre_m, base.clearance_m + size[2]))]
    if camera:
        shapes.append(_geom("box", _half(camera.size_m), camera.position_m))
    if lidar:
        size = lidar.size_m[0], lidar.size_m[1] / 2
        shapes.append(_geom("cylinder", size, lidar.position_m))
    shapes += [_geom("cylinder", hub, robot.wheel_position(w), roll_deg=90.0) for w in WHEELS]
    if load:
        shapes.append(_geom("box", _half(load.size_m), load.position_m))
    return "".join(shapes)


def _half(size: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(length / 2 for length in size)
