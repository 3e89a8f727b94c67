"""The robot in DART: with all of its rollers as bodies, or those near the ground alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import Robot

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.near import NearScene
from mecazen_physics.reach import Circle, Outline
from mecazen_physics.scene import Scene, Stage, Walking


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
        self._own_stage = self._full.stage
        self._shared_stage: Stage | None = None
        self.scene: Scene = self._near
        self.joint_names = self._full.joint_names
        self.outline = Outline(robot)
        self._obstacles = [
            Circle(*obstacle.position_m, math.hypot(*obstacle.size_m[:-1]))
            for obstacle in config.obstacles
        ]
        self._person_radius = config.person.radius_m
        self._people: dict[int, Walking] = {}
        self.close_people: dict[int, Walking] = {}
        """Those who may touch the robot soon, by their numbers."""
        self.alone = True
        """Whether the robot stands upright with nothing near it."""

    def place_person(self, pose: Pose2D, velocity: Twist2D, number: int = 0) -> None:
        """Put a person at `pose` in the world frame, moving with `velocity` in their own."""
        walking = Walking(pose.x, pose.y, rotate(velocity.x, velocity.y, pose.yaw))
        self._people[number] = walking
        self.scene.stage.place_person(number, walking)

    def person(self, number: int = 0) -> Circle:
        """Return a person from above, who has been placed."""
        x, y, _ = self._people[number]
        return Circle(x, y, self._person_radius)

    def share(self, stage: Stage | None) -> None:
        """Be on a stage together with other robots from now on; on one's own again with None."""
        self._shared_stage = stage

    def look_round(self, x: float, y: float, tilt: float) -> None:
        """Take the scene that suits base_link at (x, y) [m], leaning by `tilt` [rad]."""
        # It takes more to be alone again: nothing goes back and forth at the border.
        margin = 1.0 if self.alone else 1.5
        self.close_people = {
            number: walking
            for number, walking in self._people.items()
            if not self.outline.alone(x, y, 0.0, [self.person(number)], margin)
        }
        self.alone = (
            self._shared_stage is None
            and not self.close_people
            and self.outline.alone(x, y, tilt, self._obstacles, margin)
        )
        before = self.scene.stage
        self._full.enter(self._shared_stage or self._own_stage)
        scene = self._near if self.alone else self._full
        if scene is not self.scene:
            scene.write(self.scene.read())
            self.scene = scene
        if scene.stage is not before:
            # people there are not told any more where they are: who comes again is placed anew
            before.show({})

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int) -> int:
        """See `Scene.prepare`."""
        return self.scene.prepare(speeds, steps, alone=self.alone)

    def settle(self, steps: int) -> None:
        """See `Scene.settle`."""
        self.scene.settle(steps)
        duration = steps * self._dt
        for number, (x, y, velocity) in self._people.items():
            vx, vy = velocity
            self._people[number] = Walking(x + vx * duration, y + vy * duration, velocity)
