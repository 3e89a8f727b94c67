"""The same robot in other engines, and what all of them are measured by."""

import math
import subprocess
from collections.abc import Sequence
from contextlib import closing

import pytest
from mecazen.errors import MecazenError
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen_bench import gazebo_peer, physics
from mecazen_bench.engine import (
    Body,
    Engine,
    Sample,
    measure_accuracy,
    measure_slide,
    slippery,
)
from mecazen_bench.gazebo_peer import GazeboEngine
from mecazen_bench.stack import robot
from mecazen_controller.kinematics import MecanumKinematics, WheelSpeeds

STEP_S = 0.001
needs_gazebo = pytest.mark.skipif(
    not gazebo_peer.PROGRAM.exists(), reason="Gazebo's physics is not built: make gazebo"
)


@pytest.mark.parametrize("rollers", physics.ROLLERS)
@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_is_smooth_and_has_the_predicted_gains(name, rollers, figures):
    engine = physics.DartEngine(robot(name), STEP_S, rollers)
    (row,) = figures([physics.measure("Physics", [engine], blocks=2)]).values()
    accuracy = ["ripple % of R", "forward", "lateral", "lateral / predicted", "yaw / predicted"]
    assert all(row[title].met for title in accuracy)
    # a smooth wheel loses nothing; rollers that are hulls of spheres cost some percent
    assert -10.0 < row["energy %/s"].value < 0.5


def test_the_same_robot_drives_alike_in_mujoco():
    pytest.importorskip("mujoco", reason="MuJoCo, the bench's peer, is not installed")
    from mecazen_bench.mujoco_peer import MujocoEngine

    for shape in gazebo_peer.SHAPES:
        found = measure_accuracy(MujocoEngine(robot("nexus"), STEP_S, shape))
        # its contacts are soft and its capsules are not barrels: some percent off
        assert found.forward == pytest.approx(1.0, abs=0.1)
        assert found.lateral == pytest.approx(1.0, abs=0.1)
        assert found.yaw == pytest.approx(1.0, abs=0.1)
        assert 0.0 < found.ripple < 0.003
        assert -1.0 < found.energy < 0.0


def test_with_locked_wheels_our_robot_slows_down_as_coulomb_says_at_every_yaw():
    engine = physics.DartEngine(slippery(robot("nexus")), STEP_S, "near")
    slides = measure_slide(engine)
    assert list(slides) == [0.0, 22.5, 45.0]
    # where left and right wheels stand on rollers at other angles, it is pushed aside a little
    assert list(slides.values()) == pytest.approx([1.0] * 3, abs=0.015)


@needs_gazebo
@pytest.mark.parametrize("shape", gazebo_peer.SHAPES)
def test_the_same_robot_drives_in_gazebos_physics_and_the_same_twice(shape):
    ways = []
    for _ in range(2):
        with closing(GazeboEngine(robot("nexus"), STEP_S, shape)) as engine:
            driven = engine.advance([6.0] * len(WHEELS), 300)
            ways.append([driven, engine.advance(None, 20)])
            assert engine.spent_s > 0.0
    # 6 rad/s on wheels of 5 cm for 0.3 s; it slips and judders at the start
    assert driven.x == pytest.approx(6.0 * 0.05 * 0.3, rel=0.15)
    assert driven.wheels == pytest.approx([6.0 * 0.3] * len(WHEELS), rel=0.1)
    assert ways[0][1].x > driven.x
    assert ways[0] == ways[1]


@needs_gazebo
def test_gazebos_program_says_what_it_does_not_understand(capfd):
    with (
        closing(GazeboEngine(robot("nexus"), STEP_S, "capsule")) as engine,
        pytest.raises(MecazenError, match="gazebo-peer has ended with 1"),
    ):
        engine.advance(["fast"], 1)
    assert capfd.readouterr().err == "gazebo-peer: not understood: drive fast 1\n"


