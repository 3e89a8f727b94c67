"""Ways over the grid: through doors, round boxes, and straight where there is no way."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mecazen.config.world import Box, Cylinder
from mecazen_experiments.followbench.pedestrians.grid import CELL_M, Grid

WALL = [
    Box(size_m=(4.0, 0.4, 1.0), position_m=(2.0, 5.0)),
    Box(size_m=(4.0, 0.4, 1.0), position_m=(8.0, 5.0)),
]
"""A wall along y = 5 with a door from x = 4 to 6."""


def grid(obstacles, inflation=3):
    return Grid(obstacles, (0.0, 0.0), (10.0, 10.0), inflation)


def test_a_way_leads_through_the_door_and_touches_no_wall():
    points = [(1.0, 1.0), *grid(WALL).way([(1.0, 1.0), (1.0, 9.0)])]
    crossing = [
        a[0] + (5.0 - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        for a, b in pairwise(points)
        if a[1] < 5.0 <= b[1]
    ]
    assert len(crossing) == 1
    assert 4.2 < crossing[0] < 5.8  # a cell within the door


def test_a_way_is_as_long_as_eight_directions_allow():
    points = grid([]).way([(0.1, 0.1), (6.1, 4.1)])
    length = sum(math.dist(a, b) for a, b in pairwise(points))
    # 20 cells of the diagonal and 10 straight ones, cut short by the skipped cells
    assert 0.99 * math.hypot(6.0, 4.0) < length <= CELL_M * (20 * math.sqrt(2.0) + 10) + 1e-9


def test_without_a_way_a_leg_is_a_straight_line():
    closed = [Box(size_m=(10.0, 0.4, 1.0), position_m=(5.0, 5.0))]
    assert grid(closed).way([(1.0, 1.0), (1.0, 9.0)]) == [(1.0, 9.0)]


def test_a_way_passes_all_places_in_their_order():
    points = grid([]).way([(1.0, 1.0), (8.0, 1.0), (8.0, 8.0)])
    assert min(math.dist(point, (8.0, 1.0)) for point in points) < CELL_M


@pytest.mark.parametrize(
    ("inflation", "blocked"),
    [(0, 1), (1, 1), (2, 4), (3, 9), (10, 100), (120, 2500)],  # the grid has 50 x 50 cells
)
def test_a_blocked_cell_becomes_a_square(inflation, blocked):
    pole = [Cylinder(size_m=(0.05, 1.0), position_m=(5.1, 5.1))]
    assert grid(pole, inflation).blocked.sum() == blocked


def test_a_box_blocks_all_cells_from_that_of_one_corner_to_that_of_the_other():
    box = Box(size_m=(2.0, 0.5, 1.0), position_m=(3.15, 5.1))
    rows, columns = np.nonzero(grid([box], 0).blocked)
    # y from 4.85 to 5.35 m and x from 2.15 to 4.15 m
    assert (set(rows), set(columns)) == (set(range(24, 27)), set(range(10, 21)))


def test_a_turned_box_blocks_the_polygon_between_the_cells_of_its_corners():
    box = Box(size_m=(1.0, 1.0, 1.0), position_m=(5.1, 5.1), yaw_deg=45.0)
    blocked = grid([box], 0).blocked
    # the corners, 0.71 m from the middle, are four cells from the middle's
    assert [int(row.sum()) for row in blocked[20:31]] == [0, 1, 3, 5, 7, 9, 7, 5, 3, 1, 0]


def test_walkers_heed_the_cells_that_are_left_to_be_heeded():
    made = grid(WALL)
    made.heeded[:] = False
    assert made.near(2.0, 4.5) == []
    assert made.blocked.any()


def test_the_nearest_blocked_cells_come_first_and_are_at_most_ten():
    near = grid(WALL).near(2.0, 4.5)
    distances = [math.dist(cell, (2.0, 4.5)) for cell in near]
    assert len(near) == 10
    assert distances == sorted(distances)
    assert grid(WALL).near(2.0, 1.0) == []
