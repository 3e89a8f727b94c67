"""Follow-Bench: its files, its rules with the reference and entrants; our robot in its episodes."""

import math
import re
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mecazen.errors import ConfigError, MecazenError
from mecazen.geometry import Pose2D
from mecazen.loading import named_file
from mecazen_experiments.expansion import expand
from mecazen_experiments.followbench.episodes import SAMPLE, Box, Walk, episode_lengths, read
from mecazen_experiments.followbench.people import Grid, People, orca
from mecazen_experiments.followbench.play import Record, metrics, play
from mecazen_experiments.followbench.program import (
    entrant,
    followbench,
    followbench_rules,
    scenario_of,
)
from mecazen_experiments.followbench.robot import (
    ANGLES,
    BEAMS,
    KnownArea,
    Unicycle,
    scan,
    touches,
)
from mecazen_experiments.study import load_study, matching

OPEN = read(SAMPLE / "dynamic" / "NormalParallelOrcaH5W0_back_2.yaml")
CORRIDOR_FILE = SAMPLE / "layout" / "CorridorOrcaH4W5.6_back_1.yaml"
CORRIDOR = read(CORRIDOR_FILE)
TRACK = read(SAMPLE / "target_trajectory" / "uTurn_back_1.yaml")
DOOR = read(SAMPLE / "layout" / "DoorwayOrcaH2W2.8_left_side_1.yaml")
ALONE = msgspec.structs.replace(OPEN, humans=())
NOBODY, NO_BOX = np.empty((0, 2)), np.empty((0, 5))
SIZE = (30.0, 30.0)
WALL = np.array([[3.0, 0.0, 0.0, 0.2, 4.0]])
"""A wall across, 2.9 m ahead; beams pass by its ends."""
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


# ---- files


def test_episodes_are_read_whole():
    assert (CORRIDOR.name, CORRIDOR.cls, CORRIDOR.place) == (CORRIDOR_FILE.stem, "Corridor", "back")
    assert CORRIDOR.robot == Pose2D(6.7, 5.0, 0.0)
    assert CORRIDOR.target == Walk(Pose2D(8.0, 5.0, 0.0), ((38.5, 5.0),), True, 2.0, 0.5)
    assert CORRIDOR.humans[0] == Walk(Pose2D(11.89, 5.17, 0.515), ((29.58, 3.48),), True, 2.0, 0.5)
    assert len(CORRIDOR.humans) == 4
    assert CORRIDOR.boxes[1] == Box(20.0, 8.9, 0.0, 40.0, 2.2)
    assert (CORRIDOR.size, CORRIDOR.inflation_cells) == ((40.0, 10.0), 8)
    assert (CORRIDOR.max_steps, CORRIDOR.max_search_steps) == (408, 102)
    assert (TRACK.cls, TRACK.target.plans, TRACK.target.goal_threshold) == ("uTurn", False, 0.1)
    assert TRACK.target.goals == ((25.0, 10.0), (25.0, 13.0), (5.0, 13.0))
    assert (TRACK.max_steps, TRACK.max_search_steps) == (520, 260)


def test_the_sample_is_readable_and_every_scenario_has_a_length():
    episodes = [read(file) for file in sorted(SAMPLE.rglob("*.yaml"))]
    assert len(episodes) == 31
    for episode in episodes:
        assert f"H{len(episode.humans)}" in episode.name or not episode.humans
    assert "MIT License" in (SAMPLE / "LICENSE").read_text(encoding="utf-8")
    assert len(episode_lengths()) == 8 + 2 * 24 + 28


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height: 10.0", "height: -1", r"world\.height: Expected `float` > 0"),
        (
            "height: 10.0",
            "height: !!python/object/apply:os.system ['false']",
            r"world\.height: Expected `float`",
        ),
        ("  step_time: 0.1\n", "", r"world: Object missing required field `step_time`"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, 5.0]", r"target\[0\]\.state: .*length 3"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, inf, 0]", r"target\[0\]\.state\[1\]: Expected"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [a, b, c]", r"target\[0\]: goal: Expected `float`"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]]]", r"goal: must have a state after"),
        ('name: "orca"', "name: sfm", r"target\[0\]\.behavior\.name: Invalid enum value 'sfm'"),
        ("{name: rectangle, length: 0.7,", "{name: rectangle, length: 0.8,", r"0\.70 x 0\.55 m"),
        ("{name: rectangle, length: 40.0", "{name: circle, length: 40.0", r"obstacle\[0\]\.shape"),
        ("world:", "world: [", r"not YAML: line \d+"),
        ("world:", "w\0rld:", r"not YAML"),
        ("height: 10.0", "deep: " + "[" * 1000 + "]" * 1000, r"not YAML: .*recursion"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    text = CORRIDOR_FILE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / CORRIDOR_FILE.name
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("CorridorOrcaH4W5.6.yaml", "the file's name must be"),
        ("CorridorOrcaH5W5.6_back_1.yaml", "no length is known for an episode of 'CorridorOrcaH5"),
    ],
)
def test_a_name_contains_scenario_place_and_number(tmp_path, name, message):
    with pytest.raises(ConfigError, match=message):
        read(tmp_path / name)


