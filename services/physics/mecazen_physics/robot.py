"""A simulated robot: its body, its motors, and everything that may touch it soon."""

from __future__ import annotations

import math
from functools import cached_property

from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D, rotate
from mecazen.links import robot_links
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import WheelCommand

from mecazen_physics.body import MAX_TILT_RAD, RobotBody
from mecazen_physics.footprint import CLEARANCE_M, HORIZON_S, Footprint
from mecazen_physics.motors import Motors
from mecazen_physics.people import MovingPerson
from mecazen_physics.ridges import RidgeContacts
from mecazen_physics.state import (
    BASE_DOFS,
    RobotState,
    check_converged,
    quaternion,
    turned,
    unrotate,
)
from mecazen_physics.world import DartWorld, ground_friction, reachable

NEARBY_M = 1.0
"""Distance after which nearby obstacles are searched again: a map may have hundreds [m]."""
HYSTERESIS = 1.5
"""A robot becomes isolated again at this multiple of the distance at which isolation ends."""
PROJECTED_DOFS = 0, 1, 5, 6
"""Roll, pitch, height and front axle, which `RobotBody.stand` projects."""


class SimulatedRobot:
    """A robot at rest at `start`, its motors, and the people round it.

    Raises:
        UnsupportedError: if an obstacle is so low that the robot could drive onto it, or a roller's
            bearing has too much friction for the step.
    """

    def __init__(
        self, robot: Robot, start: Pose2D, physics: PhysicsConfig, world: WorldConfig
    ) -> None:
        self._robot, self._config = robot, world
        self._dt = physics.dt_s
        # No contact makes a robot ten times as fast as its motors can.
        self.max_speed = 10.0 * robot.wheels.max_speed_rad_s * robot.wheels.radius_m
        """A robot that is faster [m/s] has diverged."""
        self.joint_names = tuple(link.joint for link in robot_links(robot) if link.axis is not None)
        """The wheels' joints and those of all rollers."""
        self._obstacles = [Footprint.of_obstacle(solid) for solid in reachable(robot, world)]
        self._ridges = [
            Footprint(*ridge.middle, ridge.top / 2 + ridge.run, ridge.width / 2)
            for ridge in world.ridges
        ]
        self.home = DartWorld(robot, physics, world)
        """The world of the robot while it is far from all other robots."""
        self.body = RobotBody(self.home, robot, start, physics, world)
        if self._obstacles:
            self.body.add_rims()
        self._motors = Motors(robot, physics, self.body.wheels)
        self.isolated = True
        """Whether the robot is upright, and only the ground can touch it soon."""
        self._upright = self._alone = True
        self._on_ridge = False
        """Whether ridges may touch the rollers soon."""
        self._nearby_from = math.inf, math.inf
        """Position of the robot at the last search for nearby obstacles."""
        self._nearby: list[Footprint] = []
        self._people: dict[int, MovingPerson] = {}
        self.close_people: dict[int, MovingPerson] = {}
        """The people who may touch the robot soon, by number."""
        self.near_obstacle = False
        """Whether an obstacle may touch the robot soon."""
        self._steps = 0
        self.state = self._read()

    @cached_property
    def _ridge_contacts(self) -> RidgeContacts:
        """The planes that carry the robot over ramps and sills."""
        friction = ground_friction(self._robot, self._config)
        return RidgeContacts(self._robot, self._config.ridges, self.body, friction)

    def footprint(self) -> Footprint:
        """Return the robot's present footprint."""
        state = self.state
        x, y, _ = state.position
        speed = math.hypot(*state.linear[:2])
        pose = Pose2D(x, y, state.yaw)
        return Footprint.of_robot(self._robot.footprint, pose, speed, state.angular[2])

    def change_world(self, world: WorldConfig) -> None:
        """Replace the obstacles by those of a changed world."""
        self._config = world
        self._obstacles = [Footprint.of_obstacle(solid) for solid in reachable(self._robot, world)]
        self._nearby_from, self._nearby = (math.inf, math.inf), []
        self.home.change(world)

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Place the person `number`, who keeps the velocity until the next call.

        A person must always have legs, or never.
        """
        self._people[number] = person
        self.body.world.place_person(number, person)

    def stop_person(self, number: int) -> None:
        """Let a person stand where they are now."""
        self.place_person(number, self._people[number].standing())

    def remove_person(self, number: int) -> None:
        """Take a person out of the world."""
        self._people.pop(number, None)

    def share(self, world: DartWorld, *, alone: bool) -> None:
        """Move to a world, `alone` or with other robots; the world's own robot moves first."""
        self._alone = alone
        if world is not self.body.world:
            if self._on_ridge:
                self._leave_ridges()
            # The world that is left does not follow the people any more.
            self.body.world.set_surroundings({}, obstacles=False)
            self.body.move_to(world)
        if not alone:
            self.body.add_rims()
            self.body.align(self.state.yaw, 0.0, alone=False)

    def look_around(self) -> None:
        """Find everything that may touch the robot soon, and prepare DART for these contacts."""
        lean = self.state.tilt if self._upright else HYSTERESIS * self.state.tilt
        self._upright = lean < MAX_TILT_RAD
        near_ridge = self.near_obstacle = False
        self.close_people = {}
        if self._people or self._obstacles or self._ridges:
            footprint = self.footprint()
            # With hysteresis the robot does not switch back and forth at the border.
            margin = 1.0 if self.isolated else HYSTERESIS
            radius = self._config.person.radius_m
            self.close_people = {
                number: person
                for number, person in self._people.items()
                if footprint.may_touch(person.footprint(radius), margin)
            }
            near_ridge = any(footprint.may_touch(ridge, margin) for ridge in self._ridges)
            self.near_obstacle = any(
                footprint.may_touch(solid, margin) for solid in self._find_nearby(footprint)
            )
            if self.close_people or self.near_obstacle:
                self.body.add_rims()
        touchable = bool(self.close_people) or near_ridge or self.near_obstacle
        self.isolated = self._upright and self._alone and not touchable
        self.body.align(self.state.yaw, self.state.angular[2], alone=self.isolated)
        if not self.isolated:
            self.body.expose_all()
        if near_ridge and not self._on_ridge:
            self._on_ridge = True
            self._ridge_contacts.enter(self.body.world)
        elif self._on_ridge and not near_ridge:
            self._leave_ridges()
        if self._config.patches:
            self.body.set_friction([self._friction_below(wheel) for wheel in WHEELS])

    def _leave_ridges(self) -> None:
        self._on_ridge = False
        self._ridge_contacts.leave(self.body.world)

    def _find_nearby(self, footprint: Footprint) -> list[Footprint]:
        """Return the obstacles that the robot may touch within the next `NEARBY_M`."""
        if self._obstacles and math.dist(self._nearby_from, footprint[:2]) > NEARBY_M:
            self._nearby_from = footprint.x, footprint.y
            reach = NEARBY_M + HYSTERESIS * (CLEARANCE_M + 2.0 * self.max_speed * HORIZON_S)
            self._nearby = [s for s in self._obstacles if s.gap(footprint) < reach]
        return self._nearby

    def _friction_below(self, wheel: str) -> float:
        """Return the friction coefficient between a wheel's rollers and the ground."""
        x, y, _ = self.state.position
        at = Pose2D(x, y, self.state.yaw).compose(Pose2D(*self._robot.wheel_position(wheel)[:2]))
        patches = [patch for patch in self._config.patches if patch.covers(at.x, at.y)]
        return ground_friction(self._robot, patches[-1] if patches else self._config)

    def command(self, command: WheelCommand) -> None:
        """Send a command to the motors."""
        self._motors.command(command, self.state.joint_effort[: len(WHEELS)])

    def before_step(self) -> None:
        """Set the motors' speeds or torques, and the planes of ridges under the rollers."""
        self._motors.step()
        if self._on_ridge:
            self._ridge_contacts.lay(self.body.world)

    def after_step(self) -> None:
        """Project wheels that stand onto the ground, and choose the rollers that may touch it."""
        if self._stands:
            self.body.stand()
        if self.close_people:
            self.body.lift()
        if self.isolated:
            self.body.expose_lowest()

    @property
    def _stands(self) -> bool:
        """Whether the wheels stand on the plane of the ground."""
        return self._upright and not self._on_ridge

    def finish(self, steps: int) -> None:
        """Update the state after `steps` simulated steps.

        Raises:
            DivergedError: if the state is not plausible for a robot on the ground; the last good
                state remains.
        """
        duration = steps * self._dt
        for number, person in self._people.items():
            self._people[number] = person.after(duration)
        self._steps += steps
        state = self._read()
        check_converged(state, self.state, self.body.max_depth, self.max_speed)
        self.state = state

    def _read(self) -> RobotState:
        skeleton = self.body.skeleton
        position, velocity = skeleton.getPositions().tolist(), skeleton.getVelocities().tolist()
        if self._stands and self.body.is_projected:
            # the rates of the projected positions: DART's are those of the hulls' edges
            for rate in PROJECTED_DOFS:
                velocity[rate] = 0.0
        heading, orientation = self.body.world.heading, quaternion(*position[:3])
        x, y = rotate(position[3], position[4], heading)
        speeds, friction = velocity[BASE_DOFS:], self._robot.rollers.bearing_friction_nms
        rollers = [-friction * speed for speed in speeds[len(WHEELS) :]]
        return RobotState(
            time=self._steps * self._dt,
            position=(x, y, position[5]),
            orientation=turned(orientation, heading),
            linear=unrotate(orientation, *velocity[3:6]),
            angular=unrotate(orientation, *velocity[:3]),
            joint_position=position[BASE_DOFS:],
            joint_velocity=speeds,
            joint_effort=self._motors.torques() + rollers,
        )
