"""Engines on the same manoeuvres, against hand calculations; how fast they are, is not tested."""

import math
from collections.abc import Sequence
from contextlib import closing

import pytest
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS
from mecazen.rollers import lateral_gain
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_bench import gazebo_peer, physics
from mecazen_bench.engine import Engine, RobotPose, measure_accuracy
from mecazen_bench.gazebo_peer import GazeboEngine
from mecazen_bench.physics import robot

needs_gazebo = pytest.mark.skipif(
    not gazebo_peer.PROGRAM.exists(), reason="Gazebo's physics is not built: make gazebo"
)


class Ideal(Engine):
    """A robot by the ideal equations, whose wheels coast on for ever or slow down."""

    def __init__(self, name="ideal", dt_s=0.001, *, gain=1.0, step_s=20e-6, slowing=0.0) -> None:
        super().__init__(name, robot("nexus"), dt_s)
        sizes = self.robot.wheels.radius_m, self.robot.half_wheelbase, self.robot.half_track
        self._kinematics = MecanumKinematics(*sizes)
        self._gain, self._step_s, self._slowing = gain, step_s, slowing
        self._speeds = self._angles = [0.0] * len(WHEELS)
        self._pose = Pose2D()

    def advance(self, speeds: Sequence[float] | None, steps: int) -> RobotPose:
        self.spent_s += self._step_s * steps
        for _ in range(steps):
            coasting = [speed * (1.0 - self._slowing * self.dt_s) for speed in self._speeds]
            self._speeds = coasting if speeds is None else list(speeds)
            twist = self._kinematics.forward(WheelSpeeds(*self._speeds))
            twist = twist._replace(x=self._gain * twist.x)
            self._pose = self._pose.integrate(twist, self.dt_s)
            moved = zip(self._angles, self._speeds, strict=True)
            self._angles = [angle + speed * self.dt_s for angle, speed in moved]
        x, y, yaw = self._pose
        return RobotPose(x, y, yaw, self._angles)


@pytest.mark.parametrize("slowing", [0.0, 0.1])
def test_an_ideal_robot_has_gains_of_one_and_loses_the_energy_that_slows_it(slowing):
    accuracy = measure_accuracy(Ideal(slowing=slowing))
    # sums of thousands of steps
    assert accuracy.forward == pytest.approx(1.0, rel=1e-9)
    gain = lateral_gain(robot("nexus").rollers.count)
    assert accuracy.lateral * gain == pytest.approx(1.0, rel=1e-9)
    # v² falls by twice its rate, from the middle of one passage to that of another 1 s later
    assert accuracy.energy == pytest.approx(math.exp(-2.0 * slowing) - 1.0, abs=1e-4)


def test_engines_are_compared_at_equal_steps_and_at_equal_error():
    # forward is off by 20 %, far more than the ideal equations differ from rollers
    engines = [
        Ideal(physics.OURS, 0.001),
        Ideal(physics.OURS, 0.005),
        Ideal(physics.OURS, 0.01, gain=1.3, step_s=1e-6),
        Ideal("peer", 0.001, gain=1.2, step_s=10e-6),
        Ideal("exact", 0.002, gain=1.0, step_s=20e-6),
    ]
    rows = physics.measure(engines, blocks=2)
    assert next(iter(rows)) == "1 ms mecazen"
    # a step of 1 ms that takes 20 µs is 50 times real time; sums of thousands of steps
    assert rows["1 ms mecazen"]["µs/step"][0] == pytest.approx(20.0, rel=1e-9)
    assert rows["1 ms mecazen"]["× real time"][0] == pytest.approx(50.0, rel=1e-9)
    assert physics.EQUAL_STEP not in rows["1 ms mecazen"]
    peer, exact = rows["1 ms peer"], rows["2 ms exact"]
    assert peer["largest error %"][0] == pytest.approx(20.0)
    assert peer[physics.EQUAL_STEP][0] == pytest.approx(100 / 50)
    assert peer[physics.EQUAL_ERROR][0] == pytest.approx(100 / 250)  # ours at 5 ms is as accurate
    assert physics.EQUAL_STEP not in exact  # ours has no such step


@pytest.mark.parametrize("name", physics.ROBOTS)
def test_our_physics_has_the_predicted_gains(name):
    (row,) = physics.measure([physics.DartEngine(robot(name), 0.005)], blocks=1).values()
    # the prediction leaves out the mass of rollers and the slip of a front axle that swings
    assert row["largest error %"][0] < 1.0
    # a smooth wheel loses nothing; rollers that are hulls of spheres cost some percent
    assert -10.0 < row["energy %/s"][0] < 0.5


def test_the_same_robot_drives_alike_in_mujoco():
    pytest.importorskip("mujoco", reason="MuJoCo, the bench's peer, is not installed")
    from mecazen_bench.mujoco_peer import MujocoEngine

    accuracy = measure_accuracy(MujocoEngine(robot("nexus"), 0.001, "capsule", "default"))
    # its contacts are soft and its capsules are not barrels: some percent off
    assert accuracy[:3] == pytest.approx((1.0, 1.0, 1.0), abs=0.1)
    assert -1.0 < accuracy.energy < 0.0


@needs_gazebo
@pytest.mark.parametrize("shape", gazebo_peer.SHAPES)
def test_the_same_robot_drives_in_gazebos_physics_and_the_same_twice(shape):
    drives = []
    for _ in range(2):
        with closing(GazeboEngine(robot("nexus"), 0.001, shape)) as engine:
            driven = engine.advance([6.0] * len(WHEELS), 300)
            drives.append([driven, engine.advance(None, 20)])
            assert engine.spent_s > 0.0
    # 6 rad/s on wheels of 5 cm for 0.3 s; it slips and judders at the start
    assert driven.x == pytest.approx(6.0 * 0.05 * 0.3, rel=0.15)
    assert driven.wheels == pytest.approx([6.0 * 0.3] * len(WHEELS), rel=0.1)
    assert drives[0][1].x > driven.x
    assert drives[0] == drives[1]
