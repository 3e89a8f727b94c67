"""A scenario from Python, over a world of a few lines."""

import math
from unittest.mock import Mock

import numpy as np
import pytest
from carts import Carts
from harness import Listener, error_of, load_robot
from mecazen import keys
from mecazen.config import Scenario, SimConfig
from mecazen.errors import MecazenError, NodeError
from mecazen_tools.simulation import Simulation

CARTS = Scenario(
    load_robot(), ("physics",), {"physics": "carts:Carts"}, sim=SimConfig(duration_s=0.05)
)


@pytest.fixture
def sim():
    with Simulation(CARTS) as sim:
        yield sim


def test_run_has_all_ticks(sim):
    assert (sim.time_s, sim.is_over, len(sim.trajectory.rows())) == (0.0, False, 1)
    state = sim.step()
    assert (state.time_s, state.robot.x, state.person, state.follower) == (0.01, 0.0, None, None)
    assert [round(sim.time_s, 9) for _ in sim.ticks(0.02)] == [0.02, 0.03]
    assert sim.run().time_s == pytest.approx(0.04)
    assert sim.is_over
    assert sim.run(1.0).time_s == sim.run(math.inf).time_s == pytest.approx(0.04)
    reason = error_of(MecazenError, sim.step)
    assert reason == "the run is over after 0.05 s; duration_s sets it"


def test_command_is_repeated_until_a_reset(sim):
    commands = Listener(sim.bus, keys.CMD_VEL)
    sim.command(0.25, wz=np.float32(0.5))
    for _ in range(2):
        sim.step()
        (command,) = commands.take()
        assert command.message.to_planar() == (0.25, 0.0, 0.5)
    sim.reset()
    sim.step()
    assert commands.take() == []


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda sim: sim.reset(-1), "seed = -1 must be between"),
        (lambda sim: sim.command(robot="two"), "no robot 'two'; robots: one without a name"),
        (lambda sim: sim.command(wz=math.nan), "must be finite numbers"),
        (lambda sim: sim.run(-1.0), "must be a number >= 0"),
        (lambda sim: sim.run(math.nan), "must be a number >= 0"),
        (lambda sim: sim.set_parameters({"follower.standoff_m": 1.5}), "takes no part"),
        (lambda sim: sim.set_parameters({"sim.tick_s": 0.02}), "can't change while it runs"),
        (lambda sim: sim.latest("odmo"), "odmo: no key of this scenario; its keys: "),
        (lambda sim: sim.view(), "view=True"),
        (lambda _: Simulation(None), "scenario: got None; must be a name, a file or a Scenario"),
        (lambda _: Simulation("bakc"), "bakc: no such scenario; did you mean back?"),
        (lambda _: Simulation(CARTS, {"seed": 1j}), "seed: got 1j; TOML has no such value"),
        (lambda _: Simulation(CARTS, {"seeed": 1.5}), "scenario with seeed: "),
    ],
)
def test_a_mistake_is_one_line(sim, call, reason):
    assert reason in error_of(MecazenError, lambda: call(sim))


def test_a_closed_simulation_refuses_to_continue(sim):
    sim.close()
    for call in (sim.step, sim.run, sim.reset, sim.command, lambda: sim.set_parameters({})):
        assert error_of(MecazenError, call) == "the simulation is closed"


def test_a_failing_start_closes_the_services(monkeypatch):
    close = Mock()
    monkeypatch.setattr(Carts, "step", lambda *_: 1 / 0)
    monkeypatch.setattr(Carts, "close", close)
    assert error_of(NodeError, lambda: Simulation(CARTS)).startswith("physics: ZeroDivisionError")
    close.assert_called_once()
