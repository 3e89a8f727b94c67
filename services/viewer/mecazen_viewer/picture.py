"""Converts messages to entities in a recording, without bus and clock."""

from __future__ import annotations

import math
from collections import deque
from functools import cache

import numpy as np
import rerun as rr
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.config.people import Body, Passerby
from mecazen.config.world import Box, Cylinder
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Standoff, Twist2D, wrap
from mecazen.graph import WORLDS
from mecazen.parameters import settings_of, with_added
from mecazen.portable import Floats
from mecazen.robot import WHEELS
from mecazen.skeleton import JOINTS
from mecazen.urdf import RobotDescription, read
from mecazen_people.body.walker import WalkingPerson
from mecazen_people.motion import PersonMotion

from mecazen_viewer import layout, panels, scene, senses
from mecazen_viewer.layout import path_of_robot
from mecazen_viewer.panels import StatusText
from mecazen_viewer.robot import RobotModel

OBSERVATIONS = 25
"""Number of observations shown: 1 s of the default sensor."""
PLOT_STEP_NS = 100_000_000
"""Period of plots, estimates and observations; moving bodies are drawn with every message."""
SILENCE_NS = 5 * PLOT_STEP_NS
"""Silence after which a follower is assumed to publish no state."""
HISTORY_NS = 8 * 10**9
TRAIL_STEP_NS, TRAIL_POINTS = 200_000_000, 301
"""Time between two points of a trail [ns], and their number: those of a minute."""
JUMP_M = 1.0
"""A larger distance between two points of a trail is a jump and starts a new trail [m]."""


SHORTEST_M, TALLEST_M = 1.0, 2.2
"""Heights of the bodies that are animated, in steps of 0.1 m."""


class PoseTrail:
    """Planar poses of one body by simulated time, and its way in the last minute."""

    def __init__(self) -> None:
        self._poses = PoseHistory(HISTORY_NS)
        self.points: deque[tuple[int, float, float]] = deque(maxlen=TRAIL_POINTS)
        self.newest: Pose2D | None = None

    def add(self, time_ns: int, pose: Pose2D) -> bool:
        """Add a pose; return whether the trail has a new point."""
        self._poses.add(time_ns, pose)
        self.newest = pose
        if self.points and time_ns - self.points[-1][0] < TRAIL_STEP_NS:
            return False
        if self.points and pose.distance(Pose2D(*self.points[-1][1:])) > JUMP_M:
            self.points.clear()
        self.points.append((time_ns, pose.x, pose.y))
        return True

    def at(self, time_ns: int) -> Pose2D | None:
        """Return the pose at a time, or the pose nearest in time; None without any pose."""
        if self.newest is None:
            return None
        oldest_ns, newest_ns = self._poses.span_ns
        return self._poses.at(min(max(time_ns, oldest_ns), newest_ns))


