"""Motors that are planted in a simulated robot come out of its recording."""

from __future__ import annotations

import os
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from mecazen.config import ControllerConfig
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, scenario_path
from mecazen.robot import WHEELS, RealMotors
from mecazen_experiments.identify.commands import identify as identify_command
from mecazen_experiments.identify.commands import read, write_plan
from mecazen_experiments.identify.motors import (
    NAMES,
    MotorLog,
    identified_motors,
    identify_motors,
    response,
)
from mecazen_experiments.identify.plan import FASTEST, csv, plan
from mecazen_physics.motors import MotorModel
from mecazen_tools.simulation import Simulation

SEEDS = range(1, 1 + int(os.environ.get("MECAZEN_SEEDS", "2")))
"""All of docs/validation.md: MECAZEN_SEEDS=20."""
TICK_S = 0.01
STEPS = plan(ControllerConfig())


def planted(seed):
    """Return motors of a hidden robot."""
    random = np.random.default_rng(seed)
    gains = random.uniform(0.98, 1.02, 4).tolist()
    return RealMotors(
        delay_s=random.uniform(0.005, 0.06),
        time_constant_s=random.uniform(0.03, 0.12),
        dead_band_rad_s=random.uniform(0.2, 0.6),
        gains=(gains[0], gains[1], gains[2], gains[3]),
        coulomb_nm=random.uniform(0.05, 0.15),
        viscous_nms=random.uniform(0.004, 0.01),
        sag_per_nm=random.uniform(0.0, 0.03),
    )


def driven(seed, file):
    """Record a minute of the excitation; the robot differs from its file in size as well."""
    random, motors = np.random.default_rng(1000 + seed), planted(seed)
    scenario = load_scenario(
        scenario_path("teleop"),
        {
            "sensor.also": [],
            "start.x_m": -5.0,
            "physics.dt_s": 0.002,
            "sensors.encoders.counts_per_turn": 4096,
            "sim.duration_s": STEPS[-1].time_s,
            "seed": seed,
            "robot.wheels.radius_m": 0.05 * random.uniform(0.98, 1.02),
            "robot.wheels.track_m": 0.3 * random.uniform(0.97, 1.03),
            "robot.rollers.count": random.integers(8, 13),
        },
    )
    robot = msgspec.structs.replace(scenario.robot, motors=motors)
    scenario = msgspec.structs.replace(scenario, robot=robot)
    with Simulation(scenario, record=file) as simulation:
        for step, after in pairwise(STEPS):
            simulation.command(vx=step.vx_m_s, vy=step.vy_m_s, wz=step.wz_rad_s)
            simulation.run(after.time_s - step.time_s - (TICK_S if after is STEPS[-1] else 0.0))
    return motors


def simulated(motors, commands):
    """Return the speeds at the end of each tick, by the model of the simulation."""
    model = MotorModel(motors, TICK_S)
    speeds = []
    for command in commands:
        model.give(command)
        speeds.append(model.step(1.0))
    return np.array(speeds)


def values_of(motors):
    return np.array(
        [motors.delay_s, motors.time_constant_s, motors.dead_band_rad_s, 0.0, *motors.gains]
    )


def test_the_response_of_the_fit_is_that_of_the_simulation():
    motors = RealMotors(
        delay_s=0.0234, time_constant_s=0.07, dead_band_rad_s=0.4, gains=(1, 2, 1, 1)
    )
    commands = np.random.default_rng(1).normal(0.0, 3.0, (200, 4)).cumsum(axis=0)
    log = MotorLog(TICK_S, commands, commands, None)
    ends, _ = response(values_of(motors), log)
    assert ends == pytest.approx(simulated(motors, commands), abs=1e-9)


def test_the_mean_speed_is_the_integral_of_the_response():
    motors = RealMotors(delay_s=0.0234, time_constant_s=0.07)
    commands = np.repeat(np.random.default_rng(1).normal(0.0, 3.0, (20, 4)), 100, axis=0)
    fine = MotorLog(TICK_S / 100, commands, commands, None)
    coarse = MotorLog(TICK_S, commands[::100], commands[::100], None)
    ends, _ = response(values_of(motors), fine)
    _, means = response(values_of(motors), coarse)
    # a sum of 100 ends of a step of 0.1 ms for the integral
    assert means == pytest.approx(ends.reshape(20, 100, 4).mean(axis=1), abs=0.02)


