"""The inputs of a step: samples, their ages, and the current configuration."""

import math

import msgspec
import pytest
from mecazen.config import FollowerConfig
from mecazen.keys import CMD_VEL, GROUND_TRUTH, ODOM, SIM_STATE
from mecazen.messages import Empty, Odometry, Time, Twist
from mecazen.node import Inputs, Node, Tick


class Toy(Node):
    def __init__(self, scenario):
        super().__init__(scenario)
        self.config, self.sim = scenario.follower, scenario.sim

    def reset(self, seed): ...

    def step(self, tick, inputs):
        return {}


def test_a_sample_is_as_old_as_its_last_use_and_new_ones_have_no_age():
    inputs = Inputs({ODOM: Odometry()}, {ODOM: 10_000_000, CMD_VEL: 10_000_000}, 30_000_000)
    ages = [inputs.age_s(topic) for topic in (ODOM, CMD_VEL, GROUND_TRUTH)]
    assert ages == [0.0, 0.02, math.inf]
    assert [inputs.gap_s(topic) for topic in (ODOM, GROUND_TRUTH)] == [0.02, math.inf]
    assert inputs[ODOM] == Odometry()
    assert inputs.get(CMD_VEL) is None
    with pytest.raises(KeyError):
        inputs[CMD_VEL]


def test_a_late_sample_is_older_than_its_step():
    inputs = Inputs({ODOM: Odometry()}, {ODOM: 0}, 30_000_000, {ODOM: 10_000_000})
    assert (inputs.age_s(ODOM), inputs.gap_s(ODOM)) == (0.02, 0.03)


def test_a_refused_sample_is_as_old_as_the_one_before():
    given = {ODOM: Odometry(), CMD_VEL: Twist()}
    inputs = Inputs(given, {ODOM: 10_000_000}, 30_000_000)
    inputs.refuse(ODOM, "behind the start")
    assert inputs.refused == [(ODOM, "behind the start")]
    assert (inputs.get(ODOM), inputs.age_s(ODOM)) == (None, 0.02)
    assert inputs.get(CMD_VEL) is not None
    assert len(given) == 2  # what others are given stays


def test_time_of_a_tick_for_headers():
    assert Tick(150, 1_500_000_000, 0.01).time == Time(1, 500_000_000)


def test_sections_that_a_node_keeps_are_the_new_ones_when_parameters_change(scenario):
    toy = Toy(scenario)
    sim = toy.sim
    toy.configure(msgspec.structs.replace(scenario, follower=FollowerConfig(standoff_m=2.0)))
    assert toy.config is toy.scenario.follower
    assert toy.config.standoff_m == 2.0
    assert toy.sim is sim


def test_a_query_in_the_row_without_an_answer_is_a_mistake_of_the_node(scenario):
    with pytest.raises(NotImplementedError, match="sim/state is in the row and has no answer"):
        Toy(scenario).answer(SIM_STATE, Empty())
