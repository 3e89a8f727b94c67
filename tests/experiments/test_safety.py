"""Contacts, gaps and sight of runs made up by hand; the studies of safety; a minute by chance."""

import math

import numpy as np
import pytest
from harness import SCENARIOS
from mecazen import messages as m
from mecazen.config.world import Box, Cylinder
from mecazen.loading import load_scenario
from mecazen.skeleton import INDEX, LIMBS
from mecazen_experiments import frame
from mecazen_experiments.expansion import Job, expand
from mecazen_experiments.fuzz import fuzz
from mecazen_experiments.safety import gap_to_obstacle, gap_to_person, measure
from mecazen_experiments.study import load_study
from mecazen_experiments.tables import make_tables
from mecazen_tools.observe import PersonOverTime, Watched
from mecazen_tools.table import Poses
from people import HEIGHT, NEXUS, body

from experiments import made_up

LENGTH, WIDTH = NEXUS.footprint
SCENARIO = load_scenario(SCENARIOS / "safety.toml")
N = 200


def poses(*rows):
    return Poses(*np.array(rows, dtype=float).T)


def gap(joints):
    """Return the gap between a robot at the origin and a person."""
    (value,) = gap_to_person(NEXUS, poses((0.0, 0.0, 0.0)), PersonOverTime(joints[None], HEIGHT))
    return value


# --- gaps ----------------------------------------------------------------------------------------


def test_limbs_above_and_absent_people_are_not_near():
    joints = body()
    joints[:, 2] += NEXUS.height + 0.2
    assert gap(joints) == math.inf
    assert math.isnan(gap(np.full((20, 3), math.nan)))


def test_the_gap_to_a_person_is_that_of_the_points_of_limbs():
    shares = np.linspace(0.0, 1.0, 1001)[:, None]
    for pose in np.random.default_rng(1).uniform((-1.0, -1.0, -3.0), (1.0, 1.0, 3.0), (20, 3)):
        joints, gaps = body(pose=tuple(pose)), []
        for limb in LIMBS:
            begin, end = joints[INDEX[limb.begin]], joints[INDEX[limb.end]]
            points, radius = begin + shares * (end - begin), limb.radius * HEIGHT
            points = points[points[:, 2] <= NEXUS.height + radius]
            outside = np.maximum(abs(points[:, :2]) - NEXUS.footprint, 0.0)
            gaps += (np.hypot(*outside.T) - radius).tolist()
        # two samples of a limb are at most 0.5 mm apart
        assert gap(joints) == pytest.approx(min(gaps), abs=5e-4)


def test_the_gap_to_an_obstacle_is_the_straight_line():
    pillar = Cylinder(size_m=(0.1, 1.0), position_m=(1.0, 1.0))
    at_origin = poses((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 4))
    straight, turned = gap_to_obstacle(NEXUS, at_origin, pillar)
    assert straight == pytest.approx(math.hypot(1.0 - LENGTH, 1.0 - WIDTH) - 0.1, abs=1e-12)
    assert turned == pytest.approx(math.sqrt(2.0) - LENGTH - 0.1, abs=1e-12)
    wall = Box(size_m=(4.0, 0.1, 1.0), position_m=(1.0, 0.0), yaw_deg=90.0)
    to_wall = gap_to_obstacle(NEXUS, poses((0.0, 0.3, 0.0), (1.0 - LENGTH, 0.0, 0.0)), wall)
    assert to_wall == pytest.approx([0.95 - LENGTH, 0.0], abs=1e-12)


# --- measures ------------------------------------------------------------------------------------


