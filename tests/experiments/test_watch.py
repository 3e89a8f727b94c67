"""Places of all people in a run, and frames in which the camera shows the robot's person."""

import numpy as np
import pytest
from experiments.made_up import run
from mecazen import messages as m
from mecazen.keys import PEOPLE, SKELETONS, TARGET_SKELETON
from mecazen.skeleton import JOINTS
from mecazen_experiments import watch as module
from mecazen_experiments.run import Observed
from mecazen_experiments.watch import PELVIS, SAME_M, watch

N = len(JOINTS)


def header(t_s):
    return m.Header(m.Time.from_ns(round(t_s * 1e9)))


def at(x):
    return (m.Point(x, 0.0, 1.0),) * N


def frame(t_s, *places, confidence=()):
    bodies = tuple(m.Skeleton(joints=at(x), confidence=confidence) for x in places)
    return m.Skeletons(header(t_s), bodies)


@pytest.fixture
def watched(monkeypatch):
    """A robot that stands 1 m before the origin of the world; its person is at 3 m and 4 m."""
    away, hidden = 3.0 + SAME_M + 0.01, (0,) * N
    samples = {
        TARGET_SKELETON.key: [
            m.Skeleton(header(t), height=1.8, joints=at(x)) for t, x in ((0.0, 3.0), (0.04, 4.0))
        ],
        PEOPLE.key: [
            m.People(header(0.0), (m.Person("target", joints=at(3.0)),)),
            m.People(header(0.04), (m.Person("anna", height=1.6, joints=at(7.0)),)),
            m.People(header(9.0), (m.Person("late", joints=at(7.0)),)),
        ],
        SKELETONS.key: [
            m.Skeletons(),  # of before the start
            frame(0.01, away, 3.1),
            frame(0.02, away),
            frame(0.03, 3.0, confidence=hidden),
            frame(0.04),
        ],
    }
    table = run(10, robot=(1.0, 0.0, 0.0), odom=(0.5, 0.0, 0.0))
    monkeypatch.setattr(module, "observe_bodies", lambda *_: Observed(table, "sha", samples))
    return watch(None)


def test_people_are_where_they_are_reported_and_nowhere_else(watched):
    assert watched.t.tolist() == [0.0, 0.04]
    assert watched.person.joints[:, PELVIS, 0].tolist() == [3.0, 4.0]
    (anna,) = watched.others
    assert (anna.height, watched.person.height) == (1.6, 1.8)
    assert np.isnan(anna.joints[0]).all()
    assert anna.joints[1, PELVIS].tolist() == [7.0, 0.0, 1.0]
    assert watched.robot.at(1) == (1.0, 0.0, 0.0)


def test_a_frame_shows_the_person_if_a_body_is_seen_where_they_are(watched):
    # at 0.01 s the person is at the next known place, 4 m: 3 m ahead of the robot
    assert watched.seen.t.tolist() == [0.01, 0.02, 0.03, 0.04]
    assert watched.seen.reported.tolist() == [True, False, False, False]
    assert watched.seen.joints[0, PELVIS].tolist() == [3.6, 0.0, 1.0]  # in odom
    assert watched.truth.joints[:, PELVIS, 0].tolist() == [3.0, 4.0]
