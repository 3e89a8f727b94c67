from __future__ import annotations

from collections import Counter

import msgspec
import numpy as np
import numpy.typing as npt
import pytest
from mecazen.robot import Robot
from mecazen.rollers import Roller
from mecazen_bench.engine import lateral_gain, yaw_gain

Array = npt.NDArray[np.float64]


@pytest.fixture
def roller(robot: Robot) -> Roller:
    return Roller.from_robot(robot)


def axis(roller: Roller) -> Array:
    return np.array([np.sin(roller.angle), np.cos(roller.angle), 0.0])


def surface(roller: Roller) -> Array:
    """Points (rings, turns, 3) of the roller at the bottom, in the wheel frame (y: the axle)."""
    s, r = roller.profile(np.linspace(-roller.half_arc, roller.half_arc, 801))
    turn = np.linspace(0.0, 2.0 * np.pi, 2881)
    z = axis(roller)
    x = np.array([0.0, 0.0, -1.0])
    y = np.cross(z, x)
    around = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    along = np.array([0.0, 0.0, -roller.axis_distance]) + s[:, None] * z
    return along[:, None, :] + r[:, None, None] * around


def test_each_circle_of_the_barrel_reaches_the_wheels_radius_and_no_farther(roller):
    points = surface(roller)
    reach = np.hypot(points[..., 0], points[..., 2]).max(axis=1)
    assert reach.max() <= roller.wheel_radius + 1e-12  # rounding
    # A circle is sampled every 0.125°, which misses its farthest point by less than 1e-8 m.
    np.testing.assert_allclose(reach, roller.wheel_radius, atol=1e-8)


def test_the_arcs_of_all_rollers_cover_the_circle_without_gap(roller):
    points = surface(roller)
    farthest = np.hypot(points[..., 0], points[..., 2]).argmax(axis=1)
    touching = points[np.arange(len(points)), farthest]
    angles = np.arctan2(touching[:, 0], -touching[:, 2])
    # Rings are 1/800 of the arc apart, and circles are sampled every 0.125°.
    step = 2.0 * roller.half_arc / 800 + np.radians(0.125)
    assert np.abs(np.diff(np.sort(angles))).max() < 2.0 * step
    assert np.ptp(angles) == pytest.approx(2.0 * np.pi / roller.count, abs=step)


def test_neighbouring_rollers_do_not_touch(roller):
    heights, radii = roller.spheres(301)
    here = np.array([0.0, 0.0, -roller.axis_distance]) + heights[:, None] * axis(roller)
    c, s = np.cos(2.0 * np.pi / roller.count), np.sin(2.0 * np.pi / roller.count)
    there = here @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T
    distance = np.linalg.norm(here[:, None] - there[None], axis=2)
    assert (distance - radii[:, None] - radii[None]).min() > 0.0


@pytest.mark.parametrize(("number", "sag"), [(9, 5e-5), (41, 2e-6)])
def test_the_hull_of_the_spheres_is_round_to_its_chords_sag(roller, number, sag):
    heights, radii = roller.spheres(number)
    centres = np.array([0.0, 0.0, -roller.axis_distance]) + heights[:, None] * axis(roller)
    turn = np.linspace(-roller.half_arc, roller.half_arc, 4001)
    down = np.stack([np.sin(turn), np.zeros_like(turn), -np.cos(turn)])
    reach = (centres @ down + radii[:, None]).max(axis=0)
    assert reach.max() <= roller.wheel_radius + 1e-12
    # Between two contacts δ apart the reach sags by (R - r)·(1 - cos(δ/2)).
    assert reach.min() > roller.wheel_radius - sag


def test_the_middle_and_the_ends_have_the_radii_of_the_formula_by_hand():
    roller = Roller(wheel_radius=0.05, max_radius=0.0095, angle=np.pi / 4, count=9, mass=0.02)
    s, r = roller.profile([0.0, np.pi / 9])
    # φ = 20°: s = (0.05·sin φ + 0.0405·tan φ)/√2, r = (0.05·cos φ - 0.0405)·√(1 + tan²φ/2)
    np.testing.assert_allclose(s, [0.0, 0.02251555], atol=5e-9)
    np.testing.assert_allclose(r, [0.0095, 0.00669595], atol=5e-9)


def test_a_mesh_is_closed_fine_and_points_outward(roller):
    vertices, triangles = roller.mesh()
    assert len(triangles) > 5000
    edges = Counter((int(row[i]), int(row[(i + 1) % 3])) for row in triangles for i in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    s, r = roller.profile(np.linspace(-roller.half_arc, roller.half_arc, 2001))
    # 64 sides of a circle leave out 0.16 % of its area.
    assert volume == pytest.approx(np.trapezoid(np.pi * r**2, s), rel=2e-3)


def test_inertia_is_that_of_the_mesh(roller):
    vertices, triangles = roller.mesh(rings=201, segments=256)
    corners = vertices[triangles]
    volumes = np.linalg.det(corners) / 6.0
    # ∫xxᵀ over a tetrahedron (0, a, b, c) is V/20·(Σ over corners xxᵀ + (Σx)(Σx)ᵀ).
    total = corners.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", volumes, corners, corners)
    second += np.einsum("t,ti,tj->ij", volumes, total, total)
    second *= roller.mass / volumes.sum() / 20.0
    moments = np.diag(np.trace(second) * np.eye(3) - second)
    across, along = roller.inertia
    # 256 sides: relative errors of 1e-4.
    np.testing.assert_allclose(moments, [across, across, along], rtol=3e-4)


@pytest.mark.parametrize(("count", "expected"), [(9, 0.978), (12, 0.988)])
def test_lateral_gain_is_the_mean_over_the_rollers_arc(nexus, count, expected):
    rollers = msgspec.structs.replace(nexus.rollers, count=count)
    robot = msgspec.structs.replace(nexus, rollers=rollers)
    # The expected figures average over rollers whose arcs overlap by 4 %; ours just meet.
    assert lateral_gain(robot) == pytest.approx(expected, abs=0.002)


def test_gains_follow_from_no_slip_at_sampled_wheel_angles(robot):
    roller = Roller.from_robot(robot)
    theta = (np.arange(2000) + 0.5) / 1000 * roller.half_arc - roller.half_arc
    axes = np.stack([np.sin(roller.angle) * np.cos(theta), np.full(2000, np.cos(roller.angle))])
    # With ω·R = 1 the contact's velocity (v_x - 1, v_y) is across the axis; v_x = 0.
    lateral = axes[0] / axes[1] / np.tan(roller.angle)
    assert lateral_gain(robot) == pytest.approx(lateral.mean(), abs=1e-6)
    arm = robot.half_track + robot.half_wheelbase / np.tan(roller.angle)
    # Yaw rate w: (1 - (l_y ± e)·w, l_x·w) is across the mirrored axis; of both pairs the one of
    # the nearer contacts counts, which asks for more.
    offset = roller.axis_distance * np.tan(theta) / np.tan(roller.angle)
    across = robot.half_track + robot.half_wheelbase * axes[1] / axes[0]
    yaw = np.maximum(arm / (across + offset), arm / (across - offset))
    # 1e-5: the kink between the pairs lies between two samples
    assert yaw_gain(robot) == pytest.approx(yaw.mean(), abs=1e-5)
