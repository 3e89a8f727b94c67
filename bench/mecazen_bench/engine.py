"""Manoeuvres that all engines drive in the same way, and their measurements."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
from mecazen.geometry import Twist2D
from mecazen.links import RobotLink, base_link, lump, robot_links
from mecazen.portable import legendre, tan
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_physics.world import GRAVITY

RIM_SPEED = 0.3
"""Speed of the wheels' rims in the manoeuvres [m/s]."""
RAMP_S, SETTLE_S = 0.3, 0.5
"""Time to reach `RIM_SPEED`, and for the transient to decay."""
PASSAGES = 16
"""Number of rollers that pass below each wheel while a manoeuvre is measured."""
TICK_S = 0.01
"""Control period: in the timed runs an engine reports its state this often."""
BLOCK_S = 0.25
"""Simulated time of one timed block."""
COAST_S = 1.0
"""Time without motor torque between two measurements of the energy."""
SLIDE_M_S, SLIDE_RAMP_S = 0.5, 1.0
"""Speed at which the wheels are locked, and the time to reach it without slip."""
SLIDE_FRICTION = 0.2
SLIDE_YAWS_DEG = 0.0, 22.5, 45.0

FORWARD = (1.0, 1.0, 1.0, 1.0)
LATERAL = (-1.0, 1.0, 1.0, -1.0)
YAW = (-1.0, 1.0, -1.0, 1.0)
MIXED = (0.1, 1.0, 0.6, 0.5)
"""Directions of the wheels in the order of `WHEELS`; the last moves along all axes at once."""


class Sample(NamedTuple):
    """Pose of the robot: base_link's origin in world [m], its yaw, and the wheels' angles [rad]."""

    x: float
    y: float
    z: float
    yaw: float
    wheels: Sequence[float]

    @classmethod
    def of(
        cls, position: Sequence[float], quaternion: Sequence[float], wheels: Sequence[float]
    ) -> Sample:
        """Return the sample of a position (x, y, z) and an orientation (x, y, z, w)."""
        qx, qy, qz, qw = quaternion
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        x, y, z = position
        return cls(x, y, z, yaw, wheels)


class PlanarInertia(NamedTuple):
    """The inertia of a robot that moves in the plane.

    With v the speed of base_link, ψ̇ its yaw rate and ω the angular speed of each wheel,

        E = ½·m·v² + ½·J·ψ̇² + ½·I·Σω².

    Rollers turn with their wheel, but not about their own axes, as when the robot rolls straight
    on. Then no force does work, since the contact point has no velocity, and E is constant.
    """

    mass: float
    """Mass of the robot [kg]."""
    yaw_inertia: float
    """Moment of inertia of the robot about base_link's z axis [kg·m²]."""
    wheel_inertia: float
    """Moment of inertia of a wheel with its rollers about its axle [kg·m²]."""

    @classmethod
    def of(cls, robot: Robot) -> PlanarInertia:
        """Return the inertia of `robot`."""
        links = [base_link(robot), *robot_links(robot)]
        places = {"": (0.0, 0.0, 0.0)} | {link.name: link.translation for link in links}

        def in_base(link: RobotLink) -> RobotLink:
            x, y, z = np.add(places[link.parent], link.translation).tolist()
            return replace(link, translation=(x, y, z))

        mass, centre, inertia = lump([in_base(link) for link in links])
        hub, *rollers = (link for link in links if link.name.startswith(WHEELS[0]))
        _, _, wheel = lump([replace(hub, translation=(0.0, 0.0, 0.0)), *rollers])
        yaw_inertia = inertia[2, 2] + mass * (centre[:2] @ centre[:2])
        return cls(mass, float(yaw_inertia), float(wheel[1, 1]))

    def energy(self, before: Sample, after: Sample, duration: float) -> float:
        """Return the energy [J] at the mean speeds between two samples `duration` [s] apart."""
        distance = math.hypot(after.x - before.x, after.y - before.y)
        turn = math.remainder(after.yaw - before.yaw, 2.0 * math.pi)
        spins = np.subtract(after.wheels, before.wheels)
        squares = self.mass * distance**2 + self.yaw_inertia * turn**2
        return float(squares + self.wheel_inertia * (spins @ spins)) / (2.0 * duration**2)


class Engine(ABC):
    """A robot on flat ground, initially at rest, in some simulator."""

    def __init__(self, name: str, robot: Robot, dt_s: float) -> None:
        self.name = name
        self.robot = robot
        self.dt_s = dt_s
        self.spent_s = 0.0
        """Processor time of the engine's steps so far, without the benchmark code [s]."""

    @abstractmethod
    def advance(self, speeds: Sequence[float] | None, steps: int) -> Sample:
        """Simulate steps of `dt_s` at wheel speeds [rad/s]; None for motors without torque."""


