"""Follow-Bench by its rules, with the reference and entrants; and our robot in its episodes."""

import math
import re
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mecazen.errors import MecazenError
from mecazen.geometry import Pose2D
from mecazen_experiments.expansion import expand
from mecazen_experiments.followbench.entrants import entrant
from mecazen_experiments.followbench.episodes import SAMPLE, Box, Walk, read
from mecazen_experiments.followbench.metrics import metrics
from mecazen_experiments.followbench.people import Grid, People, orca
from mecazen_experiments.followbench.play import Record, Seen, View, play
from mecazen_experiments.followbench.program import followbench, followbench_rules, scenario_of
from mecazen_experiments.followbench.robot import (
    ANGLES,
    BEAMS,
    KnownArea,
    Unicycle,
    gaps,
    scan,
    touches,
)
from mecazen_experiments.followbench.social import (
    Social,
    place,
)
from mecazen_experiments.study import load_study

OPEN = read(SAMPLE / "dynamic" / "NormalParallelOrcaH5W0_back_2.yaml")
CORRIDOR = read(SAMPLE / "layout" / "CorridorOrcaH4W5.6_back_1.yaml")
DOOR = read(SAMPLE / "layout" / "DoorwayOrcaH2W2.8_left_side_1.yaml")
ALONE = msgspec.structs.replace(OPEN, humans=())
NOBODY, NO_BOX = np.empty((0, 2)), np.empty((0, 5))
SIZE = (30.0, 30.0)
WALL = np.array([[3.0, 0.0, 0.0, 0.2, 4.0]])
"""A wall across, 2.9 m ahead; beams pass by its ends."""
WALKER = Seen(10.0, 5.0, 1.0, 0.0)
PARALLEL = {
    "tvr": 100.0,
    "tin_tperson": 5.555555555555555,
    "pl_m": 20.348897658342956,
    "avg_acc_m_s2": 1.6181307879487608,
    "jerk_m_s3": 12.25907386749723,
}
DOORWAY = {
    "tvr": 35.49618320610687,
    "tin_tperson": 23.282442748091604,
    "pl_m": 13.916036063775111,
    "avg_acc_m_s2": 1.5505187425679237,
    "jerk_m_s3": 10.305920495707124,
}


@pytest.mark.parametrize(
    ("speed", "command", "allowed"),
    [
        (0.0, 2.0, 2.0),  # from rest, any speed
        (0.0, 9.0, 2.0),  # the maximum
        (1.0, 2.0, 1.2),  # 2 m/s² for 0.1 s
        (-1.0, -2.0, -1.2),
        (2.0, 0.0, 0.0),  # braking is 50 times harder
        (1.0, -1.5, -1.5),  # and continues beyond zero
    ],
)
def test_a_speed_changes_slowly_away_from_zero_only(speed, command, allowed):
    after = Unicycle(Pose2D(10.0, 10.0), v=speed).step(command, 0.0, SIZE)
    assert after.v == pytest.approx(allowed, abs=1e-12)  # rounding


def test_a_step_moves_along_the_old_heading_and_stops_at_the_edge():
    assert Unicycle(Pose2D(10.0, 10.0)).step(1.0, 2.0, SIZE).pose == Pose2D(10.1, 10.0, 0.2)
    edge = Unicycle(Pose2D(30.1, 15.0, 0.0), v=1.5)
    assert edge.step(1.7, 0.5, SIZE) == Unicycle(edge.pose)


@pytest.mark.parametrize(
    ("x", "y", "is_touched"),
    [
        (0.89, 0.0, True),  # outline to 0.60 m ahead, the person's radius is 0.3 m
        (0.91, 0.0, False),
        (-0.39, 0.0, True),  # 0.10 m behind
        (-0.41, 0.0, False),
        (0.3, 0.57, True),  # 0.275 m beside
        (0.3, 0.58, False),
        (0.82, 0.49, False),  # at a corner the disc is round
    ],
)
def test_the_outline_is_longer_ahead_of_the_axle(x, y, is_touched):
    quarter = Pose2D(5.0, 5.0, math.pi / 2)
    person = quarter.compose(Pose2D(x, y))
    assert touches(quarter, np.array([[person.x, person.y]]), NO_BOX) == is_touched
    assert (gaps(quarter, np.array([[person.x, person.y]]))[0] <= 0.0) == is_touched


