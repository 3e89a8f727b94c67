"""Geometry of a mecanum roller: the barrel that makes the wheel round.

Frames. The *roller frame* has its origin at the roller's middle and z along the roller's
axis. In the *wheel frame* (origin at the wheel's centre, y along the axle, turning with the
wheel) the axis of the roller at the bottom passes (0, 0, -d), d = R - r_max, with R the
wheel's radius and r_max the roller's largest; it is horizontal, at angle γ to the axle.

The envelope (A. Gfrerer, "Geometry and kinematics of the Mecanum wheel", 2008, derived
again here). The roller is the surface of revolution about its axis that touches the wheel's
cylinder of radius R along a curve. The normal of a surface of revolution meets its axis, and
the normal of the cylinder meets the axle at a right angle. So the common normal in the point
of the contact curve at wheel angle φ is the line that starts from the axle at angle φ from
the downward direction and meets the roller's axis. With u the coordinate along the roller's
axis, the points of that axis lie u·sin γ ahead of and d below the axle, hence

    tan φ = u·sin γ / d,           the normal meets the axis at u = d·tan φ / sin γ,
    ρ = d / cos φ,                 which is that far from the axle,
    h = R - ρ,                     and as far from the contact point.

A sphere of radius h round that point of the axis touches the cylinder from inside: the
roller is the envelope of these spheres. The contact point itself, R from the axle and
y = u·cos γ along it, lies in the roller frame at

    s = sin γ·(R·sin φ) + cos γ·(u·cos γ)
    r = (R·cos φ - d)·sqrt(1 + cos²γ·tan²φ)

which is the profile, with φ as parameter. (Taking h as the radius at s = u is up to 0.2 mm
off at the ends: h is measured along the normal, which leans against the roller's axis.)
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mecazen.portable import Floats, legendre, tan
from mecazen.robot import Robot


@dataclass(frozen=True)
class Roller:
    """One roller of a wheel of `count`; lengths [m], `angle` = γ [rad], `mass` [kg]."""

    wheel_radius: float
    max_radius: float
    angle: float
    count: int
    mass: float

    @classmethod
    def from_robot(cls, robot: Robot) -> Roller:
        """Return the roller of `robot`."""
        rollers = robot.rollers
        return cls(
            wheel_radius=robot.wheels.radius_m,
            max_radius=rollers.max_radius_m,
            angle=robot.roller_angle,
            count=rollers.count,
            mass=rollers.mass_kg,
        )

    @property
    def axis_distance(self) -> float:
        """Distance d of the roller's axis from the wheel's axle [m]."""
        return self.wheel_radius - self.max_radius

    @property
    def half_arc(self) -> float:
        """Wheel angle from the roller's middle to its end [rad].

        The arcs of all rollers just cover the circle, so the wheel is round without a gap, and
        contact passes from one roller to the next in a single position.
        """
        return np.pi / self.count

    def profile(self, phi: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Return axial position s and radius r [m] of the contact point at wheel angle `phi`."""
        phi = np.asarray(phi, dtype=float)
        slope, cos_angle = tan(phi), np.cos(self.angle)
        along_axle = self.axis_distance * slope / math.tan(self.angle)
        s = np.sin(self.angle) * self.wheel_radius * np.sin(phi) + cos_angle * along_axle
        r = (self.wheel_radius * np.cos(phi) - self.axis_distance) * np.sqrt(
            1.0 + (cos_angle * slope) ** 2
        )
        return s, r

    @property
    def length(self) -> float:
        """Distance between the roller's two flat ends [m]."""
        s, _ = self.profile(self.half_arc)
        return 2.0 * float(s)

    @cached_property
    def inertia(self) -> tuple[float, float]:
        """Moments of inertia across and along the roller's axis, about its middle [kg·m²].

        For a homogeneous solid of revolution: ∫(r⁴/4 + r²s²)ds and ∫r⁴/2 ds over ∫r²ds, by
        Gauss' rule in φ (the profile is analytic: 32 points leave rounding errors only).
        """
        nodes, weights = legendre(32)
        phi = self.half_arc * nodes
        s, r = self.profile(phi)
        slope = np.sin(self.angle) * self.wheel_radius * np.cos(phi) + (
            np.cos(self.angle) * self.axis_distance / math.tan(self.angle) / np.cos(phi) ** 2
        )
        ds = weights * slope
        square = r * r
        density = self.mass / math.fsum(ds * square)
        across = density * math.fsum(ds * square * (square / 4.0 + s * s))
        along = density * math.fsum(ds * square * square / 2.0)
        return across, along

    def spheres(self, number: int) -> tuple[Floats, Floats]:
        """Return centres on the axis and radii [m] of `number` spheres inside the envelope.

        Each sphere touches the profile; the angles of the contacts are equally spaced over the
        roller's arc. The convex hull of all spheres lies inside the roller.
        """
        phi = np.linspace(-self.half_arc, self.half_arc, number)
        distance = self.axis_distance
        return (
            distance * tan(phi) / np.sin(self.angle),
            self.wheel_radius - distance / np.cos(phi),
        )

    def mesh(self, rings: int = 65, segments: int = 64) -> tuple[Floats, npt.NDArray[np.int64]]:
        """Return vertices (V, 3) [m] in the roller frame and triangles (T, 3), outward.

        The mesh has `rings` circles of `segments` points; triangle fans close the two ends.
        """
        s, r = self.profile(np.linspace(-self.half_arc, self.half_arc, rings))
        turn = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
        circles = np.stack(
            [
                np.outer(r, np.cos(turn)),
                np.outer(r, np.sin(turn)),
                np.broadcast_to(s[:, None], (rings, segments)),
            ],
            axis=-1,
        ).reshape(-1, 3)
        vertices = np.vstack([circles, [0.0, 0.0, s[0]], [0.0, 0.0, s[-1]]])
        points = np.arange(rings * segments).reshape(rings, segments)
        following = np.roll(points, -1, axis=1)
        first_centre, last_centre = len(vertices) - 2, len(vertices) - 1
        triangles = np.vstack(
            [
                _triangles(points[:-1], following[:-1], following[1:]),
                _triangles(points[:-1], following[1:], points[1:]),
                _triangles(following[0], points[0], np.full(segments, first_centre)),
                _triangles(points[-1], following[-1], np.full(segments, last_centre)),
            ]
        )
        return vertices, triangles