class Accuracy(NamedTuple):
    """The accuracy with which an engine moves the robot.

    A gain is the measured motion divided by the motion of the ideal equations for the wheels'
    measured rotation, over whole passages of rollers.
    """

    ripple: float
    """Peak to peak height of base_link's origin while driving straight [m]."""
    forward: float
    lateral: float
    yaw: float
    energy: float
    """Relative gain of kinetic energy in a second of coasting; 0 on a smooth round wheel."""


def measure_accuracy(engine: Engine) -> Accuracy:
    """Drive forward and coast, drive sideways and turn on the spot."""
    # first, while the rollers of all wheels are in the same phase, as `yaw_gain` assumes
    yaw, ideal_yaw, _ = _steady(engine, YAW)
    forward, ideal_forward, heights = _steady(engine, FORWARD)
    energy = _coast(engine)
    lateral, ideal_lateral, _ = _steady(engine, LATERAL)
    return Accuracy(
        ripple=float(np.ptp(heights)),
        forward=math.hypot(*forward[:2]) / ideal_forward.x,
        lateral=math.hypot(*lateral[:2]) / ideal_lateral.y,
        yaw=yaw[2] / ideal_yaw.yaw,
        energy=energy,
    )


def slippery(robot: Robot) -> Robot:
    """Return the robot with rollers that slide easily and have frictionless bearings."""
    rollers = msgspec.structs.replace(
        robot.rollers, contact_friction=SLIDE_FRICTION, bearing_friction_nms=0.0
    )
    return msgspec.structs.replace(robot, rollers=rollers)


def measure_slide(engine: Engine) -> dict[float, float]:
    """Lock the wheels of a `slippery` robot at several yaw angles [deg].

    Returns:
        The deceleration divided by that of Coulomb's law, which is the same at every yaw.
    """
    return {yaw_deg: _slide(engine, math.radians(yaw_deg)) for yaw_deg in SLIDE_YAWS_DEG}


def measure_speed(engines: Sequence[Engine], blocks: int) -> list[list[float]]:
    """Return the processor time of a step [s], by engine and block.

    Blocks of all engines are interleaved, so that the load of other processes affects all equally.
    """
    for engine in engines:
        _reach(engine, MIXED)
    times: list[list[float]] = [[] for _ in engines]
    ticks = round(BLOCK_S / TICK_S)
    for _ in range(blocks):
        for engine, seconds in zip(engines, times, strict=True):
            steps, speeds = round(TICK_S / engine.dt_s), _speeds(engine.robot, MIXED)
            before = engine.spent_s
            for _ in range(ticks):
                engine.advance(speeds, steps)
            seconds.append((engine.spent_s - before) / (ticks * steps))
    return times


def _coast(engine: Engine) -> float:
    """Return the relative gain of energy of a coasting robot in a second.

    Speeds are means over the passage of a roller: otherwise the energy of a polygonal wheel would
    seem to change with the corner on the ground.
    """
    body = PlanarInertia.of(engine.robot)
    passage = 2.0 * math.pi / engine.robot.rollers.count
    steps = round(passage * engine.robot.wheels.radius_m / (RIM_SPEED * engine.dt_s))
    rest = round(COAST_S / engine.dt_s) - steps
    samples = [engine.advance(None, count) for count in (1, steps, rest, steps)]
    duration = steps * engine.dt_s
    before = body.energy(samples[0], samples[1], duration)
    after = body.energy(samples[2], samples[3], duration)
    return (after / before - 1.0) / COAST_S


def _slide(engine: Engine, yaw: float) -> float:
    """Turn to a yaw, drive straight on, lock the wheels; return the relative deceleration."""
    steps = round(TICK_S / engine.dt_s)
    while engine.advance(_speeds(engine.robot, YAW), steps).yaw < yaw:
        pass
    ramp = round(SLIDE_RAMP_S / TICK_S)
    for tick in range(ramp + 1):
        part = tick / ramp * SLIDE_M_S / RIM_SPEED
        engine.advance([part * speed for speed in _speeds(engine.robot, FORWARD)], steps)
    held = [0.0] * len(WHEELS)
    samples = [engine.advance(held, count * steps) for count in (5, 10, 10)]
    first, second = (math.dist(a[:2], b[:2]) for a, b in pairwise(samples))
    slower = (first - second) / (10 * TICK_S) ** 2
    return slower / _coulomb(engine.robot, samples[-1].wheels)


