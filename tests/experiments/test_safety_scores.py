"""Contacts, gaps and sight, of runs made up by hand."""

import math

import numpy as np
import pytest
from harness import ROOT
from mecazen import messages as m
from mecazen.loading import load_scenario
from mecazen_experiments.safety_scores import safety
from mecazen_tools.observe import PersonOverTime, Watched
from mecazen_tools.table import Poses
from people import HEIGHT, body

from experiments import made_up

SCENARIO = load_scenario(ROOT / "configs/scenarios/safety.toml")


def watched(robot_x, person_x, other_y=None):
    """Return a robot and a person along x, and a pedestrian along y at x = 0, over time."""
    n = len(robot_x)
    still = np.zeros(n)
    ticks = made_up.run(n, robot=(robot_x, 0.0, 0.0), target=(person_x, 0.0, 0.0))
    step = np.array([body(pose=(x, 0.0, 0.0)) for x in np.broadcast_to(person_x, n)])
    others = ()
    if other_y is not None:
        others = (PersonOverTime(np.array([body(pose=(0.0, y, 0.0)) for y in other_y]), HEIGHT),)
    t = np.arange(n) * made_up.TICK_S
    frames = [
        (m.Header(m.Time.from_ns(round(time * 1e9))), None if k % 4 == 3 else m.Skeleton())
        for k, time in enumerate(t.tolist())
    ]
    return Watched(
        ticks,
        t,
        Poses(robot_x, still, still),
        PersonOverTime(step, HEIGHT),
        others,
        (),
        frames,
    )


def test_who_walks_into_a_standing_robot_is_a_contact_that_it_did_not_cause():
    n = 200
    found = safety(
        watched(np.zeros(n), np.linspace(3.0, 3.1, n), np.linspace(-2.0, 0.0, n)), SCENARIO
    )
    assert (found.contacts_others, found.contacts_others_all) == (0, 1)
    assert found.contacts_person == 0
    assert found.gap_others_m < 0.0 < found.gap_person_m


def test_a_person_who_walks_into_a_standing_robot_is_a_contact_that_it_did_not_cause():
    n = 200
    walks = np.linspace(2.0, 0.0, n)
    found = safety(watched(np.zeros(n), walks), SCENARIO)
    assert (found.contacts_person, found.contacts_person_all) == (0, 1)
    found = safety(watched(2.0 - walks, np.linspace(2.0, 1.9, n)), SCENARIO)
    assert (found.contacts_person, found.contacts_person_all) == (1, 1)


def test_a_robot_that_drives_at_somebody_has_caused_it():
    n = 200
    found = safety(
        watched(np.linspace(-2.0, 0.0, n), np.linspace(3.0, 3.1, n), np.zeros(n)), SCENARIO
    )
    assert (found.contacts_others, found.contacts_others_all) == (1, 1)
    assert found.conflict_s > 0.0


def test_three_frames_of_four_show_the_person():
    n = 200
    found = safety(watched(np.zeros(n), np.linspace(1.2, 1.3, n)), SCENARIO)
    assert found.view_percent == pytest.approx(75.0, abs=1.0)
    assert found.regain_s == pytest.approx(made_up.TICK_S)
    assert math.isnan(found.gap_person_m) is False
