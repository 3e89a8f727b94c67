"""A robot that is driven at random touches nothing with a guard, and much without."""

import pytest
from harness import ROBOTS
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


def test_what_came_of_it_names_the_seeds_that_touched():
    touched = fuzz.Episode(2, -0.1, 30.0, 0.25)
    free = fuzz.Episode(0, 0.2, 10.0, 0.75)
    minutes = enumerate((touched, free), start=7)
    told = fuzz.tell([Record(fuzz.Key("", seed, ""), "", of, 1.0, 1.0) for seed, of in minutes])
    assert told == (
        "2 min, 40 m driven, held 50% of the time, least gap -0.100 m, contacts 2, "
        # 6.296 at most where 2 were counted, by tables of Garwood, in 1/30 h
        "at most 188.9 per hour with seeds 7"
    )
