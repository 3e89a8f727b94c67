"""A robot of the world: it switches between the models of its rollers."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import NamedTuple

import msgspec
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.body import AllRollersBody, RobotBody
from mecazen_physics.contacts import (
    CLEARANCE_M,
    HORIZON_S,
    MAX_TILT_RAD,
    Footprint,
    horizon_steps,
)
from mecazen_physics.dart_world import DartWorld
from mecazen_physics.motors import Motors, Push, WheelCommand
from mecazen_physics.near_rollers import NearRollersBody
from mecazen_physics.people import MovingPerson
from mecazen_physics.state import RobotState, check_converged

Check = Callable[[], bool]
"""To be called after a step; tells whether all motors were within their torque in it."""

NEARBY_M = 1.0
"""Obstacles nearby are looked for anew after this way: of a map there may be hundreds."""
HYSTERESIS = 1.5
"""A robot is isolated again at so many times the distance at which it ceases to be."""


class Prepared(NamedTuple):
    """What a robot needs for its next steps."""

    steps: int
    """How many can be simulated before the next one is prepared."""
    pushes: list[Push]
    """To be called before each."""
    check: Check


class DartRobot:
    """A robot at rest at `start`, its motors, and the people round it.

    With `physics.rollers` = "near" its body has the rollers near the ground while it is upright,
    and else all of them. The motion passes from one body to the other. Rollers touch the ground
    only; obstacles, people and other robots touch the base and the rims of the wheels.

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape, an obstacle is so low
            that the robot could drive onto it, a roller's bearing too stiff for the step, or
            the rollers too many for `NearRollersBody`.
    """

    def __init__(
        self, robot: Robot, start: Pose2D, physics: PhysicsConfig, world: WorldConfig
    ) -> None:
        bodies.check_bearings(robot, physics)
        self._robot, self._world = robot, world
        self._dt = physics.dt_s
        self._horizon = horizon_steps(physics)
        self._extents = robot.footprint
        self._bearing_friction = robot.rollers.bearing_friction_nms
        # base_link's origin is the mean of the wheels' lowest points, which no attitude of a
        # robot above the ground brings below it.
        self._max_depth = robot.rollers.max_radius_m
        # Nothing that a robot touches makes it ten times as fast as its motors can.
        self.max_speed = 10.0 * robot.wheels.max_speed_rad_s * robot.wheels.radius_m
        """A robot that is faster [m/s] has diverged."""
        bare = msgspec.structs.replace(world, obstacles=(), walls=(), tables=(), ramps=())
        self._isolated_world = DartWorld(robot, physics, bare, isolated=True)
        self._build_among_others = partial(DartWorld, robot, physics, world)
        self._all = AllRollersBody(robot, start, physics, world, self._isolated_world)
        self._upright_body: RobotBody = self._all
        if physics.rollers == "near":
            self._all.leave()
            self._upright_body = NearRollersBody(robot, start, physics, world, self._isolated_world)
        self._solids = bodies.reachable(robot, world)
        if self._solids:
            self._add_rims()
        self._max_torque = robot.wheels.max_torque_nm
        self.body: RobotBody = self._upright_body
        """The body that is simulated now."""
        self.isolated = True
        """Whether it is upright, and nothing but the ground can touch it soon."""
        self._upright = True
        self.joint_names = self._all.joint_names
        self._shared_world: DartWorld | None = None
        self._motors = Motors(robot, physics)
        self._obstacles = [Footprint.of_obstacle(solid) for solid in self._solids]
        self._ridges = [Footprint.of_ridge(ridge) for ridge in world.ridges]
        self._ridges_in: DartWorld | None = None
        """The world in which ridges carry it now."""
        self._nearby_from = math.inf, math.inf
        """Where the robot was when it last looked for what is nearby."""
        self._nearby_solids: list[Footprint] = []
        self._person_radius = world.person.radius_m
        self._people: dict[int, MovingPerson] = {}
        self.close_people: dict[int, MovingPerson] = {}
        """Those who may touch the robot soon, by their numbers."""
        self._steps = 0
        self._state = self._read()

    @cached_property
    def _among_others(self) -> DartWorld:
        """Where it may touch more than the ground: 7 MB, which many a robot never needs."""
        return self._build_among_others()

    def state(self) -> RobotState:
        """Return the present state."""
        return self._state

    def footprint(self) -> Footprint:
        """Return the robot seen from above."""
        x, y, _ = self._state.position
        speed = math.hypot(*self._state.linear[:2])
        pose = Pose2D(x, y, self._state.yaw)
        return Footprint.of_robot(self._extents, pose, speed, self._state.angular[2])

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Put a person into the world."""
        self._people[number] = person
        self.body.world.place_person(number, person)

    def share(self, world: DartWorld | None) -> None:
        """Be in a world together with other robots from now on; in one's own with None."""
        self._shared_world = world
        self._add_rims()

    def _add_rims(self) -> None:
        for body in (self._upright_body, self._all):
            body.add_rims(self._robot, self._world)

    def update_contact_candidates(self) -> None:
        """Find what may touch the robot soon, and take the body that suits it."""
        lean = self._state.tilt if self._upright else HYSTERESIS * self._state.tilt
        self._upright = lean < MAX_TILT_RAD
        near_ridge, isolated = False, self._shared_world is None
        if self._people or self._solids or self._ridges:
            footprint = self.footprint()
            # With hysteresis the robot does not switch back and forth at the border.
            margin = 1.0 if self.isolated else HYSTERESIS
            self.close_people = {
                number: person
                for number, person in self._people.items()
                if footprint.may_touch(person.footprint(self._person_radius), margin)
            }
            if self.close_people:
                self._add_rims()
            near_ridge = any(footprint.may_touch(ridge, margin) for ridge in self._ridges)
            solids = self._nearby(footprint)
            isolated = isolated and not (
                self.close_people
                or near_ridge
                or any(footprint.may_touch(solid, margin) for solid in solids)
            )
        self.isolated = self._upright and isolated
        before = self.body.world
        body = self._all if near_ridge or not self._upright else self._upright_body
        home = self._isolated_world if self.isolated else self._shared_world or self._among_others
        if body is not self.body:
            # a body that is not simulated is in no world: anywhere it would be in the way
            body.enter(home, self.body.leave())
            self.body = body
        body.move_to(home)
        body.align(self._state.yaw, self._state.angular[2])
        self._carry(home if near_ridge else None)
        if self._world.patches:
            body.set_friction([self._friction_below(wheel) for wheel in WHEELS])
        if body.world is not before:
            # The world that was left does not follow the people any more.
            before.set_present({})

    def _nearby(self, footprint: Footprint) -> list[Footprint]:
        """Return the obstacles that it may touch within the next `NEARBY_M` of its way."""
        if math.dist(self._nearby_from, footprint[:2]) > NEARBY_M:
            self._nearby_from = footprint.x, footprint.y
            reach = NEARBY_M + HYSTERESIS * (CLEARANCE_M + 2.0 * self.max_speed * HORIZON_S)
            self._nearby_solids = [s for s in self._obstacles if s.gap(footprint) < reach]
        return self._nearby_solids

    def _carry(self, world: DartWorld | None) -> None:
        """Have ridges carry the rollers in a world from now on, or in none."""
        ridges, before = self._all.ridges, self._ridges_in
        if world is before:
            return
        if before is not None:
            ridges.lift(before)
            before.remove_planes(ridges.skeleton)
        if world is not None:
            world.add_planes(ridges.skeleton)
        self._ridges_in = world

    def _friction_below(self, wheel: str) -> float:
        """Return the coefficient between a wheel's rollers and the ground below it."""
        x, y, _ = self._state.position
        at = Pose2D(x, y, self._state.yaw).compose(Pose2D(*self._robot.wheel_position(wheel)[:2]))
        patches = [patch for patch in self._world.patches if patch.covers(at.x, at.y)]
        return bodies.ground_friction(self._robot, patches[-1] if patches else self._world)

    def prepare(self, command: WheelCommand, steps: int) -> Prepared:
        """Give the motors a command for at most `steps` steps."""
        steps = min(steps, self._horizon)
        touches = not self.isolated and self.body.world.touches_more_than_the_ground()
        strict = touches or not self._upright
        speeds, push = self._motors.apply(command, self.body, self._state, steps, strict=strict)
        return self._prepared(self.body.prepare(speeds, steps, upright=self._stands), push)

    @property
    def _stands(self) -> bool:
        """Whether its wheels stand on the plane of the ground."""
        return self._upright and self._ridges_in is None

    def _prepared(self, steps: int, push: Push | None) -> Prepared:
        pushes = [] if push is None else [push]
        if self._ridges_in is not None:
            pushes.append(partial(self._all.ridges.lay, self._ridges_in))
        limit = self._max_torque if self.body.drive == "speed" else math.inf
        return Prepared(steps, pushes, partial(self.body.after_step, limit, stands=self._stands))

    def take_back(self, command: WheelCommand, steps: int) -> Prepared:
        """Go back by `steps` steps to the last call of `prepare`, to simulate them strictly."""
        self.body.take_back()
        for number, person in self._people.items():
            self.body.world.place_person(number, person)
        push = self._motors.apply(command, self.body, self._state, steps, strict=True)[1]
        return self._prepared(steps, push)

    def settle(self, steps: int) -> None:
        """Take over the state after `steps` steps that were simulated.

        Raises:
            DivergedError: if it is no longer one of a robot on the ground; the last good state
                stays.
        """
        self.body.settle(steps)
        duration = steps * self._dt
        for number, person in self._people.items():
            self._people[number] = person.after(duration)
        self._steps += steps
        state = self._read()
        check_converged(state, self._state, self._max_depth, self.max_speed)
        self._state = state

    def _read(self) -> RobotState:
        time = self._steps * self._dt
        return RobotState.of(time, self.body.read(), self.body.torques(), self._bearing_friction)
