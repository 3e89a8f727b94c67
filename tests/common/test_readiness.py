"""Readiness: a service has seen all others, in real time all but observers."""

import msgspec
import pytest
from mecazen.bus import LocalBus
from mecazen.config import RobotConfig, SimConfig, StartConfig
from mecazen.runtime.readiness import announce_readiness


@pytest.mark.parametrize(
    ("mode", "others", "awaited"),
    [
        ("real_time", ("target",), ["target"]),
        ("real_time", ("recorder", "viewer"), []),
        ("lockstep", ("recorder", "viewer"), ["recorder", "viewer"]),
    ],
)
def test_a_service_is_ready_when_all_others_are_alive(scenario, mode, others, awaited):
    bus, services = LocalBus(), ("controller", *others)
    scenario = msgspec.structs.replace(scenario, services=services, sim=SimConfig(mode=mode))
    announce_readiness(bus, "controller", "", scenario)
    for name in awaited:
        assert "controller/ready" not in bus.presence.names
        bus.declare_alive(name)
    assert "controller/ready" in bus.presence.names


def test_a_robots_service_waits_for_those_of_all_robots_and_says_so_once(scenario, monkeypatch):
    bus, announced = LocalBus(), []
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    scenario = msgspec.structs.replace(scenario, services=("target",), robots=robots)
    announce_readiness(bus, "target", "one", scenario)
    assert not bus.presence.names
    monkeypatch.setattr(bus, "declare_alive", lambda *name: announced.append(name))
    for _ in range(2):
        bus.presence.update("two/target", alive=True)
    assert announced == [("target/ready", "one")]


def test_names_that_no_scenario_has_are_not_noted_even_after_they_have_gone(scenario):
    bus, told = LocalBus(), []
    scenario = msgspec.structs.replace(scenario, services=("controller", "target"))
    announce_readiness(bus, "controller", "", scenario)
    bus.presence.on_change.append(lambda: told.append(1))
    for name in ("stranger", "target/more", "two/target", "target/every", "viewer", "record/every"):
        for alive in (True, False, True):
            bus.presence.update(name, alive=alive)
    assert bus.presence.names == bus.presence.returns.keys()
    assert bus.presence.names == {"target/every", "viewer", "record/every"}
    assert len(told) == 9