def test_motors_without_efforts_have_neither_friction_nor_sag():
    motors = RealMotors(delay_s=0.03, time_constant_s=0.08, dead_band_rad_s=0.3)
    commands = np.repeat(np.random.default_rng(1).normal(0.0, 3.0, (60, 4)), 20, axis=0)
    _, means = response(values_of(motors), MotorLog(TICK_S, commands, commands, None))
    found, lines = identify_motors([MotorLog(TICK_S, commands, means, None)])
    assert lines == ()
    assert set(found) == {*NAMES} - {"sag_per_nm"}
    again = identified_motors(found)
    assert (again.delay_s, again.time_constant_s, again.dead_band_rad_s) == pytest.approx(
        (0.03, 0.08, 0.3), rel=1e-3
    )


def test_what_a_single_command_leaves_open_is_named():
    command = np.full((500, 4), 3.0)
    _, lines = identify_motors([MotorLog(TICK_S, command, command, None)])
    assert "dead_band_rad_s" in " ".join(lines)
    _, lines = identify_motors([MotorLog(TICK_S, 0.0 * command, 0.0 * command, None)])
    assert len(lines) == len(NAMES) - 1


@pytest.mark.parametrize("seed", SEEDS)
def test_planted_motors_come_out_of_a_recording(seed, tmp_path):
    motors = driven(seed, tmp_path / "drive.mcap")
    _, logs = read([tmp_path / "drive.mcap"])
    found = {name: one.value for name, one in identify_motors(logs)[0].items()}
    # DART moves a wheel by its speed at the end of a step: half a step of 2 ms early
    assert found["delay_s"] == pytest.approx(motors.delay_s, abs=0.002)
    assert found["time_constant_s"] == pytest.approx(motors.time_constant_s, rel=0.05)
    assert found["dead_band_rad_s"] == pytest.approx(motors.dead_band_rad_s, rel=0.1)
    assert found["sag_per_nm"] == pytest.approx(motors.sag_per_nm, abs=0.003)
    gains = [found[f"gain of {wheel}"] for wheel in WHEELS]
    assert gains == pytest.approx(motors.gains, rel=0.005)
    # friction at the mean speed of the excitation, and each part of it
    middle = 4.0
    assert found["coulomb_nm"] + middle * found["viscous_nms"] == pytest.approx(
        motors.coulomb_nm + middle * motors.viscous_nms, rel=0.1
    )
    assert found["coulomb_nm"] == pytest.approx(motors.coulomb_nm, rel=0.1)


def test_a_recording_gives_a_robot_file_with_motors(tmp_path):
    driven(1, tmp_path / "drive.mcap")
    identify_command([tmp_path / "drive.mcap"], None, "nexus", (), tmp_path / "out")
    report = (tmp_path / "out" / "report.md").read_text()
    assert "## Motors" in report
    (tmp_path / "scenario.toml").write_text('robot = "out/robot.toml"\n')
    robot = load_scenario(tmp_path / "scenario.toml").robot
    assert robot.motors is not None
    assert robot.motors.delay_s == pytest.approx(planted(1).delay_s, abs=0.002)


def test_the_plan_lasts_a_minute_ends_at_rest_and_stays_within_limits(tmp_path):
    assert 55.0 < STEPS[-1].time_s < 65.0
    assert STEPS[-1][1:] == (0.0, 0.0, 0.0)
    speeds = np.abs([step[1:] for step in STEPS])
    assert np.all(speeds <= FASTEST)
    write_plan(tmp_path / "plan.csv")
    assert (tmp_path / "plan.csv").read_text() == csv(STEPS)
    assert csv(STEPS).startswith("time_s,vx_m_s,vy_m_s,wz_rad_s\n0,0.5,0,0\n1.5,-0.5,0,0\n")


def test_a_recording_without_wheels_is_refused(tmp_path):
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(MecazenError, match=r"empty\.mcap: not an MCAP file"):
        read([tmp_path / "empty.mcap"])
