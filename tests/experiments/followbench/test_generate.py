"""Drawn episodes of Follow-Bench, against the published ones of the sample."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mecazen.errors import ConfigError
from mecazen_experiments.followbench.episodes import SAMPLE, Density, read_folder
from mecazen_experiments.followbench.generate import (
    PEOPLE_OF_LAYOUTS,
    generate,
    scenarios,
    tracks,
)
from scipy import stats

PUBLISHED = list(read_folder(SAMPLE)[0].values())
CLASSES = ["Circular", "Crowd", "Parallel", "Perpendicular", "Corridor", "Intersection", "Doorway"]


def like(episode, seed):
    """Return a drawn episode of the cell of another."""
    return generate(episode.cls, episode.place, episode.density, seed, manners=episode.manners)


def ids(episode):
    return episode.name


@pytest.mark.parametrize("published", PUBLISHED, ids=ids)
def test_a_drawn_episode_has_the_frame_of_the_published_one(published):
    drawn = like(published, seed=7)

    for key in ("cls", "manners", "place", "density", "size", "step_s", "inflation_cells"):
        assert getattr(drawn, key) == getattr(published, key)
    for key in ("max_steps", "max_search_steps", "distance"):
        assert getattr(drawn, key) == getattr(published, key)
    assert len(drawn.humans) == len(published.humans)
    for one, other in zip(
        (drawn.target, *drawn.humans), (published.target, *published.humans), strict=True
    ):
        assert one[2:] == other[2:]  # plans, threshold and distance
    assert len(drawn.boxes) == len(published.boxes)


@pytest.mark.parametrize("published", PUBLISHED, ids=ids)
def test_the_robot_starts_at_the_published_place_beside_the_target(published):
    drawn = like(published, seed=7)

    # 1e-9 is rounding
    assert drawn.target.start.between(drawn.robot) == pytest.approx(
        published.target.start.between(published.robot), abs=1e-9
    )
    if published.cls != "Doorway":  # there the target starts anywhere along the wall
        assert drawn.target == published.target
    else:
        assert drawn.target.start.y == published.target.start.y
        assert drawn.target.goals[0][1] == published.target.goals[0][1]


@pytest.mark.parametrize("published", [one for one in PUBLISHED if one.cls != "Clutter"], ids=ids)
def test_walls_are_the_published_ones(published):
    drawn = like(published, seed=7)

    assert np.array(drawn.boxes) == pytest.approx(np.array(published.boxes), abs=1e-9)  # rounding


def coordinates(episodes):
    """Return start and goal (n, 4) of the people of episodes, relative to the width they have."""
    ways = [(*one.start[:2], *one.goals[-1]) for each in episodes for one in each.humans]
    return np.array(ways)


@pytest.mark.parametrize("cls", CLASSES)
def test_starts_and_goals_are_distributed_like_the_published_ones(cls):
    files = [one for one in PUBLISHED if one.cls == cls]
    published = coordinates(files)
    drawn = coordinates([like(one, seed) for one in files for seed in range(50)])

    for column in range(4):
        # coordinates of a few dozen people: a test at 1 % of 28 columns would fail by chance
        assert stats.ks_2samp(published[:, column], drawn[:, column]).pvalue > 0.001
    # no published value lies outside of what is drawn, by more than the steps between the values
    assert np.all(published >= drawn.min(axis=0) - 0.25)
    assert np.all(published <= drawn.max(axis=0) + 0.25)


@pytest.mark.parametrize("published", [one for one in PUBLISHED if one.humans], ids=ids)
def test_people_start_at_least_as_far_apart_as_published(published):
    def gap(episode):
        starts = [one.start[:2] for one in episode.humans]
        return min(math.dist(a, b) for i, a in enumerate(starts) for b in starts[:i])

    least = min(gap(like(published, seed)) for seed in range(20))

    assert least >= 1.2
    assert gap(published) >= 1.2


def test_people_on_a_circle_go_to_the_opposite_point():
    for one in generate("Circular", "back", Density(20), 3).humans:
        (x, y, _), ((goal_x, goal_y),) = one.start, one.goals
        assert math.dist((x, y), (15.0, 15.0)) == pytest.approx(8.0, abs=0.01)  # two decimals
        assert (x + goal_x, y + goal_y) == pytest.approx((30.0, 30.0))


def of(cls):
    """Return the published episodes of a class, and 30 drawn ones of each of their cells."""
    published = [one for one in PUBLISHED if one.cls == cls]
    return [*published, *(like(one, seed) for one in published for seed in range(30))]


@pytest.mark.parametrize(("cls", "gap"), [("Corridor", 1.4), ("Intersection", 1.2)])
def test_nobody_has_a_goal_where_one_before_starts(cls, gap):
    for episode in of(cls):
        for i, one in enumerate(episode.humans):
            for other in episode.humans[:i]:
                assert math.dist(one.goals[-1], other.start[:2]) >= gap


@pytest.mark.parametrize("cls", ["Corridor", "Doorway"])
def test_a_few_people_keep_2_m_at_the_start(cls):
    for episode in of(cls):
        if episode.density.humans <= 6:
            starts = [one.start[:2] for one in episode.humans]
            assert all(math.dist(a, b) >= 2.0 for i, a in enumerate(starts) for b in starts[:i])


def test_a_quarter_of_the_people_in_a_corridor_at_least_walk_either_way():
    for episode in of("Corridor"):
        rightwards = sum(one.goals[-1][0] > one.start.x for one in episode.humans)
        assert 0.25 <= rightwards / len(episode.humans) <= 0.75

    cell = ("Corridor", "back", Density(4, 5.6))
    drawn = [generate(*cell, seed).humans for seed in range(300)]
    numbers = [sum(one.goals[-1][0] > one.start.x for one in humans) for humans in drawn]
    # each of 1, 2 and 3 in a third of the episodes, as 6, 6 and 13 of 25 published ones: 100 of
    # 300, 8 standard deviation
    assert np.bincount(numbers).tolist()[1:] == pytest.approx([100, 100, 100], abs=33)


@pytest.mark.parametrize(("cls", "clear"), [("Doorway", 3.0), ("Intersection", 2.0)])
def test_starts_and_goals_are_clear_of_the_targets_start(cls, clear):
    for episode in of(cls):
        for one in episode.humans:
            for at in (one.start[:2], one.goals[-1]):
                assert math.dist(at, episode.target.start[:2]) >= clear


def test_starts_and_goals_at_a_door_are_clear_of_the_targets_goal():
    for episode in of("Doorway"):
        for one in episode.humans:
            for at in (one.start[:2], one.goals[-1]):
                assert math.dist(at, episode.target.goals[-1]) >= 3.0


def crossings():
    cell = ("Intersection", "back", Density(10, 4.8))
    return [generate(*cell, seed).humans for seed in range(100)]


def test_three_in_four_turn_off_at_the_crossing():
    share = np.mean([len(one.goals) == 2 for humans in crossings() for one in humans])

    # 1000 people: 1.4 % standard deviation; 124 of 166 published people turn
    assert share == pytest.approx(0.75, abs=0.05)


def test_people_at_the_crossing_share_their_routes():
    def arm(x, y):
        return (x < 17.0, x > 23.0, y < 17.0, y > 23.0)

    def routes(humans):
        return len({(arm(*one.start[:2]), arm(*one.goals[-1])) for one in humans})

    mean = np.mean([routes(humans) for humans in crossings()])

    # 0.12 is the standard deviation of this mean. Seven published files: 4.9 (standard error 0.4);
    # 12 equally likely routes of 10 people would give 7.0
    assert mean == pytest.approx(5.5, abs=0.5)


CLUTTER = next(one for one in PUBLISHED if one.cls == "Clutter")


def test_the_clutter_has_boxes_like_the_published_ones():
    drawn = [like(CLUTTER, seed) for seed in range(10)]

    for episode in [CLUTTER, *drawn]:
        boxes = np.array(episode.boxes)[4:]
        assert np.count_nonzero(boxes[:, 2] == 0.0) == 21  # of 30: the others are turned
        assert np.all((boxes[:, 3:] >= 0.6) & (boxes[:, 3:] <= 2.0))
        assert np.all((boxes[:, :2] >= 0.8) & (boxes[:, :2] <= 29.2))
        apart = [math.dist(a[:2], b[:2]) for i, a in enumerate(boxes) for b in boxes[:i]]
        assert min(apart) >= 2.0
    assert np.array(CLUTTER.boxes)[:4] == pytest.approx(np.array(drawn[0].boxes)[:4])


def test_people_in_the_clutter_stroll_like_the_published_ones():
    def steps(episode):
        return [
            math.dist(a, b)
            for one in episode.humans
            for a, b in pairwise((one.start[:2], *one.goals))
        ]

    published, drawn = steps(CLUTTER), steps(like(CLUTTER, 5))

    assert len(published) == len(drawn) == 10 * 19
    for each in (published, drawn):
        assert min(each) >= 2.0
        assert max(each) <= 4.0
    assert stats.ks_2samp(published, drawn).pvalue > 0.01


def test_there_are_52_cells_and_24_with_social_forces_and_8_tracks():
    assert (len(scenarios()), len(scenarios("sfm")), len(tracks())) == (52, 24, 8)


@pytest.mark.parametrize("place", ["back", "left_side"])
def test_every_scenario_can_be_drawn_in_both_places(place):
    for one in [*scenarios(), *tracks()]:
        episode = generate(one.cls, place, one.density, 11)

        assert episode.name == f"{one.name}_{place}_11"
        assert episode.density == one.density
        assert len(episode.humans) == one.density.humans
        width, height = episode.size
        for walk in (episode.target, *episode.humans):
            for x, y in (walk.start[:2], *walk.goals):
                assert 0.0 < x < width
                assert 0.0 < y < height


def test_a_seed_gives_the_same_episode_and_another_seed_another():
    cell = ("Crowd", "back", Density(5))

    assert generate(*cell, 1) == generate(*cell, 1)
    assert generate(*cell, 1) != generate(*cell, 2)


def test_the_distance_moves_nothing():
    near = generate("Corridor", "back", Density(4, 5.6), 1, distance=1.0)
    far = generate("Corridor", "back", Density(4, 5.6), 1, distance=2.5)

    assert (near.distance, far.distance) == (1.0, 2.5)
    assert near.humans == far.humans
    assert near.robot == far.robot


def test_a_cell_that_the_benchmark_has_not_is_refused():
    with pytest.raises(ConfigError, match="no scenario 'Crowd'"):
        generate("Crowd", "back", Density(7), 1)
    with pytest.raises(ConfigError, match="with sfm"):
        generate("Corridor", "back", Density(4, 5.6), 1, manners="sfm")


def test_the_published_levels_of_people_are_scenarios_of_the_benchmark():
    known = {(one.cls, one.density) for one in scenarios()}
    levels = {
        (cls, Density(humans, *size))
        for cls, (size, numbers) in PEOPLE_OF_LAYOUTS.items()
        for humans in numbers
    }
    assert len(levels) == 16
    assert levels <= known
