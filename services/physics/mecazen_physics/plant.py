"""The robot in DART: with all of its rollers as bodies, or those near the ground alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import Robot

from mecazen_physics.config import Box, Cylinder, PhysicsConfig
from mecazen_physics.near import NearScene
from mecazen_physics.reach import MAX_TILT_RAD, Footprint
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
        self._obstacles = [_footprint(obstacle) for obstacle in config.obstacles]
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

    def person(self, number: int = 0) -> Footprint:
        """Return a person from above, who has been placed."""
        x, y, velocity = self._people[number]
        return Footprint(x, y, rim=self._person_radius, speed=math.hypot(*velocity))

    def share(self, stage: Stage | None) -> None:
        """Be on a stage together with other robots from now on; on one's own again with None."""
        self._shared_stage = stage

    def look_round(self, footprint: Footprint, tilt: float) -> None:
        """Take the scene that suits the robot's footprint, leaning by `tilt` [rad]."""
        # It takes more to be alone again: nothing goes back and forth at the border.
        margin = 1.0 if self.alone else 1.5
        self.close_people = {
            number: walking
            for number, walking in self._people.items()
            if footprint.near(self.person(number), margin)
        }
        self.alone = (
            self._shared_stage is None
            and not self.close_people
            and margin * tilt < MAX_TILT_RAD
            and not any(footprint.near(obstacle, margin) for obstacle in self._obstacles)
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


def _footprint(obstacle: Box | Cylinder) -> Footprint:
    if isinstance(obstacle, Cylinder):
        return Footprint(*obstacle.position_m, rim=obstacle.size_m[0])
    length, width, _ = obstacle.size_m
    yaw = math.radians(obstacle.yaw_deg)
    return Footprint(*obstacle.position_m, yaw, length / 2, width / 2)
