from collections import Counter

import numpy as np
import pytest
from mecazen.robot import Robot
from mecazen.rollers import Roller


@pytest.fixture
def roller(robot: Robot) -> Roller:
    return Roller.from_robot(robot)


def axis(roller: Roller) -> np.ndarray:
    return np.array([np.sin(roller.angle), np.cos(roller.angle), 0.0])


def surface(roller: Roller) -> np.ndarray:
    """Points (rings, turns, 3) of the roller at the bottom, in the wheel frame (y: the axle)."""
    s, r = roller.profile(np.linspace(-roller.half_arc, roller.half_arc, 801))
    turn = np.linspace(0.0, 2.0 * np.pi, 2881)
    z = axis(roller)
    x = np.array([0.0, 0.0, -1.0])
    y = np.cross(z, x)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    along = np.array([0.0, 0.0, -roller.axis_distance]) + s[:, None] * z
    return along[:, None, :] + r[:, None, None] * around


def test_roller_circles_reach_exactly_the_wheels_radius(roller):
    points = surface(roller)
    reach = np.hypot(points[..., 0], points[..., 2]).max(axis=1)
    assert reach.max() <= roller.wheel_radius + 1e-12  # rounding
    # A circle is sampled every 0.125°, which misses its farthest point by less than 1e-8 m.
    np.testing.assert_allclose(reach, roller.wheel_radius, atol=1e-8)


def test_arcs_of_rollers_cover_the_circle(roller):
    points = surface(roller)
    farthest = np.hypot(points[..., 0], points[..., 2]).argmax(axis=1)
    touching = points[np.arange(len(points)), farthest]
    angles = np.arctan2(touching[:, 0], -touching[:, 2])
    # Rings are 1/800 of the arc apart, and circles are sampled every 0.125°.
    step = 2.0 * roller.half_arc / 800 + np.radians(0.125)
    assert np.abs(np.diff(np.sort(angles))).max() < 2.0 * step
    assert np.ptp(angles) == pytest.approx(2.0 * np.pi / roller.count, abs=step)


def test_hull_of_spheres_is_round_within_its_sag(roller):
    heights, radii = roller.spheres(41)
    centres = np.array([0.0, 0.0, -roller.axis_distance]) + heights[:, None] * axis(roller)
    turn = np.linspace(-roller.half_arc, roller.half_arc, 4001)
    down = np.stack([np.sin(turn), np.zeros_like(turn), -np.cos(turn)])
    reach = (centres @ down + radii[:, None]).max(axis=0)
    assert reach.max() <= roller.wheel_radius + 1e-12
    # Between two contacts δ apart the reach sags by (R - r)·(1 - cos(δ/2)).
    assert reach.min() > roller.wheel_radius - 2e-6


def test_a_mesh_is_closed_and_fine(roller):
    _, triangles = roller.mesh()
    assert len(triangles) > 5000
    edges = Counter((int(row[i]), int(row[(i + 1) % 3])) for row in triangles for i in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_inertia_is_that_of_the_mesh(roller):
    vertices, triangles = roller.mesh(rings=201, segments=256)
    corners = vertices[triangles]
    volumes = np.linalg.det(corners) / 6.0
    assert volumes.sum() > 0.0  # triangles point outward
    # ∫xxᵀ over a tetrahedron (0, a, b, c) is V/20·(Σ over corners xxᵀ + (Σx)(Σx)ᵀ).
    total = corners.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", volumes, corners, corners)
    second += np.einsum("t,ti,tj->ij", volumes, total, total)
    second *= roller.mass / volumes.sum() / 20.0
    moments = np.diag(np.trace(second) * np.eye(3) - second)
    across, along = roller.inertia
    # 256 sides: relative errors of 1e-4.
    np.testing.assert_allclose(moments, [across, across, along], rtol=3e-4)
