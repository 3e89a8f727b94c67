"""A scenario from Python, step by step, over a world of a few lines."""

import copy
import math
import pickle

import numpy as np
import pytest
from harness import Listener, error_of, load_robot
from mecazen import keys
from mecazen.config import Scenario, SimConfig
from mecazen.errors import ConfigError, MecazenError
from mecazen_tools.simulation import Simulation, load

CARTS = Scenario(
    load_robot(), ("physics",), {"physics": "carts:Carts"}, sim=SimConfig(duration_s=0.05)
)


@pytest.fixture
def sim():
    with Simulation(CARTS) as sim:
        yield sim


def test_it_is_at_the_first_tick_at_once_and_over_after_the_last(sim):
    assert (sim.time_s, sim.is_over, len(sim.trajectory.rows())) == (0.0, False, 1)
    state = sim.step()
    assert (state.time_s, state.robot.x, state.person, state.follower) == (0.01, 0.0, None, None)
    assert [round(sim.time_s, 9) for _ in sim.ticks(0.02)] == [0.02, 0.03]
    assert sim.run().time_s == pytest.approx(0.04)
    assert sim.is_over
    assert sim.run(1.0).time_s == sim.run(math.inf).time_s == pytest.approx(0.04)
    said = error_of(MecazenError, sim.step)
    assert said == "the run is over after 0.05 s; duration_s sets it"


def test_a_reset_begins_anew_with_the_same_seed_or_another(sim):
    sim.run()
    sim.reset()
    assert (sim.time_s, sim.scenario.seed) == (0.0, CARTS.seed)
    sim.reset(np.int64(9))
    assert sim.scenario.seed == 9
    assert error_of(ConfigError, lambda: sim.reset(-1)).startswith("seed = -1 must be between")


def test_what_is_commanded_is_published_before_each_tick(sim):
    heard = Listener(sim._run.bus, keys.CMD_VEL)
    sim.command(0.25, wz=np.float32(0.5))
    for _ in range(2):
        sim.step()
        (command,) = heard.take()
        assert command.message.to_planar() == (0.25, 0.0, 0.5)
    sim.reset()
    sim.step()
    assert heard.take() == []


@pytest.mark.parametrize(
    ("ask", "reason"),
    [
        (lambda sim: sim.command(robot="two"), "no robot 'two'"),
        (lambda sim: sim.command(wz=math.nan), "must be finite numbers"),
        (lambda sim: sim.command_person(1.0), "target.path = { kind = 'driven' }"),
        *(
            (lambda sim, seconds=seconds: sim.run(seconds), "must be a number >= 0")
            for seconds in (-1.0, math.nan)
        ),
        (
            lambda sim: load(CARTS, {"follower.standof_m": 1.5}),
            "scenario with follower.standof_m: ",
        ),
        (lambda sim: Simulation(None), "scenario: got None; must be a name, a file or a Scenario"),
        (lambda sim: Simulation(CARTS, duration=1.0), "duration: no option of Simulation; did you"),
        (lambda sim: sim.set_parameters(**{"follower.standoff_m": 1.5}), "takes no part"),
        (lambda sim: sim.set_parameters(**{"sim.tick_s": 0.02}), "can't change while it runs"),
        (lambda sim: sim.state_of("two"), "no robot 'two'; robots: "),
        (lambda sim: sim.latest("odmo"), "odmo: no key of this scenario; its keys: "),
        (lambda sim: sim.view(), "view=True"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(sim, ask, reason):
    assert reason in error_of(MecazenError, lambda: ask(sim))


def test_its_name_tells_scenario_time_and_seed(sim):
    sim.step()
    assert repr(sim) == "<Simulation scenario: 0.01 of 0.05 s, seed 0>"


@pytest.mark.parametrize("copied", [pickle.dumps, copy.copy, copy.deepcopy])
def test_a_copy_is_refused_with_a_remedy(sim, copied):
    said = error_of(TypeError, lambda: copied(sim))
    assert said.endswith("make another from its scenario: Simulation(sim.scenario)")


def test_nothing_goes_on_after_it_is_closed(sim):
    sim.close()
    for ask in (sim.step, sim.run, sim.reset, sim.command, sim.set_parameters):
        assert error_of(MecazenError, ask) == "the simulation is closed"


@pytest.mark.parametrize("value", [{1, 2}, np.zeros(2), [b"a"]])
def test_a_setting_that_toml_does_not_have_is_named(sim, value):
    settings = {"follower.standoff_m": value}
    for ask in (lambda: load(CARTS, settings), lambda: sim.set_parameters(**settings)):
        assert error_of(ConfigError, ask).startswith("follower.standoff_m: got ")


def test_settings_of_python_are_those_of_toml():
    settings = {
        "follower.standoff_m": np.float32(1.5),
        "seed": np.uint8(7),
        "target.path": {"kind": "driven"},
        "services": ("physics", "target"),
    }
    loaded = load(CARTS, settings)
    assert (loaded.follower.standoff_m, loaded.seed) == (1.5, 7)
    assert loaded.services == ("physics", "target")
    assert type(loaded.target.path).__name__ == "Driven"