def _coulomb(robot: Robot, wheels: Sequence[float]) -> float:
    """Return the deceleration [m/s²] of a robot that slides straight on with locked wheels.

    A roller resists with μN only along its own axis. At the bottom, this axis is at the roller
    angle γ to the axle. After the wheel has turned by φ, the angle on the ground is tan γ' = tan
    γ·cos φ.
    """
    pitch = math.tau / robot.rollers.count
    angles = [
        math.atan(math.tan(robot.roller_angle) * math.cos(math.remainder(wheel, pitch)))
        for wheel in wheels
    ]
    return SLIDE_FRICTION * GRAVITY * sum(map(math.sin, angles)) / len(angles)


def _steady(engine: Engine, direction: Sequence[float]) -> tuple[list[float], Twist2D, list[float]]:
    """Drive steadily in a direction; return the displacement, the ideal one, and heights.

    The displacement is in x, y [m] and yaw [rad]. The ideal displacement follows from the ideal
    equations, in the robot's axes. Heights are those at each step [m].
    """
    _reach(engine, direction)
    robot = engine.robot
    speeds = _speeds(robot, direction)
    passage = 2.0 * math.pi / robot.rollers.count
    steps = round(PASSAGES * passage / (max(map(abs, speeds)) * engine.dt_s))
    samples = [engine.advance(speeds, 1) for _ in range(steps + 1)]
    poses = np.array([(s.x, s.y, s.yaw, *s.wheels) for s in samples])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moved: list[float] = (poses[-1] - poses[0]).tolist()
    return (
        moved[:3],
        MecanumKinematics.from_robot(robot).forward(WheelSpeeds(*moved[3:])),
        [s.z for s in samples],
    )


def _reach(engine: Engine, direction: Sequence[float]) -> None:
    """Bring the wheels through rest to a steady motion."""
    steps = round(TICK_S / engine.dt_s)
    for _ in range(round(SETTLE_S / TICK_S)):
        engine.advance([0.0] * len(WHEELS), steps)
    ramp = RAMP_S / TICK_S
    for tick in range(round((RAMP_S + SETTLE_S) / TICK_S)):
        part = min(1.0, tick / ramp)
        engine.advance([part * speed for speed in _speeds(engine.robot, direction)], steps)


def _speeds(robot: Robot, direction: Sequence[float]) -> list[float]:
    return [part * RIM_SPEED / robot.wheels.radius_m for part in direction]


def lateral_gain(robot: Robot) -> float:
    """Return the mean of v_y over its ideal value for pure lateral motion without slip.

    A roller resists only along its axis, so the wheel's contact point has no velocity along the
    horizontal part of that axis. When the wheel has turned its roller by θ from the bottom, the
    axis (±sin γ, cos γ, 0) has become (±sin γ·cos θ, cos γ, ∓sin γ·sin θ), so its effective angle
    has tan γ' = tan γ·cos θ and

        (v_x - ω·R)·tan γ·cos θ ± v_y = 0.

    The ideal equations have θ = 0. With v_x = 0 the gain is cos θ: it is 1 in a roller's
    middle, and its mean over the arc |θ| ≤ α = π/N is sin(α)/α.
    """
    arc = Roller.from_robot(robot).half_arc
    return float(np.sin(arc) / arc)


def yaw_gain(robot: Robot) -> float:
    """Return the mean of the yaw rate over its ideal value for turning on the spot.

    The derivation is that of `lateral_gain`, with the velocity of a wheel's centre (∓l_y, ±l_x)·ω_z
    and the contact's offset along the axle, e = d·tan θ/tan γ. The gain for which a wheel would not
    slip is

        (l_y + l_x·cot γ)/(l_y + e + l_x·cot γ/cos θ).

    Two diagonal wheels have their contacts farther out by e, the two others farther in by e, so
    their gains differ and one pair slips. On an axle that swings about its middle, wheel loads are
    inversely proportional to the distances of the contacts from the middle, 1/(l_y ± e). The pair
    whose grip has the larger moment, load times lever, prevails; in the arrangement X that is the
    inner pair. This gain holds for wheels whose rollers are in the same phase, as at the start; in
    other phases it is up to 3 % less.
    """
    roller = Roller.from_robot(robot)
    # the gain has a kink at θ = 0, and is symmetric: integrate one half
    nodes, weights = legendre(16)
    theta = roller.half_arc * (nodes + 1.0) / 2.0
    offset = roller.axis_distance * tan(theta) / math.tan(roller.angle)
    distances = robot.half_track + np.stack([offset, -offset])
    levers = distances + robot.half_wheelbase * robot.cross_gain / np.cos(theta)
    prevails = np.argmax(np.abs(levers) / distances, axis=0)
    gain = robot.lever / np.take_along_axis(levers, prevails[None], axis=0)[0]
    return math.fsum(weights * gain) / 2.0