# ---- the benchmark's robot and people


@pytest.mark.parametrize(
    ("speed", "command", "allowed"),
    [
        (0.0, 2.0, 2.0),  # from rest, any speed
        (1.0, 2.0, 1.2),  # 2 m/s² for 0.1 s
        (1.0, -1.5, -1.5),  # braking is 50 times harder, and continues beyond zero
    ],
)
def test_a_speed_changes_slowly_away_from_zero_only(speed, command, allowed):
    after = Unicycle(Pose2D(10.0, 10.0), v=speed).step(command, 2.0, SIZE)
    assert after.v == pytest.approx(allowed, abs=1e-12)  # rounding
    # along the heading before the step
    assert after.pose == pytest.approx((10.0 + 0.1 * allowed, 10.0, 0.2))
    edge = Unicycle(Pose2D(30.1, 15.0, 0.0), v=1.5)
    assert edge.step(1.7, 0.5, SIZE) == Unicycle(edge.pose)


@pytest.mark.parametrize(
    ("x", "y", "is_touched"),
    [
        (0.89, 0.0, True),  # outline to 0.60 m ahead, the person's radius is 0.3 m
        (-0.41, 0.0, False),  # 0.10 m behind
        (0.3, 0.57, True),  # 0.275 m beside
        (0.82, 0.49, False),  # at a corner the disc is round
    ],
)
def test_the_outline_is_longer_ahead_of_the_axle(x, y, is_touched):
    quarter = Pose2D(5.0, 5.0, math.pi / 2)
    person = quarter.compose(Pose2D(x, y))
    assert touches(quarter, np.array([[person.x, person.y]]), NO_BOX) == is_touched


@pytest.mark.parametrize(
    ("box", "is_touched"),
    [
        ((0.25, 0.0, 1.0, 0.1, 0.1), True),  # a box within the outline
        ((0.6 + 0.70, 0.0, math.pi / 4, 1.0, 1.0), True),  # a corner points at the front
        ((0.95, 0.625, math.pi / 4, 0.98, 0.98), False),  # edges at 45° pass by the corner
    ],
)
def test_boxes_are_touched_at_their_edges(box, is_touched):
    assert touches(Pose2D(), NOBODY, np.array([box])) == is_touched


def test_beams_go_counter_clockwise_from_behind():
    person = np.array([[0.0, 2.0]])  # to the left of a robot that looks along x
    ranges = scan(Pose2D(), person, NO_BOX)
    away = scan(Pose2D(yaw=-math.pi / 2), person, NO_BOX)
    # the nearest beam passes the person's middle by up to 0.9°: 1.700 m to 1.703 m
    assert ranges[np.abs(ANGLES - math.pi / 2).argmin()] == pytest.approx(1.7, abs=0.003)
    assert away[[0, -1]] == pytest.approx([1.7, 1.7])
    assert np.count_nonzero(ranges < 5.0) == 10  # 2 asin(0.3 / 2) are 17.3°, of 1.81° each
    assert np.array_equal(scan(Pose2D(1.0, 2.0, 0.5), NOBODY, NO_BOX), np.full(BEAMS, 5.0))