@needs_gazebo
def test_gazebos_program_says_how_it_is_used():
    done = subprocess.run([gazebo_peer.PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "usage" in done.stderr


def test_engines_that_are_not_here_are_left_out_and_one_line_says_so(monkeypatch):
    monkeypatch.setattr(gazebo_peer, "PROGRAM", gazebo_peer.PROGRAM.with_name("not-built"))
    with physics.peers([robot("nexus")]) as (engines, missing):
        assert not any("Gazebo" in engine.name for engine in engines)
        assert sum("Gazebo" in line for line in missing) == 1


def test_a_body_has_the_energy_of_its_motion():
    body = Body(mass=2.0, yaw_inertia=0.5, wheel_inertia=0.01)
    before = Sample(0.0, 0.0, 0.0, 3.1, (0.0, 0.0, 0.0, 0.0))
    # 1 m/s, 0.2 rad/s through ±π, and 10, 10, 0, -10 rad/s, over 0.5 s
    after = Sample(0.3, 0.4, 0.0, 3.2 - 2.0 * math.pi, (5.0, 5.0, 0.0, -5.0))
    expected = 0.5 * 2.0 * 1.0 + 0.5 * 0.5 * 0.2**2 + 0.5 * 0.01 * 300.0
    # rounding of the difference of two angles
    assert body.energy(before, after, 0.5) == pytest.approx(expected, rel=1e-12)


def test_a_robot_has_the_mass_and_the_inertia_of_its_parts():
    nexus = robot("nexus")
    body = Body.of(nexus)
    parts = nexus.base.mass_kg + nexus.camera.mass_kg + nexus.lidar.mass_kg
    wheel = nexus.wheels.hub_mass_kg + nexus.rollers.count * nexus.rollers.mass_kg
    assert body.mass == pytest.approx(parts + 4 * wheel)
    # the hub as a solid cylinder, the rollers between points at their distance and at the rim
    radius, thick = nexus.wheels.radius_m, nexus.rollers.max_radius_m
    hub = nexus.wheels.hub_mass_kg * (radius - 2 * thick) ** 2 / 2
    rollers = nexus.rollers.count * nexus.rollers.mass_kg
    assert hub + rollers * (radius - thick) ** 2 < body.wheel_inertia < hub + rollers * radius**2
    # wheels as points, and the base as a box, are most of what turns with the robot
    points = 4 * wheel * (nexus.half_wheelbase**2 + nexus.half_track**2)
    box = nexus.base.mass_kg * (nexus.base.length_m**2 + nexus.base.width_m**2) / 12
    assert points + box < body.yaw_inertia < 1.1 * (points + box)


class Ideal(Engine):
    """A robot by the ideal equations, whose wheels coast on for ever or slow down."""

    def __init__(self, slowing: float = 0.0) -> None:
        super().__init__("ideal", robot("nexus"), STEP_S)
        sizes = self.robot.wheels.radius_m, self.robot.half_wheelbase, self.robot.half_track
        self._kinematics = MecanumKinematics(*sizes)
        self._slowing = slowing
        self._speeds = self._angles = [0.0] * len(WHEELS)
        self._pose = Pose2D()

    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        self.spent_s += 20e-6 * steps
        for _ in range(steps):
            coasting = [speed * (1.0 - self._slowing * STEP_S) for speed in self._speeds]
            self._speeds = coasting if speeds is None else list(speeds)
            twist = self._kinematics.forward(WheelSpeeds(*self._speeds))
            self._pose = self._pose.integrate(twist, STEP_S)
            moved = zip(self._angles, self._speeds, strict=True)
            self._angles = [angle + speed * STEP_S for angle, speed in moved]
        x, y, yaw = self._pose
        return Sample(x, y, 0.0, yaw, self._angles)


@pytest.mark.parametrize("slowing", [0.0, 0.1])
def test_an_ideal_robot_has_gains_of_one_and_loses_what_slows_it(slowing):
    found = measure_accuracy(Ideal(slowing))
    # sums of thousands of steps
    assert found[1:4] == pytest.approx((1.0, 1.0, 1.0), rel=1e-9)
    assert found.ripple == 0.0
    # v² falls by twice its rate, from the middle of one passage to that of another 1 s later
    assert found.energy == pytest.approx(math.exp(-2.0 * slowing) - 1.0, abs=1e-4)


def test_a_step_of_1_ms_that_takes_20_us_is_50_times_real_time():
    ((subject, row),) = physics.measure("Physics", [Ideal()], blocks=2).rows.items()
    assert subject == "nexus 1 ms ideal"
    # sums of thousands of steps
    assert row["µs/step"].value == pytest.approx(20.0, rel=1e-9)
    assert row["× real time"].value == pytest.approx(50.0, rel=1e-9)


def test_our_largest_step_is_measured_by_the_capsules_of_mujoco():
    class Named(Ideal):
        def __init__(self, name: str, dt_s: float) -> None:
            super().__init__()
            self.name, self.dt_s = name, dt_s

    engines = [Named(physics.PEER, 0.001), Named("mecazen, near rollers", 0.001)]
    peer, ours = physics.measure("Physics", engines, blocks=1).rows.values()
    assert peer["of MuJoCo"].value == 1.0
    # both take 20 us a step
    assert ours["of MuJoCo"].value == pytest.approx(1.0, rel=1e-9)
