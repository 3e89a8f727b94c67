"""The motors between an emulated board and the physics."""

import pytest
from harness import SCENARIOS
from mecazen_hardware.emulator.world import BREAK_AWAY_V, EmulatedWorld, load, motor_torque


def test_a_motor_stands_until_the_voltage_breaks_it_away():
    assert motor_torque(BREAK_AWAY_V - 0.1, 0.0)[0] == 0.0
    assert motor_torque(BREAK_AWAY_V + 0.1, 0.0)[0] > 0.0
    assert motor_torque(-BREAK_AWAY_V - 0.1, 0.0)[0] < 0.0


def test_a_motor_has_the_stall_torque_and_the_free_speed_of_its_data_sheet():
    stall, current = motor_torque(12.0, 0.0)
    assert stall + 3.3 * 0.157 / 4.5 == pytest.approx(0.42, abs=0.01)  # without friction
    assert current == pytest.approx(2.7, abs=0.1)  # from 2.4 to 3 A
    assert motor_torque(12.0, 30.0)[0] < 0.0 < motor_torque(12.0, 20.0)[0]


def test_a_motor_without_supply_coasts_and_a_short_circuit_brakes_harder():
    assert motor_torque(0.0, 20.0)[0] < motor_torque(None, 20.0)[0] < 0.0


def test_the_world_has_no_services_of_a_robot_and_the_robot_of_the_board():
    scenario = load(SCENARIOS / "back.toml", ())
    assert scenario.services == ("physics", "target")
    assert (scenario.robot.name, scenario.sensor.frame) == ("rosmaster_x3", "base_link")
    fused = load(SCENARIOS / "back.toml", ("sensor.kind=fused",))
    assert set(fused.services) == {"physics", "target", "sensors"}


def test_a_duty_drives_the_robot_in_physics_and_costs_voltage():
    world = EmulatedWorld(load(SCENARIOS / "back.toml", ("start.x_m=-3.0",)))
    world.begin()
    for _ in range(100):
        world.step([0.7, 0.7, 0.7, 0.7])
    seen = world.sense()
    world.close()
    assert min(seen.angles) > 2.0
    assert max(seen.angles) - min(seen.angles) < 0.1
    assert 11.0 < seen.volts < 12.0
    assert seen.accel[2] == pytest.approx(9.81, abs=1.0)
