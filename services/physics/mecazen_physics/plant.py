"""The robot in DART: with all of its rollers as bodies, or those near the ground alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import Robot

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.near import NearScene
from mecazen_physics.reach import Circle, Outline
from mecazen_physics.scene import Scene


class Plant:
    """The robot at rest at `start`, and what surrounds it, in the scene that suits it.

    With `config.rollers` = "near" that is, while the robot is upright and alone, the one with
    the rollers near the ground. The state passes from one to the other.

    Raises:
        UnsupportedError: see `Scene` and `NearScene`.
    """

    def __init__(self, robot: Robot, config: PhysicsConfig, start: Pose2D) -> None:
        self._dt = config.dt_s
        self._full = Scene(robot, config, start)
        self._near = NearScene(robot, config, start) if config.rollers == "near" else self._full
        self.scene: Scene = self._near
        self.joint_names = self._full.joint_names
        self._outline = Outline(robot)
        self._obstacles = [
            Circle(*obstacle.position_m, math.hypot(*obstacle.size_m[:-1]))
            for obstacle in config.obstacles
        ]
        self._person_radius = config.person.radius_m
        self._person: list[Circle] = []
        self._walking = (0.0, 0.0)
        self._alone = True

    def place_person(self, pose: Pose2D, velocity: Twist2D) -> None:
        """Put the person at `pose` in the world frame, moving with `velocity` in their own."""
        self._person = [Circle(pose.x, pose.y, self._person_radius)]
        self._walking = rotate(velocity.x, velocity.y, pose.yaw)
        if self.scene is self._full:
            self._full.place_person(pose.x, pose.y, self._walking)

    def person(self) -> Circle:
        """Return the person from above, who has been placed."""
        return self._person[0]

    def look_round(self, x: float, y: float, tilt: float) -> None:
        """Take the scene that suits base_link at (x, y) [m], leaning by `tilt` [rad]."""
        # It takes more to be alone again: nothing goes back and forth at the border.
        margin = 1.0 if self._alone else 1.5
        self._alone = self._outline.alone(x, y, tilt, self._obstacles + self._person, margin)
        scene = self._near if self._alone else self._full
        if scene is not self.scene:
            scene.write(self.scene.read())
            self.scene = scene
            for person in self._person:
                self._full.place_person(person.x, person.y, self._walking)

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int) -> int:
        """See `Scene.prepare`."""
        return self.scene.prepare(speeds, steps, alone=self._alone)

    def settle(self, steps: int) -> None:
        """See `Scene.settle`."""
        self.scene.settle(steps)
        duration = steps * self._dt
        x, y = self._walking
        self._person = [
            Circle(person.x + x * duration, person.y + y * duration, person.radius)
            for person in self._person
        ]
