"""A simulated robot: its body, its motors, and its possible contacts."""

from __future__ import annotations

import math
from functools import cached_property, partial

from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.links import robot_links
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import WheelCommand

from mecazen_physics import bodies
from mecazen_physics.body import MAX_TILT_RAD, RobotBody
from mecazen_physics.footprint import CLEARANCE_M, HORIZON_S, Footprint, horizon_steps
from mecazen_physics.motors import Motors, Push
from mecazen_physics.people import MovingPerson
from mecazen_physics.ridges import RidgeContacts
from mecazen_physics.scene import Scene
from mecazen_physics.state import BASE_DOFS, RobotState, check_converged

NEARBY_M = 1.0
"""Distance after which nearby obstacles are searched again: a map may have hundreds [m]."""
PROJECTED_DOFS = 0, 1, 5, 6
"""Roll, pitch, height and front axle, which `RobotBody.stand` projects."""
HYSTERESIS = 1.5
"""A robot becomes isolated again at this multiple of the distance at which isolation ends."""


class SimulatedRobot:
    """A robot at rest at `start`, its motors, and the people round it.

    Raises:
        UnsupportedError: if an obstacle is so low that the robot could drive onto it, or a roller's
            bearing has too much friction for the step.
    """

    def __init__(
        self, robot: Robot, start: Pose2D, physics: PhysicsConfig, world: WorldConfig
    ) -> None:
        bodies.check_bearings(robot, physics)
        self._robot, self._world = robot, world
        self._dt = physics.dt_s
        self._horizon = horizon_steps(physics)
        # base_link's origin is the mean of the wheels' lowest points, which no attitude of a
        # robot above the ground brings below it.
        self._max_depth = robot.rollers.max_radius_m
        # No contact makes a robot ten times as fast as its motors can.
        self.max_speed = 10.0 * robot.wheels.max_speed_rad_s * robot.wheels.radius_m
        """A robot that is faster [m/s] has diverged."""
        self.joint_names = tuple(link.joint for link in robot_links(robot) if link.axis is not None)
        """The wheels' joints and those of all rollers."""
        solids = bodies.reachable(robot, world)
        self._obstacles = [Footprint.of_obstacle(solid) for solid in solids]
        self._ridges = [Footprint.of_ridge(ridge) for ridge in world.ridges]
        self.home = Scene(robot, physics, world)
        """The scene of the robot while it is far from all other robots."""
        self.body = RobotBody(self.home, robot, start, physics, world)
        self._has_rims = False
        if solids:
            self._add_rims()
        self._motors = Motors(robot, physics)
        self.isolated = True
        """Whether the robot is upright, and only the ground can touch it soon."""
        self._upright = self._alone = True
        self._ridges_in: Scene | None = None
        """The scene in which ridges carry the robot now."""
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
        """The present state."""

    @cached_property
    def _ridge_contacts(self) -> RidgeContacts:
        """The planes that carry the robot over ramps and sills."""
        friction = bodies.ground_friction(self._robot, self._world)
        hubs = [wheel.getChildBodyNode() for wheel in self.body.wheels]
        return RidgeContacts(self._robot, self._world.ridges, hubs, self.body.rollers, friction)

    def footprint(self) -> Footprint:
        """Return the robot's present footprint."""
        state = self.state
        x, y, _ = state.position
        speed = math.hypot(*state.linear[:2])
        pose = Pose2D(x, y, state.yaw)
        return Footprint.of_robot(self._robot.footprint, pose, speed, state.angular[2])

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Put a person into the world."""
        self._people[number] = person
        self.body.scene.place_person(number, person)

    def remove_person(self, number: int) -> None:
        """Take a person out of the world."""
        self._people.pop(number, None)

    def share(self, scene: Scene, *, alone: bool) -> None:
        """Move to a scene, `alone` or with other robots; the scene's own robot moves first."""
        self._alone = alone
        if scene is not self.body.scene:
            self._carry(None)
            # The scene that is left does not follow the people any more.
            self.body.scene.show({}, obstacles=False)
            self.body.enter(scene, self.body.leave())
        if not alone:
            self._add_rims()
            self.body.align(self.state.yaw, 0.0, alone=False)

    def _add_rims(self) -> None:
        if not self._has_rims:
            self._has_rims = True
            self.body.add_rims()

    def look_around(self) -> None:
        """Find all that may touch the robot soon, and choose DART's axes accordingly."""
        lean = self.state.tilt if self._upright else HYSTERESIS * self.state.tilt
        self._upright = lean < MAX_TILT_RAD
        near_ridge = self.near_obstacle = False
        self.close_people = {}
        if self._people or self._obstacles or self._ridges:
            footprint = self.footprint()
            # With hysteresis the robot does not switch back and forth at the border.
            margin = 1.0 if self.isolated else HYSTERESIS
            radius = self._world.person.radius_m
            self.close_people = {
                number: person
                for number, person in self._people.items()
                if footprint.may_touch(person.footprint(radius), margin)
            }
            if self.close_people:
                self._add_rims()
            near_ridge = any(footprint.may_touch(ridge, margin) for ridge in self._ridges)
            self.near_obstacle = any(
                footprint.may_touch(solid, margin) for solid in self._find_nearby(footprint)
            )
        touchable = bool(self.close_people) or near_ridge or self.near_obstacle
        self.isolated = self._upright and self._alone and not touchable
        self.body.align(self.state.yaw, self.state.angular[2], alone=self.isolated)
        self._carry(self.body.scene if near_ridge else None)
        if self._world.patches:
            self.body.set_friction([self._friction_below(wheel) for wheel in WHEELS])

    def _find_nearby(self, footprint: Footprint) -> list[Footprint]:
        """Return the obstacles that the robot may touch within the next `NEARBY_M`."""
        if math.dist(self._nearby_from, footprint[:2]) > NEARBY_M:
            self._nearby_from = footprint.x, footprint.y
            reach = NEARBY_M + HYSTERESIS * (CLEARANCE_M + 2.0 * self.max_speed * HORIZON_S)
            self._nearby = [s for s in self._obstacles if s.gap(footprint) < reach]
        return self._nearby

    def _carry(self, scene: Scene | None) -> None:
        """Let ridges carry the rollers in a scene from now on, or in none."""
        if scene is self._ridges_in:
            return
        ridges = self._ridge_contacts
        if self._ridges_in is not None:
            ridges.lift(self._ridges_in)
            self._ridges_in.remove(ridges.skeleton)
        if scene is not None:
            scene.add(ridges.skeleton, {"plane": ridges.planes})
        self._ridges_in = scene

    def _friction_below(self, wheel: str) -> float:
        """Return the friction coefficient between a wheel's rollers and the ground."""
        x, y, _ = self.state.position
        at = Pose2D(x, y, self.state.yaw).compose(Pose2D(*self._robot.wheel_position(wheel)[:2]))
        patches = [patch for patch in self._world.patches if patch.covers(at.x, at.y)]
        return bodies.ground_friction(self._robot, patches[-1] if patches else self._world)

    def prepare(self, command: WheelCommand, steps: int) -> tuple[int, list[Push]]:
        """Send a command to the motors for at most `steps` steps.

        Returns:
            The number of steps until the next call, and functions to call before each step.
        """
        push = self._motors.apply(command, self.body, self.state)
        pushes = [] if push is None else [push]
        if self._ridges_in is not None:
            pushes.append(partial(self._ridge_contacts.lay, self._ridges_in))
        return min(steps, self._horizon), pushes

    @property
    def stands(self) -> bool:
        """Whether the wheels stand on the plane of the ground."""
        return self._upright and self._ridges_in is None

    def settle(self, steps: int) -> None:
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
        check_converged(state, self.state, self._max_depth, self.max_speed)
        self.state = state

    def _read(self) -> RobotState:
        friction = self._robot.rollers.bearing_friction_nms
        time = self._steps * self._dt
        motion, torques = self.body.read(), self.body.torques()
        if self.stands and self.body.is_projected:
            # the rates of the projected positions: DART's are those of the hulls' edges
            for rate in PROJECTED_DOFS:
                motion.velocity[rate] = 0.0
        if self._robot.motors is not None:
            speeds = motion.velocity[BASE_DOFS:]
            torques = [t + self._motors.friction(s) for t, s in zip(torques, speeds, strict=False)]
        return RobotState.of(time, motion, torques, friction)