class Picture:
    """The entities of one robot in the recording of a run; without a name, those of all robots.

    Each method `on_...` draws a message at `time_ns`, the time of its tick [ns]. It raises
    RefusedError if the message can't be drawn. `scenario` is that of the robot's services; all
    pictures of a run share `texts`.
    """

    def __init__(
        self, recording: rr.RecordingStream, scenario: Scenario, texts: StatusText, name: str = ""
    ) -> None:
        self._recording, self._scenario, self._texts, self._name = recording, scenario, texts, name
        self.time_ns = 0
        self._robot, self._odom, self._person = PoseTrail(), PoseTrail(), PoseTrail()
        self._model: RobotModel | None = None
        self._observations: deque[Pose2D] = deque(maxlen=OBSERVATIONS)
        self._grid: tuple[int, int] | None = None
        self._drawn_ns: dict[str, int] = {}
        self._followed = {robot or "target" for robot in scenario.names}
        lidar = scenario.robot.lidar
        self._lidar = np.array((0.0, 0.0, 0.0) if lidar is None else lidar.position_m)
        self._standoff = scenario.follower.standoff
        self._has_skeleton = "skeleton" in scenario.sensor.features
        self._walkers: dict[str, tuple[WalkingPerson, float]] = {}
        self._added: dict[str, Box | Cylinder] = {}
        """The drawn obstacles that were added, by name."""
        base = scenario.robot.base
        self._height = scenario.world.person.height_m
        self._unplaced = scene.marks((base.length_m, base.width_m), self._height)

    def begin(self) -> None:
        """Draw all that stays in place on the robot, without its body, and the styles."""
        statics = [
            *scene.styles(),
            *senses.styles(),
            *panels.line_styles(panels.ROBOT_PLOTS),
        ]
        camera = self._scenario.robot.camera
        if camera is not None and {"tracker", "depth"} & self._scenario.sensor.features:
            view = senses.frustum(camera, self._scenario.sensors.tracker)
            statics.append((layout.FRUSTUM, view))
        if self._name:
            statics.append(scene.label(self._name))
        for path, shape in statics:
            self._log(path, shape, static=True)

    def draw_robot(self, description: RobotDescription) -> None:
        """Draw the robot's body, whose wheels and rollers then turn with the joint states."""
        self._model = RobotModel(read(description.urdf), description.meshes)
        for path, shape in self._model.shapes:
            self._log(path, shape, static=True)
        self.on_joint_states(m.JointState())

    def on_ground_truth(self, odom: m.Odometry) -> None:
        """Move the robot, the view that follows it, and the grid below."""
        pose, p, q = _planar(odom), odom.pose.pose.position, odom.pose.pose.orientation
        position, turn = np.array((p.x, p.y, p.z)), np.array((q.x, q.y, q.z, q.w))
        self._log(layout.ROBOT, scene.frame(position, turn))
        person = self._person.newest or pose
        middle = Pose2D((pose.x + person.x) / 2.0, (pose.y + person.y) / 2.0)
        self._log(layout.FOLLOW, scene.planar_frame(middle))
        self._extend_trail("robot", self._robot, pose)
        centre = scene.grid_centre(pose)
        if centre != self._grid:
            self._grid = centre
            self._log(layout.GROUND, scene.ground(centre), static=True)

    def on_joint_states(self, joints: m.JointState) -> None:
        """Turn the wheels and rollers."""
        if self._model is not None:
            for path, poses in self._model.pose(joints):
                self._log(path, poses)
        if len(joints.velocity) >= len(WHEELS) and self._is_due(layout.WHEEL_SPEED):
            self._plot(f"{layout.WHEEL_SPEED}/measured", *joints.velocity[: len(WHEELS)])

    def on_joint_command(self, joints: m.JointState) -> None:
        """Plot the commanded wheel speeds; a command of efforts has none."""
        speeds = dict(zip(joints.name, joints.velocity, strict=False))
        names = self._scenario.robot.wheels.joints
        if speeds.keys() >= set(names) and self._is_due("commanded wheels"):
            self._plot(f"{layout.WHEEL_SPEED}/commanded", *(speeds[name] for name in names))

    def on_odom(self, odom: m.Odometry) -> None:
        """Place the odom frame so that odometry and ground truth coincide."""
        pose = _planar(odom)
        self._extend_trail("odometry", self._odom, pose)
        if self._is_due(layout.ODOM):
            if (truth := self._robot.at(self.time_ns)) is not None:
                frame = truth.compose(pose.between(Pose2D()))
                self._log(layout.ODOM, scene.planar_frame(frame))
            self._plot_velocity("measured", odom.twist.twist.to_planar())

    def on_target_odom(self, odom: m.Odometry) -> None:
        """Move the person; the body is animated if no service publishes its joints."""
        pose = _planar(odom)
        self._place(layout.PERSON, scene.planar_frame(pose))
        if not self._has_skeleton:
            motion, height = PersonMotion(pose, odom.twist.twist.to_planar()), self._height
            self._draw_person(self._walk("", motion, height))
        self._extend_trail("person", self._person, pose)
        # a follower that publishes its state has the errors plotted with it
        reports = self.time_ns - self._drawn_ns.get(layout.ESTIMATE, -SILENCE_NS) < SILENCE_NS
        if not reports and self._is_due("true errors"):
            robot = self._robot.at(self.time_ns)
            if robot is not None:
                self._plot_errors(self._standoff, pose.between(robot))

    def on_parameters(self, parameters: m.Parameters) -> None:
        """Show the obstacles that were added to the world, and clear those that were removed."""
        try:
            world = with_added(self._scenario, settings_of(parameters)).world
        except ConfigError as error:
            raise RefusedError(str(error)) from None
        added = {
            name: thing for name, thing in world.added.items() if not isinstance(thing, Passerby)
        }
        for name in self._added.keys() - added.keys():
            self._log(f"{layout.ADDED}/{name}", rr.Clear(recursive=False))
        for name, solid in added.items():
            if self._added.get(name) != solid:
                self._log(f"{layout.ADDED}/{name}", scene.obstacles([solid]))
        self._added = added

    def on_people(self, people: m.People) -> None:
        """Move the people whom no robot follows; who comes without joints is animated."""
        others = [person for person in people.persons if person.id not in self._followed]
        joints, heights = [np.empty((0, len(JOINTS), 3))], np.array([p.height for p in others])
        for person in others:
            if person.joints:
                joints.append(senses.joints_of(person)[None])
            else:
                pose, twist = person.pose.to_planar(), person.twist.to_planar()
                motion = PersonMotion(pose, twist)
                joints.append(self._walk(person.id, motion, person.height)[None])
        self._log(layout.PEOPLE, senses.bodies(np.concatenate(joints), heights, senses.OTHER))

    def on_skeleton(self, skeleton: m.Skeleton) -> None:
        self._draw_person(senses.joints_of(skeleton))

    def on_skeletons(self, frame: m.Skeletons) -> None:
        """Show the detected bones, transformed with the robot's pose at their capture."""
        robot = self._robot.at(frame.header.stamp.ns)
        if robot is not None:
            self._log(layout.SKELETON, senses.skeletons(frame.skeletons, robot))

    def on_scan(self, scan: m.LaserScan) -> None:
        robot = self._robot.at(scan.header.stamp.ns)
        if robot is not None:
            self._log(layout.SCAN, senses.scan(scan, self._lidar, robot))

    def on_depth(self, image: m.Image) -> None:
        self._log(layout.DEPTH, senses.depth(image))

    def on_observation(self, frame: m.Observation) -> None:
        """Show the observation, transformed with the robot's pose at its capture."""
        observation = self._in_world(frame) if frame.poses else None
        if observation is not None:
            self._observations.append(observation)
        elif self._observations:
            self._observations.popleft()
        if not self._is_due(layout.OBSERVATION):
            return
        points = np.array([pose[:2] for pose in self._observations]).reshape(-1, 2)
        self._log(layout.OBSERVATION, scene.points(points))
        if self._observations:
            x, y, yaw = self._observations[-1]
            covariance = None
            if observation is not None:
                covariance = scene.drawable_covariance(frame.poses[0].covariance)
            self._place(layout.OBSERVATION_ELLIPSE, scene.ellipse(x, y, covariance, yaw))

    def on_follower_state(self, state: m.FollowerState) -> None:
        """Show estimate and goal, and plot the errors of robot and estimate."""
        self._log_state("follower", "tracking", state.tracking, state.reason)
        if not (state.estimate and state.goal and self._is_due(layout.ESTIMATE)):
            return
        person, goal = _planar(state.estimate[0]), state.goal[0].to_planar()
        covariance = scene.drawable_covariance(state.estimate[0].pose.covariance)
        self._place(layout.ESTIMATE, scene.planar_frame(person))
        self._place(layout.ESTIMATE_ELLIPSE, scene.ellipse(person.x, person.y, covariance))
        self._place(layout.GOAL, scene.planar_frame(goal))
        robot, truth = self._robot.at(self.time_ns), self._person.at(self.time_ns)
        actual = None if robot is None or truth is None else truth.between(robot)
        x, y, heading = person.between(goal)
        standoff = Standoff(math.hypot(x, y), math.atan2(y, x), heading)
        self._plot_errors(standoff, actual, state.distance_error, state.heading_error)
        odom = self._odom.at(self.time_ns)
        if actual is not None and odom is not None and covariance is not None:
            truth_in_odom = odom.compose(actual.between(Pose2D()))
            score = nees(person, truth_in_odom, covariance)
            self._plot(layout.NEES, *panels.GOOD_NEES, score)

    def on_guard_state(self, state: m.GuardState) -> None:
        self._log_state("guard", "guard", state.state, state.reason)

    def on_cmd_vel(self, twist: m.Twist) -> None:
        if self._is_due("commanded"):
            self._plot_velocity("commanded", twist.to_planar())

    def on_diagnostics(self, report: m.DiagnosticArray, service: str) -> None:
        for path, text in self._texts.diagnostics(service, report, self._name):
            self._log(path, text)
        for status in report.status:
            for pair in status.values:
                if service in WORLDS and pair.key == "rtf":
                    try:
                        factor = float(pair.value)
                    except ValueError:
                        raise RefusedError(f"not a number: {pair.value!r:.80}") from None
                    self._plot(layout.REAL_TIME, *panels.REAL_TIME_LEVELS, factor)

    def _log(self, path: str, archetype: rr.AsComponents, *, static: bool = False) -> None:
        self._recording.log(path_of_robot(path, self._name), archetype, static=static)

    def _log_state(self, service: str, name: str, state: str, reason: str) -> None:
        for path, line in self._texts.state(service, name, state, reason, self._name):
            self._log(path, line)

    def _place(self, path: str, frame: rr.Transform3D) -> None:
        """Move a frame; its marks are drawn when it has its first place."""
        self._log(path, frame)
        for name, shape in self._unplaced.pop(path, {}).items():
            self._log(f"{path}/{name}", shape, static=True)

    def _extend_trail(self, name: str, trail: PoseTrail, pose: Pose2D) -> None:
        if trail.add(self.time_ns, pose):
            points = np.array([place for _, *place in trail.points])
            self._log(f"{layout.TRAILS}/{name}", scene.trail(points))

    def _walk(self, person: str, motion: PersonMotion, height: float) -> Floats:
        """Let a person's body walk to the pose of a motion, and return the joints (20, 3)."""
        if person not in self._walkers:
            animated_m = min(max(round(height, 1), SHORTEST_M), TALLEST_M)
            self._walkers[person] = _solved(animated_m).twin(), -math.inf
        walker, walked_ns = self._walkers[person]
        self._walkers[person] = walker, self.time_ns
        return walker.follow(motion, (self.time_ns - walked_ns) / 1e9).joints

    def _draw_person(self, joints: Floats) -> None:
        heights = np.array([self._height])
        self._log(layout.BODY, senses.bodies(joints[None], heights, senses.FOLLOWED))

    def _plot(self, path: str, *values: float) -> None:
        self._log(path, rr.Scalars(np.array(values)))

    def _plot_velocity(self, source: str, twist: Twist2D) -> None:
        self._plot(f"{layout.VELOCITY}/{source}", twist.x, twist.y)
        self._plot(f"{layout.YAW_RATE}/{source}", twist.yaw)

    def _plot_errors(
        self,
        standoff: Standoff,
        robot: Pose2D | None,
        distance_error: float = math.nan,
        heading_error: float = math.nan,
    ) -> None:
        """Plot the errors of distance [m] and heading [rad], true and as the follower estimates.

        `robot` is the robot's true pose in the person's frame, None if unknown.
        """
        distance = angle = math.nan
        if robot is not None:
            distance, _, angle = standoff.errors(Pose2D(), robot)
        self._plot(layout.DISTANCE, *panels.DISTANCE_BAND_M, distance_error, distance)
        angles = math.degrees(heading_error), math.degrees(angle)
        self._plot(layout.ANGLE, *panels.ANGLE_BAND_DEG, *angles)

    def _is_due(self, entity: str) -> bool:
        """Return whether an entity limited to ten times a second is due."""
        if self.time_ns - self._drawn_ns.get(entity, -PLOT_STEP_NS) < PLOT_STEP_NS:
            return False
        self._drawn_ns[entity] = self.time_ns
        return True

    def _in_world(self, frame: m.Observation) -> Pose2D | None:
        """Return the observed position in world, with the yaw of the observation's frame."""
        observation = frame.poses[0].pose.to_planar()
        if frame.header.frame_id not in ("base_link", self._scenario.controller.base_frame_id):
            return observation._replace(yaw=0.0)
        robot = self._robot.at(frame.header.stamp.ns)
        return None if robot is None else robot.compose(observation)._replace(yaw=robot.yaw)


def nees(estimate: Pose2D, truth: Pose2D, covariance: Floats) -> float:
    """Return the normalised estimation error squared, eᵀ·P⁻¹·e over (x, y, yaw).

    A consistent filter has a mean of 3 and 95 % below 7.815 (Y. Bar-Shalom,
    X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4).
    """
    error = np.array([estimate.x - truth.x, estimate.y - truth.y, wrap(estimate.yaw - truth.yaw)])
    return float(error @ np.linalg.solve(covariance, error))


@cache
def _solved(height_m: float) -> WalkingPerson:
    """Return the walker whose gait all bodies of a height share: computing a gait takes 0.2 s."""
    return WalkingPerson(Body(height_m=height_m))


def _planar(odom: m.Odometry) -> Pose2D:
    return odom.pose.pose.to_planar()