@pytest.mark.parametrize(
    ("box", "is_touched"),
    [
        ((1.59, 0.0, 0.0, 2.0, 1.0), True),
        ((1.61, 0.0, 0.0, 2.0, 1.0), False),
        ((0.25, 0.0, 1.0, 0.1, 0.1), True),  # a box within the outline
        ((0.6 + 0.70, 0.0, math.pi / 4, 1.0, 1.0), True),  # a corner points at the front
        ((0.6 + 0.72, 0.0, math.pi / 4, 1.0, 1.0), False),
        ((0.95, 0.625, math.pi / 4, 0.98, 0.98), False),  # edges at 45° pass by the corner
    ],
)
def test_boxes_are_touched_at_their_edges(box, is_touched):
    assert touches(Pose2D(), NOBODY, np.array([box])) == is_touched


def beam(bearing_deg, ranges):
    """Return the range of the beam that is nearest to a bearing."""
    return ranges[np.abs(ANGLES - math.radians(bearing_deg)).argmin()]


def test_beams_go_counter_clockwise_from_behind():
    person = np.array([[0.0, 2.0]])  # to the left of a robot that looks along x
    ranges = scan(Pose2D(), person, NO_BOX)
    away = scan(Pose2D(yaw=-math.pi / 2), person, NO_BOX)
    # the nearest beam passes the person's middle by up to 0.9°: 1.700 m to 1.703 m
    assert beam(90.0, ranges) == pytest.approx(1.7, abs=0.003)
    assert away[[0, -1]] == pytest.approx([1.7, 1.7])
    assert np.count_nonzero(ranges < 5.0) == 10  # 2 asin(0.3 / 2) are 17.3°, of 1.81° each
    assert np.array_equal(scan(Pose2D(1.0, 2.0, 0.5), NOBODY, NO_BOX), np.full(BEAMS, 5.0))


@pytest.mark.parametrize(
    ("person", "boxes", "pedestrians", "is_seen"),
    [
        ((5.2, 0.0), NO_BOX, [], True),
        ((5.4, 0.0), NO_BOX, [], False),
        ((-2.0, 3.0), NO_BOX, [], True),  # all around
        ((4.0, 0.0), WALL, [], False),
        ((4.0, 0.0), NO_BOX, [(1.5, 0.0)], False),  # behind another person
        ((4.0, 0.9), NO_BOX, [(1.5, 0.0)], True),  # a part beside is enough
    ],
)
def test_people_are_seen_within_range_and_not_behind_things(person, boxes, pedestrians, is_seen):
    people, area = np.array([person, *pedestrians]), KnownArea()
    area.update(scan(Pose2D(), people, boxes))
    assert area.sees(Pose2D(), people)[0] == is_seen


def test_the_map_keeps_what_a_scan_does_not_span():
    """Their map is cleared only to 1 m beyond the ends of the beams."""
    area = KnownArea()
    area.update(np.full(BEAMS, 1.0))  # spans 2 m about the robot
    assert area.sees(Pose2D(), np.array([[1.6, 0.0], [4.0, 0.0]])).tolist() == [False, True]


def world(*boxes, inflation=3, walks=()):
    """Return an episode of 10 x 10 m with boxes, and people who walk."""
    target = Walk(Pose2D(9.5, 0.5), ((9.5, 0.5),), False, 2.0, 0.5)
    return msgspec.structs.replace(
        OPEN, size=(10.0, 10.0), boxes=boxes, inflation_cells=inflation, target=target, humans=walks
    )