@pytest.mark.parametrize(
    ("person", "boxes", "pedestrians", "is_seen"),
    [
        ((5.2, 0.0), NO_BOX, [], True),
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


def world(*boxes, inflation=3):
    """Return an episode of 10 x 10 m with boxes."""
    target = Walk(Pose2D(9.5, 0.5), ((9.5, 0.5),), False, 2.0, 0.5)
    return msgspec.structs.replace(
        OPEN, size=(10.0, 10.0), boxes=boxes, inflation_cells=inflation, target=target, humans=()
    )


def test_a_path_leads_through_the_door():
    wall = Box(2.0, 5.0, 0.0, 4.0, 0.4), Box(8.0, 5.0, 0.0, 4.0, 0.4)
    grid = Grid(world(*wall))
    walk = Walk(Pose2D(1.0, 1.0), ((1.0, 9.0),), True, 2.0, 0.5)
    points = [(1.0, 1.0), *grid.path(walk)]
    crossing = [
        a[0] + (5.0 - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        for a, b in pairwise(points)
        if a[1] < 5.0 <= b[1]
    ]
    assert len(crossing) == 1
    assert 4.2 < crossing[0] < 5.8  # a cell within the door
    closed = Grid(world(Box(5.0, 5.0, 0.0, 10.0, 0.4)))
    assert closed.path(walk) == [(1.0, 9.0)]  # without a free path, a straight line
    near = grid.near(2.0 + 4.5j)
    assert len(near) == 10
    assert near == sorted(near, key=lambda cell: abs(cell - (2.0 + 4.5j)))


def test_blocked_cells_become_squares_and_those_near_the_origin_are_heeded():
    grid = Grid(world(Box(5.1, 5.1, 0.0, 0.1, 0.1), inflation=2))
    assert np.argwhere(grid.blocked).tolist() == [[25, 25], [25, 26], [26, 25], [26, 26]]
    grid = Grid(CORRIDOR)  # 40 × 10 m, the lower wall up to y = 2.2 m
    assert grid.near(9.0 + 2.5j)
    assert grid.near(12.0 + 2.5j) == []
    assert grid.blocked[11].all()


@pytest.mark.parametrize(
    ("preferred", "neighbours", "cells", "chosen"),
    [
        (3.0, [], [], 1.5),  # the maximum
        # the relative velocity 2 may grow to 3 m - 0.9 m in a second: by 0.1, half of it here
        (1.5, [(3.0 + 0j, -1.0 + 0j)], [], 1.05),
        (1.5, [], [1.5], 0.6),  # a cell takes all of the change
        (1.5, [], [0.8], 1.5),  # within the radius, a cell has no line
    ],
)
def test_orca_makes_half_of_a_change(preferred, neighbours, cells, chosen):
    cells = [complex(cell) for cell in cells]
    assert orca(0j, 1.0 + 0j, complex(preferred), neighbours, cells, 0.9) == pytest.approx(chosen)


def test_people_give_way_to_the_robot_and_the_target_does_not():
    people = People(OPEN)
    for _ in range(60):
        people.step(Unicycle(Pose2D(11.0, 15.0, math.pi)))
    # the target brakes where it touches, and walks on at a twentieth of its speed
    assert 10.0 < people.places[0, 0] < 11.0


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


# ---- metrics


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


# ---- planners


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


def test_a_study_elsewhere_has_the_episodes_of_the_package(tmp_path):
    copy = tmp_path / "mine.toml"
    copy.write_bytes(named_file("followbench_rules", "experiment").read_bytes())
    assert matching(load_study(str(copy)).files) == sorted(SAMPLE.rglob("*.yaml"))


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


# ---- our robot


def test_an_episode_is_a_scenario_with_our_robot():
    scenario = scenario_of(OPEN, 3)
    assert scenario.start.pose.x == pytest.approx(OPEN.robot.x + 0.25)  # its middle
    assert len(scenario.crowd.walkers) == len(OPEN.humans)
    door = scenario_of(DOOR, 1)
    assert len(door.world.solids) == len(DOOR.boxes)
    assert door.target.path.goal_m == DOOR.target.goals[-1]
    path = scenario_of(TRACK, 3).target.path
    assert (*path.via_m, path.goal_m) == TRACK.target.goals


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
