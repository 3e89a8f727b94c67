"""The robot with the rollers near the ground as bodies is the robot with all of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from mecazen.config.world import Box
from mecazen.robot import Robot
from mecazen.rollers import Roller
from mecazen_physics import motors
from mecazen_physics import robot as robot_module
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.near_rollers import NearRollersBody
from mecazen_physics.state import BASE_DOFS, Motion, RobotState
from msgspec.structs import replace
from physics_rig import Rig, after_mixed_driving

MIXED = (
    (8.0, 8.0, 8.0, 8.0),  # straight
    (-8.0, 8.0, 8.0, -8.0),  # strafe
    (-6.0, 6.0, -6.0, 6.0),  # spin
    (9.0, 2.0, 2.0, 9.0),  # diagonal
    (-7.0, -7.0, -7.0, -7.0),  # back
    (3.0, -6.0, 2.0, 5.0),  # all at once
    (0.0, 0.0, 0.0, 0.0),
)
"""Wheel speeds [rad/s], each for 1.5 s with ramps of 0.4 s."""

FIELDS = ("position", "orientation", "joint_position", "joint_effort", "joint_velocity")


def commands(seconds: float) -> Iterator[list[float]]:
    """Wheel speeds of each tick [rad/s]."""
    for tick in range(round(seconds * 100)):
        part, within = divmod(tick, 150)
        ramp = min(1.0, within / 40, (150 - within) / 40)
        yield [ramp * speed for speed in MIXED[part % len(MIXED)]]


def drive(rig: Rig, seconds: float, steps: int = 10, dt: float = 0.001) -> list[RobotState]:
    """The states at every tick, simulated in advances of `steps` steps."""
    states = []
    for command in commands(seconds):
        for _ in range(round(0.01 / dt) // steps):
            state = rig.advance(command, steps)
        states.append(state)
    return states


def rms(values: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


class Difference:
    """How far two series of states are apart: the largest [m, rad], or by RMS, relative."""

    def __init__(self, one: list[RobotState], other: list[RobotState]) -> None:
        a, b = ({n: np.array([getattr(x, n) for x in s]) for n in FIELDS} for s in (one, other))
        off = {name: a[name] - b[name] for name in FIELDS}
        cosine = np.abs(np.sum(a["orientation"] * b["orientation"], axis=1))
        self.position = np.abs(off["position"]).max()
        self.angle = 2.0 * np.arccos(np.minimum(cosine, 1.0)).max()
        self.wheels = np.abs(off["joint_position"][:, :4]).max()
        self.torque = rms(off["joint_effort"][:, :4]) / rms(a["joint_effort"][:, :4])
        self.spin = rms(off["joint_velocity"][:, 4:]) / rms(a["joint_velocity"][:, 4:])


def difference(robot: Robot, seconds: float, steps: int, **settings: Any) -> Difference:
    """Between the robot of all rollers and the one of those near the ground."""
    dt = settings.get("dt_s", 0.001)
    models = (Rig(robot, rollers=rollers, **settings) for rollers in ("all", "near"))
    return Difference(*(drive(rig, seconds, steps, dt) for rig in models))


@pytest.mark.parametrize(
    ("settings", "seconds", "steps"),
    [
        ({}, 30.0, 1),
        ({"dt_s": 0.002}, 10.5, 1),
        ({"ground_friction": 0.3}, 10.5, 1),
        ({"slope_deg": 4.0, "slope_heading_deg": 30.0}, 10.5, 1),
        ({}, 60.0, 10),
    ],
)
def test_it_is_the_robot_with_every_roller_step_by_step_and_tick_by_tick(
    nexus, settings, seconds, steps
):
    found = difference(nexus, seconds, steps, **settings)
    # Asked are 2 mm, 0.2 degrees and 1 %. In half a minute it stays below 1 um, step by step, and
    # in a minute below 17 um, tick by tick: an airborne roller's push on its wheel changes within
    # a tick.
    assert found.position < 5e-5
    assert found.angle < math.radians(0.01)
    assert found.wheels < 1e-4
    assert found.torque < 0.01
    assert found.spin < 0.01


def test_tick_by_tick_with_torques_it_moves_as_the_robot_with_every_roller(nexus):
    found = difference(nexus, 4.5, 10, drive="effort")
    # A controller of torques lets a contact come a step sooner or later, and so it does for a
    # wheel turned by 1e-8 rad: positions differ by some 0.01 mm each time. 2 mm are asked.
    assert found.position < 1e-3
    assert found.angle < math.radians(0.1)


def test_no_step_of_an_isolated_robot_exceeds_the_motors_torque(nexus):
    rig = Rig(nexus, dt_s=0.005)
    step, torques = rig.body.scene.step, []

    def noted(reset: bool) -> None:
        step(reset)
        torques.extend(rig.body.torques())

    rig.body.scene.step = noted
    drive(rig, 15.0, 2, 0.005)
    assert len(torques) == 4 * 3_000
    # a servo's, to the solver's rounding
    assert max(map(abs, torques)) <= nexus.wheels.max_torque_nm * (1.0 + 1e-9)


def test_motors_simulated_without_their_limit_move_the_robot_as_with_it(nexus, monkeypatch):
    found = drive(Rig(nexus), 15.0)
    monkeypatch.setattr(motors, "TORQUE_HEADROOM", 0.0)
    strict = Difference(drive(Rig(nexus), 15.0), found)
    # A ramp within the headroom and a jump at the limit reach a speed at other times within a
    # chunk, after many turns of hard ramps.
    assert strict.wheels < 0.02
    assert strict.position < 0.02
    assert strict.angle < math.radians(1.0)


def test_it_bumps_against_a_box_and_comes_free_as_with_every_roller(nexus):
    box = Box(size_m=(0.2, 0.3, 0.5), position_m=(1.4, 0.0))
    bumped, ends = [], []
    for rollers in ("all", "near"):
        rig = Rig(nexus, rollers=rollers, obstacles=(box,))
        for tick, speed in enumerate([8.0] * 310 + [-8.0] * 200):
            state = rig.advance([speed] * 4)
            if tick == 309:
                bumped.append(state)
        ends.append(state)
    # The box's face is at 1.3 m, the wheels' 0.2 m ahead; 0.5 mm: skidding wheels shake it.
    for state in bumped:
        assert state.position[0] == pytest.approx(1.1, abs=5e-4)
    for state in ends:
        assert state.linear[0] == pytest.approx(-0.4, abs=0.02)


def energy(rig: Rig, robot: Robot) -> float:
    """Kinetic energy, with that of the spins which the bodies have no part in [J]."""
    total = float(rig.body.skeleton.computeKineticEnergy())
    if isinstance(rig.body, NearRollersBody):
        _, spins, carried = rig.body.airborne.places[:, :, 1:-1]
        total += 0.5 * Roller.from_robot(robot).inertia[1] * float(np.sum((spins + carried) ** 2))
    return total


def test_a_hand_over_changes_neither_energy_nor_motion(robot):
    rig = after_mixed_driving(robot)
    pitch = math.tau / robot.rollers.count
    position, velocity, heading = rig.body.read()
    position[BASE_DOFS : BASE_DOFS + 4] = (pitch - 1e-3, 1e-3, 3.0 * pitch - 1e-3, 1e-3 - pitch)
    rig.body.write(Motion(position, velocity, heading))
    before = energy(rig, robot)
    fastest = robot.wheels.max_speed_rad_s
    forward, backward = (0.0, fastest), (-fastest, 0.0)
    rig.body.prepare([forward, backward, forward, backward], 10)
    # Each joint has turned by a pitch, but not its wheel.
    turned = [wheel.getPosition(0) for wheel in rig.body.wheels]
    assert turned == pytest.approx([-1e-3, pitch + 1e-3] * 2, abs=1e-12)
    assert rig.body.read().position == pytest.approx(position, abs=1e-12)
    assert rig.body.read().velocity == pytest.approx(velocity, abs=1e-12)
    # 1e-6: the axle's angle is left out of the spins.
    assert energy(rig, robot) == pytest.approx(before, rel=1e-6)


def test_it_has_the_energy_of_the_robot_with_every_roller(robot):
    near, everything = after_mixed_driving(robot), Rig(robot, rollers="all")
    everything.body.write(near.body.read())
    # The same masses with the same velocities. 1e-6: as above.
    assert energy(near, robot) == pytest.approx(energy(everything, robot), rel=1e-6)


def test_the_motion_passes_to_every_roller_and_back(nexus, monkeypatch):
    rig = after_mixed_driving(nexus)
    before = rig.body.read()
    with monkeypatch.context() as leaning:
        leaning.setattr(robot_module, "MAX_TILT_RAD", -1.0)
        rig.robot.look_around()
    assert not isinstance(rig.body, NearRollersBody)
    among_others = rig.body.read()
    assert among_others.heading == 0.0
    rig.robot.look_around()
    assert isinstance(rig.body, NearRollersBody)
    # the wheels' angles less whole pitches and back, and other axes: rounding
    for after in (among_others, rig.body.read()):
        assert_same(after, before)


def assert_same(one: Motion, other: Motion) -> None:
    """Two motions are the same, to rounding."""
    for a, b in zip(one.in_axes_at(0.0)[:2], other.in_axes_at(0.0)[:2], strict=True):
        assert a == pytest.approx(b, abs=1e-12)


def test_rollers_too_many_for_the_fastest_wheel_are_refused(nexus):
    robot = replace(nexus, rollers=replace(nexus.rollers, count=20))
    with pytest.raises(UnsupportedError, match="fewer than 20 rollers"):
        Rig(robot)
    Rig(robot, rollers="all")