def test_a_path_leads_through_the_door():
    wall = Box(2.0, 5.0, 0.0, 4.0, 0.4), Box(8.0, 5.0, 0.0, 4.0, 0.4)
    grid = Grid(world(*wall))
    points = [(1.0, 1.0), *grid.path(Walk(Pose2D(1.0, 1.0), ((1.0, 9.0),), True, 2.0, 0.5))]
    crossing = [
        a[0] + (5.0 - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        for a, b in pairwise(points)
        if a[1] < 5.0 <= b[1]
    ]
    assert len(crossing) == 1
    assert 4.2 < crossing[0] < 5.8  # a cell within the door
    near = grid.near(2.0, 4.5)
    assert len(near) == 10
    assert near == sorted(near, key=lambda cell: math.dist(cell, (2.0, 4.5)))


def test_without_a_free_path_a_leg_is_a_straight_line():
    grid = Grid(world(Box(5.0, 5.0, 0.0, 10.0, 0.4)))
    assert grid.path(Walk(Pose2D(1.0, 1.0), ((1.0, 9.0),), True, 2.0, 0.5)) == [(1.0, 9.0)]


@pytest.mark.parametrize(("inflation", "blocked"), [(0, 1), (1, 1), (2, 4), (3, 9), (10, 100)])
def test_a_blocked_cell_becomes_a_square(inflation, blocked):
    grid = Grid(world(Box(5.1, 5.1, 0.0, 0.1, 0.1), inflation=inflation))
    assert grid.blocked.sum() == blocked
    # cell (25, 25): an even square reaches farther towards higher indices
    assert grid.blocked[25 : 26 + inflation // 2, 25].all()


def test_people_heed_the_blocked_cells_of_a_square_at_the_origin_alone():
    grid = Grid(CORRIDOR)  # 40 × 10 m, the lower wall up to y = 2.2 m
    assert grid.near(9.0, 2.5)
    assert grid.near(12.0, 2.5) == []
    assert grid.blocked[11].all()


@pytest.mark.parametrize(
    ("preferred", "neighbours", "cells", "chosen"),
    [
        ((0.3, 0.4), [], [], (0.3, 0.4)),
        ((3.0, 0.0), [], [], (1.5, 0.0)),  # the maximum
        # the relative velocity 2 may grow to 3 m - 0.9 m in a second: by 0.1, half of it here
        ((1.5, 0.0), [(3.0, 0.0, -1.0, 0.0)], [], (1.05, 0.0)),
        ((1.5, 0.0), [], [(1.5, 0.0)], (0.6, 0.0)),  # a cell takes all of the change
        ((1.5, 0.0), [], [(0.8, 0.0)], (1.5, 0.0)),  # within the radius, a cell has no line
    ],
)
def test_orca_makes_half_of_a_change(preferred, neighbours, cells, chosen):
    velocity = orca((0.0, 0.0), (1.0, 0.0), preferred, neighbours, cells, 0.9)
    assert velocity == pytest.approx(chosen)


def test_people_give_way_to_the_robot_and_the_target_does_not():
    people = People(OPEN)
    for _ in range(60):
        people.step(Unicycle(Pose2D(11.0, 15.0, math.pi)))
    # the target brakes where it touches, and walks on at a twentieth of its speed
    assert 10.0 < people.states[0][0] < 11.0


class Constant:
    def __init__(self, v=0.0, w=0.0):
        self.speeds = v, w

    def reset(self, seed):
        self.views = []

    def command(self, view):
        self.views.append(view)
        return self.speeds


def test_the_first_contact_ends_an_episode():
    record = play(msgspec.structs.replace(ALONE, robot=Pose2D(6.5, 15.0)), Constant(2.0), 1)
    assert record.collided
    gap = record.target[-2] - record.robot[-1, :2]  # people where they were as the robot moved
    assert gap[0] - 0.6 - 0.3 < 0.01


def test_a_planner_gets_the_state_after_all_have_moved():
    planner = Constant()
    record = play(OPEN, planner, 1)
    view = planner.views[3]
    assert view.time_s == pytest.approx(0.3)
    assert (view.target.x, view.target.y) == tuple(record.target[3])
    assert view.people[0][:2] in {tuple(human) for human in record.humans[3]}
    play(DOOR, planner, 1)
    assert set(planner.views[0].ranges) == {5.0}  # before the first scan
    assert min(planner.views[1].ranges) < 5.0


TURNED = math.pi / 2
DISTANCES = np.array([1.5, 1.5, 1.0, 1.9, 2.0])
"""From axle to target. The personal zone is between 1.195 and 1.945 m."""
NEAREST = np.array([3.0, 1.19, 1.21, 3.0, 3.0])
"""From axle to the other person, whose private zone ends at 1.195 m."""


def drive(**changes):
    """Return four steps along x at 1.0, 1.2, 1.2 and 0.6 m/s; the last turns by 90°."""
    x = np.array([0.0, 0.1, 0.22, 0.34, 0.40])
    robot = np.stack((x, 0.0 * x, [0.0, 0.0, 0.0, 0.0, TURNED]), axis=1)
    record = Record(
        robot=robot,
        target=robot[:, :2] + np.stack((DISTANCES, 0.0 * x), axis=1),
        humans=(robot[:, :2] - np.stack((NEAREST, 0.0 * x), axis=1))[:, None],
        visible=np.array([True, True, False, False, True]),
        collided=False,
    )
    return record._replace(**changes)


def scores(max_search_steps=2, **changes):
    episode = msgspec.structs.replace(OPEN, max_steps=10, max_search_steps=max_search_steps)
    return metrics(drive(**changes), episode)


@pytest.mark.parametrize(
    ("changes", "sr", "asr"),
    [
        ({}, True, True),
        ({"collided": True}, False, False),
        ({"max_search_steps": 1}, False, True),  # two unseen steps in a row
        ({"max_search_steps": 1, "visible": np.array([1, 0, 1, 0, 1], bool)}, True, True),
        ({"visible": np.array([1, 1, 1, 1, 0], bool)}, True, True),  # out of sight at the end
    ],
)
def test_a_success_has_no_contact_and_no_long_search(changes, sr, asr):
    result = scores(**changes)
    assert (result["sr"], result["asr"]) == (sr, asr)


def test_shares_count_the_longest_episode_without_the_start():
    result = scores()
    assert result["tvr"] == 20.0  # 2 of 10 steps
    assert result["tin_tperson"] == 20.0  # at 1.5 m and 1.9 m
    assert result["tin_private"] == 10.0  # at 1.19 m
    assert scores(humans=np.empty((5, 0, 2)))["tin_private"] == 0.0
    assert result["search_s"] == pytest.approx(0.2)


def test_motion_is_that_of_the_rows_after_each_step():
    result = scores()
    assert result["pl_m"] == pytest.approx(0.12 + 0.12 + 0.06)  # the first row has none before it
    assert result["avg_vel_m_s"] == pytest.approx((1.0 + 1.2 + 1.2 + 0.6) / 4)
    # velocities along the new heading (1, 0), (1.2, 0), (1.2, 0), (0, 0.6), the first repeated
    changes = [0.0, 0.2, 0.0, math.hypot(1.2, 0.6)]
    assert result["avg_acc_m_s2"] == pytest.approx(sum(changes) / 0.1 / 4)
    # 1, 1.2, 1, 1.2, 1.2 along x, then 0.6 along y: second differences
    changes = [0.4, 0.4, 0.2, math.hypot(-1.2, 0.6)]
    assert result["jerk_m_s3"] == pytest.approx(sum(changes) / 0.01 / 4)


def test_a_run_of_one_step_has_no_jerk():
    record = drive()
    first = {key: getattr(record, key)[:2] for key in ("robot", "target", "humans", "visible")}
    assert scores(**first)["jerk_m_s3"] == 0.0


def view(robot, target, people=(), boxes=(), place="back"):
    """Return the view of a robot at rest; each box has x, y, yaw, length and width."""
    discs = [person[:2] for person in (*people, *([target] if target else []))]
    ranges = scan(robot, np.array(discs).reshape(-1, 2), np.array(boxes).reshape(-1, 5))
    return View(0.0, robot, 0.0, 0.0, target, tuple(people), ranges, place)


def test_the_goal_is_behind_the_target_or_on_its_nearer_side():
    behind = place(WALKER, 0.0, Pose2D(10.0, 1.0), "back", 1.5)
    assert behind == pytest.approx((10.0, 3.5, math.pi / 2))
    for side in (1.0, -1.0):
        beside = place(WALKER, 0.0, Pose2D(8.0, 5.0 + side), "left_side", 1.5)
        assert beside == pytest.approx((10.0, 5.0 + 1.5 * side, 0.0))


def test_the_reference_is_driven_by_its_forces():
    target = Seen(14.0, 10.0, 0.0, 0.0)
    # nothing but the target: 0.1 s of 1.3/s times 3 m/s, straight ahead
    alone = view(Pose2D(10.0, 10.0), target)
    assert Social().command(alone) == pytest.approx((0.39, 0.0))
    boxed = view(Pose2D(10.0, 10.0), target, boxes=[(10.7, 11.2, 0.0, 0.6, 0.6)])
    v, w = Social().command(boxed)
    assert v < 0.39
    assert w < 0.0
    person = view(
        Pose2D(10.0, 10.0, -math.pi / 2), Seen(12.0, 10.0, 0.0, 0.0), [Seen(10.0, 11.0, 0, 0)]
    )
    person = person._replace(ranges=np.full(BEAMS, 5.0))  # a scan would see the person again
    # the goal is 0.5 m ahead, which counts as reached, so only the person acts
    force = 0.1 * 7.0 * math.exp((0.3 - 1.0) / 0.5)
    assert Social().command(person) == pytest.approx((force, 0.0))


MINE = """
from mecazen.keys import CMD_VEL, ODOM, PEOPLE, SCAN
from mecazen.messages import Twist
from mecazen.geometry import Twist2D
from mecazen.node import Node, Row, every

class Follower(Node):
    ROW = Row("follower", inputs=(every(ODOM),), outputs=(CMD_VEL,))

    def reset(self, seed):
        self.target = None

    def step(self, tick, inputs):
        names = [person.id for person in inputs[PEOPLE].persons]
        assert ("target" in names) == (len(inputs[SCAN].ranges) == 200)
        return {CMD_VEL: Twist.planar(Twist2D(1.0, 0.0, 0.5))}

class Pure:
    def reset(self, seed):
        pass

    def command(self, view):
        return 1.0, 0.5

class Broken(Pure):
    def command(self, view):
        return 1 / 0

class Neither:
    pass
"""


@pytest.fixture
def mine(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return file


@pytest.mark.parametrize("name", ["Follower", "Pure"])
def test_a_node_and_a_class_may_enter(mine, name):
    short = msgspec.structs.replace(OPEN, max_steps=10)
    record = play(short, entrant(f"{mine}:{name}")(), 1)
    # a twentieth of a turn in 1 s; the heading before each step counts
    assert record.robot[-1, 2] - record.robot[0, 2] == pytest.approx(0.5)
    assert math.dist(record.robot[-1, :2], record.robot[0, :2]) == pytest.approx(1.0, rel=0.02)


def test_the_planner_of_the_documents_follows_the_target(tmp_path):
    document = Path(__file__).parents[2] / "docs" / "followbench.md"
    (code,) = re.findall(r"```python\n(.*?)```", document.read_text(), re.DOTALL)
    (tmp_path / "mine.py").write_text(code)
    record = play(ALONE, entrant(f"{tmp_path / 'mine.py'}:Mine")(), 1)
    assert not record.collided
    assert record.visible.all()


def jobs(name, *settings, seeds=(1,), file="uTurn_back_1"):
    """Return the jobs of a study for an episode."""
    study = load_study(name)
    files = sorted(SAMPLE.rglob(f"{file}.yaml"))
    return expand(study, seeds, tuple(settings), files=files)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("follower=mine", "follower = 'mine': must be social, or file.py:Class"),
        ("follower={file}:Neither", "must be a class with command"),
        ("follower={file}:Broken", r"mine\.py:Broken: ZeroDivisionError: .*mine\.py:\d+ command"),
        ("standoff_m=1", "set: no option 'standoff_m'; allowed: follower"),
    ],
)
def test_a_fault_of_an_entrant_is_one_line(mine, settings, message):
    (job,) = jobs("followbench_rules", settings.format(file=mine))
    with pytest.raises(MecazenError, match=message):
        followbench_rules(job)


def test_an_entrants_code_is_part_of_the_key(mine):
    (before,) = jobs("followbench_rules", f"follower={mine}:Pure")
    mine.write_text(MINE.replace("1.0, 0.5", "1.0, 0.4"))
    (after,) = jobs("followbench_rules", f"follower={mine}:Pure")
    assert before.key != after.key


@pytest.mark.parametrize(
    ("file", "labels", "values"),
    [
        ("NormalParallelOrcaH5W0_back_2", ("open", "Parallel", "back", 5, True), PARALLEL),
        ("DoorwayOrcaH2W2.8_left_side_1", ("layout", "Doorway", "left_side", 2, False), DOORWAY),
    ],
)
def test_the_reference_follows_as_it_did(file, labels, values):
    (job,) = jobs("followbench_rules", file=file)
    columns = followbench_rules(job)
    assert tuple(columns[name] for name in ("kind", "class", "place", "people", "sr")) == labels
    # numpy's sines differ in the last bit between processors
    assert columns == columns | {name: pytest.approx(v, rel=1e-6) for name, v in values.items()}
    assert columns == followbench_rules(job)


def test_an_episode_is_a_scenario_with_our_robot():
    scenario = scenario_of(OPEN, 3)
    assert scenario.start.pose.x == pytest.approx(OPEN.robot.x + 0.25)  # its middle
    assert len(scenario.crowd.walkers) == len(OPEN.humans)
    door = scenario_of(DOOR, 1)
    assert len(door.world.solids) == len(DOOR.boxes)
    assert door.target.path.goal_m == DOOR.target.goals[-1]
    track = read(next(SAMPLE.rglob("uTurn_back_1.yaml")))
    path = scenario_of(track, 3).target.path
    assert (*path.via_m, path.goal_m) == track.target.goals


@pytest.mark.parametrize(("beside", "view"), [(1.5, "side_left"), (-1.5, "side_right")])
def test_our_robot_remains_on_its_side_of_the_target(beside, view):
    target = OPEN.target.start
    left = beside if OPEN.target.goals[0][0] > target.x else -beside
    start = Pose2D(target.x - 0.25, target.y + left)
    scenario = scenario_of(msgspec.structs.replace(OPEN, place="left_side", robot=start), 1)
    assert scenario.follower.view == view
    assert scenario.start.yaw_deg == pytest.approx(math.degrees(math.copysign(math.pi / 2, -left)))


def test_our_robot_follows_in_a_crowd_without_contact():
    (job,) = jobs("followbench", "sim.duration_s=2.0", file="NormalParallelOrcaH5W0_back_2")
    columns = followbench(job)
    assert (columns["sr"], columns["asr"], columns["contacts_others_all"]) == (True, True, 0)
    assert columns["time_s"] == pytest.approx(2.0, abs=0.02)