def measured(robot_x, person_x, pedestrian_y=None):
    """Return the measures of a robot and a person along x, and a pedestrian along y at x = 0."""
    still = np.zeros(N)
    table = made_up.run(N, robot=(robot_x, 0.0, 0.0), target=(person_x, 0.0, 0.0))
    person = np.array([body(pose=(x, 0.0, 0.0)) for x in np.broadcast_to(person_x, N)])
    pedestrians = ()
    if pedestrian_y is not None:
        bodies = np.array([body(pose=(0.0, y, 0.0)) for y in pedestrian_y])
        pedestrians = (PersonOverTime(bodies, HEIGHT),)
    t = made_up.TICK_S * np.arange(N)
    frames = [
        (m.Header(m.Time.from_ns(round(time * 1e9))), None if k % 4 == 3 else m.Skeleton())
        for k, time in enumerate(t.tolist())
    ]
    robot, person = Poses(robot_x, still, still), PersonOverTime(person, HEIGHT)
    return measure(Watched(table, t, robot, person, pedestrians, (), frames), SCENARIO)


STANDS, COMES = np.zeros(N), np.linspace(2.0, 0.0, N)


@pytest.mark.parametrize(
    ("robot", "person", "contacts"),
    [
        (STANDS, COMES, (0, 1)),  # the person walks into a standing robot
        (2.0 - COMES, np.linspace(2.0, 1.9, N), (1, 1)),
        (STANDS, np.linspace(3.0, 3.1, N), (0, 0)),
    ],
)
def test_a_contact_is_caused_by_a_robot_that_drives_at_the_person(robot, person, contacts):
    scores = measured(robot, person)
    assert (scores["contacts_person"], scores["contacts_person_all"]) == contacts
    assert (scores["gap_person_m"] < 0.0) == bool(contacts[1])


def test_pedestrians_count_apart():
    scores = measured(STANDS, np.linspace(3.0, 3.1, N), COMES - 2.0)
    assert (scores["contacts_others"], scores["contacts_others_all"]) == (0, 1)
    assert scores["gap_others_m"] < 0.0 < scores["gap_person_m"]
    scores = measured(-COMES, np.linspace(3.0, 3.1, N), STANDS)
    assert (scores["contacts_others"], scores["contacts_others_all"]) == (1, 1)
    assert scores["conflict_s"] > 0.0


def test_three_frames_of_four_show_the_person():
    scores = measured(STANDS, np.linspace(1.2, 1.3, N))
    assert scores["view_percent"] == pytest.approx(75.0, abs=1.0)
    assert scores["regain_s"] == pytest.approx(made_up.TICK_S)


# --- studies -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "only", "rows"),
    [
        ("safety", ["driver=guard"], 12 * 4),
        ("unpromised", ["driver=guard"], 3 * 2),
        ("fuzz", [], 2 * 4),
    ],
)
def test_each_row_can_be_loaded_and_shown(name, only, rows):
    study = load_study(name)
    jobs = expand(study, [1], only=only)
    assert len(jobs) == rows
    names = {column.name for table in study.tables for column in table.columns} - {*study.derive}
    scores = measured(STANDS, COMES) | dict.fromkeys(names, 1.0)
    text = frame.to_csv(jobs, {job.key: scores for job in jobs})
    for table in make_tables(study, frame.read(study, text)):
        assert all(cell != "" for row in table.rows for cell in row)


# --- by chance -----------------------------------------------------------------------------------


def minute(seed, *settings):
    return fuzz(Job("fuzz", {}, "", seed, None, None, settings, "", ""))


@pytest.mark.parametrize("world", ["", "programs={}"], ids=["plane", "rollers"])
def test_a_guarded_robot_touches_nothing(world):
    scores = minute(3, "sim.duration_s=4.0", "speed_m_s=0.0", *filter(None, [world]))
    assert scores["contacts"] == scores["walls"] == 0
    assert scores["driven_m"] > 1.0


def test_a_robot_without_a_guard_touches_something():
    scores = minute(1, "sim.duration_s=20.0", "guard.enabled=false")
    assert scores["caused"] + scores["walls"] > 0
    assert min(scores["gap_person_m"], scores["gap_walls_m"]) < 0.0
