"""The target: the walking person, and the observations of the robot's sensor."""

from __future__ import annotations

import math
from typing import Any

from mecazen import messages as m
from mecazen.config import Scenario, people
from mecazen.errors import ConfigError
from mecazen.keys import (
    GROUND_TRUTH,
    OBSERVATION,
    PEOPLE,
    TARGET_CMD_VEL,
    TARGET_ODOM,
    TARGET_SKELETON,
    Topic,
)
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen_people.body.recording import height_of
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.crowd import Agent, Pedestrians, agent_at, errand_of
from mecazen_people.motion import DrivenWalk, PersonMotion, with_gait
from mecazen_people.paths import check_path, make_path, start_pose

from mecazen_target.sensor import Sensor, SensorFrame, latency_ticks

BODY_STREAM = 2
"""Stream number of the strides, used with the seed: they are separate from noise and faults."""


class TargetNode(Node):
    """The person walks a path, or is driven by `target/cmd_vel`."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = scenario.target
        path, self.height = self.config.path, height_of(self.config.body)
        try:
            self.path = None if isinstance(path, people.Driven | people.Goal) else make_path(path)
            if self.path is not None:
                check_path(self.path, scenario.world, self.height, scenario.sim.duration_s)
        except ConfigError as error:
            raise ConfigError(f"target.path: {error}") from None
        # both raise an error if a period is not a multiple of the tick
        scenario.ticks_per("sensor.rate_hz")
        latency_ticks(scenario.sensor, scenario.sim.tick_s)
        self.sees_pose = "pose" in scenario.sensor.features
        self.walker: WalkingPerson | None = None
        if "skeleton" in scenario.sensor.features:
            self.walker = WalkingPerson(self.config.body)
            self.skeleton_period = scenario.ticks_per("sensors.skeleton_rate_hz")

    def configure(self, scenario: Scenario) -> None:
        super().configure(scenario)
        if self.pedestrian is not None:
            self.pedestrian.surround(scenario.world.solids)

    def reset(self, seed: int) -> None:
        path, tick_s = self.config.path, self.scenario.sim.tick_s
        timeout_s = path.timeout_s if isinstance(path, people.Driven) else 0.0
        self.driven = DrivenWalk(start_pose(path), timeout_s, tick_s)
        self.pedestrian: Pedestrians | None = None
        self.crowd: list[Agent] = []
        """Those to whom the person gives way: all people but themselves."""
        if isinstance(path, people.Goal):
            world = self.scenario.world
            self.pedestrian = Pedestrians(
                [errand_of(path)], world.solids, world.person.radius_m, seed
            )
        self.tick = 0
        self.motion = self.motion_at(0)
        self.truth = m.Odometry()
        self.sensor = Sensor(self.scenario.sensor, seed, tick_s)
        self.posed = 0
        if self.walker is not None:
            self.walker.reset(self.motion, seed, BODY_STREAM)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the person's pose, and the sensor's observation in ticks with a frame."""
        command = inputs.get(TARGET_CMD_VEL)
        if command is not None and not isinstance(self.config.path, people.Driven):
            inputs.refuse(TARGET_CMD_VEL, "the path is known; target.path.kind = 'driven' obeys")
        elif command is not None:
            self.driven.command(command.to_planar())
        if (crowd := inputs.get(PEOPLE)) is not None:
            name, radius = self.scenario.robot_name or "target", self.scenario.world.person.radius_m
            self.crowd = [
                agent_at(person.pose.to_planar(), person.twist.to_planar(), radius)
                for person in crowd.persons
                if person.id != name
            ]
        person = self.motion = self.motion_at(tick.number)
        self.truth = inputs[GROUND_TRUTH]
        outputs: dict[Topic[Any], m.Message] = {
            TARGET_ODOM: m.planar_odometry(tick.time, "world", "person", person.pose, person.twist)
        }
        if self.walker is not None and tick.number % self.skeleton_period == 0:
            duration_s = (tick.number - self.posed) * self.scenario.sim.tick_s
            self.posed = tick.number
            posture = self.walker.follow(person, duration_s)
            outputs[TARGET_SKELETON] = m.Skeleton(
                header=m.Header(stamp=tick.time, frame_id="world"),
                id="1",
                height=self.height,
                joints=tuple([m.Point(*joint) for joint in posture.joints.tolist()]),
                angles=posture.angles,
                phases=posture.phases,
            )
        if self.sees_pose:
            robot = self.truth.pose.pose.to_planar()
            frame = self.sensor.observe(tick.number, robot, person.pose)
            if frame is not None:
                outputs[OBSERVATION] = self._message(frame)
        return outputs

    def motion_at(self, tick: int) -> PersonMotion:
        """Return the motion at a tick, which is not before the last one."""
        tick_s, missed = self.scenario.sim.tick_s, tick - self.tick
        if self.path is not None:
            motion = self.path.at(tick * tick_s)
        elif self.pedestrian is not None:
            for number in range(self.tick + 1, tick + 1):
                self.pedestrian.step(number * tick_s, tick_s, self.crowd)
            motion = self.pedestrian.motions[0]
        else:
            motion = self.driven.step(missed) if missed else self.driven.motion
        self.tick = tick
        # a body includes the sway
        if self.config.gait is None or self.walker is not None:
            return motion
        return with_gait(motion, self.config.gait)

    def _message(self, frame: SensorFrame) -> m.Observation:
        captured = m.Time.from_ns(frame.capture_tick * self.scenario.sim.tick_ns)
        header = m.Header(stamp=captured, frame_id=self.scenario.sensor.frame)
        covariance = self.sensor.covariance
        seen = [
            (m.PoseWithCovariance(pose=m.Pose.planar(pose), covariance=covariance), name)
            for pose, name in ((frame.pose, "1"), (frame.second, "2"))
            if pose is not None
        ]
        if frame.second_first:
            seen.reverse()
        ids = tuple(name for _, name in seen) if self.scenario.sensor.faults.ids else ()
        poses = tuple(pose for pose, _ in seen)
        return m.Observation(header=header, poses=poses, ids=ids, reason=frame.reason)

    def diagnostics(self) -> dict[str, object]:
        person, _, walked = self.motion
        robot, standoff = self.truth.pose.pose.to_planar(), self.scenario.follower.standoff
        end_s = math.inf if self.path is None else self.path.duration
        has_ended = 0.0 < end_s <= self.tick * self.scenario.sim.tick_s
        return {
            **({"walk_ended": True} if has_ended else {}),
            "time_s": self.tick * self.scenario.sim.tick_ns / 1e9,
            "x_m": round(person.x, 3),
            "y_m": round(person.y, 3),
            "walked_m": round(walked, 3),
            "true_distance_error_m": round(standoff.errors(person, robot).distance, 3),
        }