def lateral_gain(count: int) -> float:
    """Return the mean of v_y over its ideal value on wheels of `count` rollers that do not slip.

    A roller resists only along its axis, so the wheel's contact point has no velocity along the
    horizontal part of that axis. When the wheel has turned its roller by θ from the bottom, the
    axis (±sin γ, cos γ, 0) has become (±sin γ·cos θ, cos γ, ∓sin γ·sin θ), so its effective angle
    has tan γ' = tan γ·cos θ and

        (v_x - ω·R)·tan γ·cos θ ± v_y = 0.

    The ideal equations have θ = 0. With v_x = 0 the gain is cos θ: it is 1 in a roller's
    middle, and its mean over the arc |θ| ≤ α = π/N is sin(α)/α.
    """
    arc = math.pi / count
    return math.sin(arc) / arc


def yaw_gain(robot: Robot) -> float:
    """Return the mean of the yaw rate over its ideal value for turning on the spot.

    The derivation is that of `lateral_gain`, with the velocity of a wheel's centre (∓l_y, ±l_x)·ω_z
    and the contact's offset along the axle, e = d·tan θ/tan γ. The gain for which a wheel would not
    slip is

        (l_y + l_x·cot γ)/(l_y + e + l_x·cot γ/cos θ).

    Two diagonal wheels have their contacts farther out by e, the two others farther in by e, so
    their gains differ and one pair slips. On an axle that swings about its middle, wheel loads are
    inversely proportional to the distances of the contacts from the middle, 1/(l_y ± e). The pair
    whose grip has the larger moment, load times lever, prevails; in the arrangement X that is the
    inner pair. This gain holds for wheels whose rollers are in the same phase, as at the start; in
    other phases it is up to 3 % less.
    """
    roller = Roller.from_robot(robot)
    # the gain has a kink at θ = 0, and is symmetric: integrate one half
    nodes, weights = legendre(16)
    theta = roller.half_arc * (nodes + 1.0) / 2.0
    offset = roller.axis_distance * tan(theta) / math.tan(roller.angle)
    distances = robot.half_track + np.stack([offset, -offset])
    levers = distances + robot.half_wheelbase * robot.cross_gain / np.cos(theta)
    prevails = np.argmax(np.abs(levers) / distances, axis=0)
    gain = robot.lever / np.take_along_axis(levers, prevails[None], axis=0)[0]
    return math.fsum(weights * gain) / 2.0


def _triangles(*corners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return corner indices, given as three arrays of one shape, as rows of three."""
    return np.stack([corner.ravel() for corner in corners], axis=1)


def binary_stl(vertices: Floats, triangles: npt.NDArray[np.int64]) -> bytes:
    """Return a binary STL file of `vertices` (V, 3) and `triangles` (T, 3)."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facets = np.zeros(len(triangles), dtype=[("vectors", "<f4", (4, 3)), ("attribute", "<u2")])
    facets["vectors"][:, 0] = normals
    facets["vectors"][:, 1:] = corners
    return bytes(80) + struct.pack("<I", len(triangles)) + facets.tobytes()
