"""A robot that is driven at random touches nothing with a guard, and much without."""

from itertools import pairwise

import pytest
from harness import ROBOTS
from mecazen.geometry import Pose2D
from mecazen_experiments import fuzz
from mecazen_experiments.report import Record


def ridden(seed, *settings):
    (job,) = fuzz.jobs([seed], ROBOTS / "nexus.toml", settings)
    return fuzz.EPISODE.measure(job)[0]


@pytest.mark.parametrize("physics", [(), fuzz.ROLLERS], ids=["plane", "rollers"])
def test_a_guarded_robot_touches_nothing(physics):
    minute = ridden(3, "sim.duration_s=4.0", *physics)
    assert minute.contacts == 0
    assert minute.driven_m > 1.0


def test_a_robot_without_a_guard_does():
    minute = ridden(1, "sim.duration_s=20.0", "guard.enabled=false")
    assert minute.contacts > 0
    assert minute.least_gap_m < 0.0


def test_the_person_walks_towards_the_robot_and_brakes_within_a_time(monkeypatch):
    job, _ = fuzz.jobs([1, 2], ROBOTS / "nexus.toml", ("sim.tick_s=0.02",))
    random = fuzz._random(1)
    rider = fuzz._Rider(random, fuzz._scenario(1, random, job.scenario, job.settings))
    monkeypatch.setattr(rider, "_is_free", lambda *_: True)
    speeds = [rider.walk(tick, Pose2D()).x for tick in range(2000)]
    # 6 m/s² in 20 ms; the person walks on, wherever the robot is
    assert max(abs(b - a) for a, b in pairwise(speeds)) == pytest.approx(0.12)
    assert max(speeds) > 1.0


def test_what_came_of_it_names_the_seeds_that_touched():
    touched = fuzz.Episode(2, 3, -0.1, 30.0, 0.25)
    free = fuzz.Episode(0, 1, 0.2, 10.0, 0.75)
    minutes = enumerate((touched, free), start=7)
    told = fuzz.tell([Record(fuzz.Key("", seed, ""), "", of, 1.0, 1.0) for seed, of in minutes])
    assert told == (
        "2 min, 40 m driven, held 50% of the time, least gap -0.100 m, contacts 4, "
        "2 of them caused by the robot, "
        # 6.296 at most where 2 were counted, by tables of Garwood, in 1/30 h
        "at most 188.9 per hour with seeds 7"
    )
