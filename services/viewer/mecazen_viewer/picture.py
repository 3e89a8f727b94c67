"""Converts messages to entities, without bus and clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
import rerun as rr
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, Standoff
from mecazen.graph import CROWD, WORLDS
from mecazen.limits import FARTHEST_M
from mecazen.robot import WHEELS
from mecazen.urdf import RobotDescription, read

from mecazen_viewer import covariance, plots, senses, things
from mecazen_viewer import entities as e
from mecazen_viewer.components import transform
from mecazen_viewer.entities import Entity
from mecazen_viewer.health import Health
from mecazen_viewer.robot import RobotModel
from mecazen_viewer.track import PoseSeries
from mecazen_viewer.walking import WalkingBody

OBSERVATIONS = 25
"""Number of observations shown: 1 s of the default sensor."""
PLOT_STEP_NS = 100_000_000
"""Period of plots, estimates and observations; moving bodies are drawn with every message."""
SILENCE_NS = 5 * PLOT_STEP_NS
"""Silence after which a follower is assumed to publish no state."""


def surroundings(scenario: Scenario) -> Iterator[Entity]:
    """Return the static entities that all robots share."""
    yield e.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP
    for number, solid in enumerate(scenario.world.solids):
        (x, y), yaw = solid.position_m, math.radians(getattr(solid, "yaw_deg", 0.0))
        bottom = getattr(solid, "bottom_m", 0.0)
        yield things.obstacle(number, solid.size_m, Pose2D(x, y, yaw), bottom)
    for number, ridge in enumerate(scenario.world.ridges):
        yield things.ridge(number, ridge)
    for number, patch in enumerate(scenario.world.patches):
        place = Pose2D(*patch.position_m, math.radians(patch.yaw_deg))
        yield things.patch(number, patch.size_m, place)
    if CROWD in scenario.services:
        yield e.PEOPLE, rr.LineStrips3D.from_fields(colors=[e.GREY], radii=senses.BONE_RADIUS)
    yield from plots.styles(plots.TIME_LINES)


class Picture:
    """The entities of one namespace, usually that of one robot, in one run.

    Each method takes a message and the time of its tick [ns], and returns the entities that
    change. All raise RefusedError if a message can't be drawn. `scenario` is that of the robot's
    services, `health` is shared by all namespaces. Paths do not contain the name of the `robot`.
    """

    def __init__(self, scenario: Scenario, health: Health, robot: str = "") -> None:
        self._scenario, self._health, self._name = scenario, health, robot
        self._robot, self._odom, self._person = PoseSeries(), PoseSeries(), PoseSeries()
        self._model: RobotModel | None = None
        self._seen: deque[Pose2D] = deque(maxlen=OBSERVATIONS)
        self._grid: tuple[int, int] | None = None
        self._centre: tuple[int, int] | None = None
        self._shown_ns: dict[str, int] = {}
        self._standoff = scenario.follower.standoff
        self._has_skeleton = "skeleton" in scenario.sensor.features
        self._body: WalkingBody | None = None
        person, base = scenario.world.person, scenario.robot.base
        self._unplaced = things.marks(base.length_m, base.width_m, person.height_m)
        self._placed: list[Entity] = []

    def shapes(self) -> Iterator[Entity]:
        """Return the static entities that belong to the robot, without its body."""
        yield from things.styles()
        yield from senses.styles(self._scenario.world.person.height_m)
        if {"tracker", "depth"} & self._scenario.sensor.features:
            yield senses.frustum(self._scenario.robot.camera, self._scenario.sensors.tracker)
        if self._name:
            yield things.label(self._name)
        yield from plots.styles(plots.LINES)

    def robot_shapes(self, description: RobotDescription) -> list[Entity]:
        """Return the static entities of the robot's body."""
        self._model = RobotModel(read(description.urdf), description.meshes)
        return self._model.shapes

    def on_ground_truth(self, odom: m.Odometry, time_ns: int) -> Iterator[Entity]:
        """Move the robot and the view that follows it."""
        pose, p, q = _planar(odom), odom.pose.pose.position, odom.pose.pose.orientation
        place, turn = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
        if max(np.abs(place).max(), np.abs(turn).max()) > FARTHEST_M:
            raise RefusedError(f"pose out of range: {odom.pose.pose}")
        yield e.ROBOT, transform(place, turn)
        self._centre = things.grid_centre(pose)
        other = self._person.newest or pose  # the view is centred between both
        middle = Pose2D((pose.x + other.x) / 2.0, (pose.y + other.y) / 2.0)
        yield things.frame(e.FOLLOW, middle)
        if self._robot.add(time_ns, pose):
            yield things.trail("robot", self._robot.trail)

    def on_joint_states(self, joints: m.JointState, time_ns: int) -> Iterator[Entity]:
        """Turn the wheels and rollers."""
        if self._model is not None:
            yield from self._model.pose(joints)
        if len(joints.velocity) >= len(WHEELS) and self._is_due(e.WHEEL_SPEED, time_ns):
            yield plots.wheel_speeds("measured", joints.velocity[: len(WHEELS)])

    def on_joint_command(self, joints: m.JointState, time_ns: int) -> Iterator[Entity]:
        """Plot the commanded wheel speeds; a command of efforts has none."""
        speeds = dict(zip(joints.name, joints.velocity, strict=False))
        names = self._scenario.robot.wheels.joints
        if speeds.keys() >= set(names) and self._is_due("commanded wheels", time_ns):
            yield plots.wheel_speeds("commanded", (speeds[name] for name in names))

    def on_odom(self, odom: m.Odometry, time_ns: int) -> Iterator[Entity]:
        """Place the odom frame so that odometry and ground truth coincide."""
        pose = _planar(odom)
        if self._odom.add(time_ns, pose):
            yield things.trail("odometry", self._odom.trail)
        if self._is_due(e.ODOM, time_ns):
            if (truth := self._robot.at(time_ns)) is not None:
                yield things.frame(e.ODOM, truth.compose(pose.between(Pose2D())))
            yield from plots.velocity("measured", odom.twist.twist.to_planar())

    def on_target_odom(self, odom: m.Odometry, time_ns: int) -> Iterator[Entity]:
        """Move the person; the body is animated if no service publishes its joints."""
        pose = _planar(odom)
        yield self._place(things.frame(e.PERSON, pose))
        if not self._has_skeleton:
            self._body = self._body or WalkingBody(self._scenario.world.person.height_m)
            yield senses.limbs(self._body.walk(pose, odom.twist.twist.to_planar(), time_ns))
        if self._person.add(time_ns, pose):
            yield things.trail("person", self._person.trail)
        # a follower that publishes its state has the errors plotted with it
        reports = time_ns - self._shown_ns.get(e.ESTIMATE, -SILENCE_NS) < SILENCE_NS
        if reports or not self._is_due("true errors", time_ns):
            return
        if (robot := self._robot.at(time_ns)) is not None:
            yield from plots.errors(self._standoff, pose.between(robot))

    def on_people(self, people: m.People, time_ns: int) -> Iterator[Entity]:
        """Move the people whom no robot follows."""
        del time_ns
        followed = {name or "target" for name in self._scenario.names}
        yield senses.people([one for one in people.persons if one.id not in followed])

    def on_skeleton(self, skeleton: m.Skeleton, time_ns: int) -> Iterator[Entity]:
        """Move the person's limbs."""
        del time_ns
        yield senses.body(skeleton)

    def on_skeletons(self, frame: m.Skeletons, time_ns: int) -> Iterator[Entity]:
        """Show the detected bones, transformed with the robot's pose at their capture."""
        del time_ns
        robot = self._robot.at(frame.header.stamp.ns)
        if robot is not None:
            yield senses.skeletons(frame.skeletons, robot)

    def on_scan(self, scan: m.LaserScan, time_ns: int) -> Iterator[Entity]:
        """Show the points of a scan."""
        del time_ns
        robot = self._robot.at(scan.header.stamp.ns)
        if robot is not None:
            yield senses.scan(scan, self._scenario.robot.lidar.position_m, robot)

    def on_depth(self, image: m.Image, time_ns: int) -> Iterator[Entity]:
        """Show the depth picture."""
        del time_ns
        yield senses.depth(image)

    def on_observation(self, frame: m.Observation, time_ns: int) -> Iterator[Entity]:
        """Show the observation, transformed with the robot's pose at its capture."""
        seen = self._in_world(frame) if frame.poses else None
        if seen is not None:
            self._seen.append(seen)
        elif self._seen:
            self._seen.popleft()
        if not self._is_due(e.OBSERVATION, time_ns):
            return
        yield things.points(np.array([pose[:2] for pose in self._seen]).reshape(-1, 2))
        if not self._seen:
            return
        axes = None
        if seen is not None:
            spread = covariance.planar(frame.poses[0].covariance)
            axes = None if spread is None else covariance.ellipse_axes(spread, seen.yaw)
        x, y, _ = self._seen[-1]
        yield self._place(things.ellipse(e.OBSERVATION_ELLIPSE, x, y, axes))

    def on_follower_state(self, state: m.FollowerState, time_ns: int) -> Iterator[Entity]:
        """Show estimate and goal, and plot the errors of robot and estimate."""
        yield from self._health.tracking(state.tracking, self._name)
        if not (state.estimate and state.goal and self._is_due(e.ESTIMATE, time_ns)):
            return
        person, goal = _planar(state.estimate[0]), _in_range(state.goal[0].to_planar())
        spread = covariance.planar(state.estimate[0].pose.covariance)
        axes = None if spread is None else covariance.ellipse_axes(spread)
        yield self._place(things.frame(e.ESTIMATE, person))
        yield self._place(things.ellipse(e.ESTIMATE_ELLIPSE, person.x, person.y, axes))
        yield self._place(things.frame(e.GOAL, goal))
        robot, truth = self._robot.at(time_ns), self._person.at(time_ns)
        seen = None if robot is None or truth is None else truth.between(robot)
        wanted = person.between(goal)
        distance, bearing = math.hypot(wanted.x, wanted.y), math.atan2(wanted.y, wanted.x)
        standoff = Standoff(distance, bearing, wanted.yaw)
        yield from plots.errors(standoff, seen, state.distance_error, state.heading_error)
        odom = self._odom.at(time_ns)
        if seen is not None and odom is not None and spread is not None:
            in_odom = odom.compose(seen.between(Pose2D()))
            yield plots.consistency(covariance.nees(person, in_odom, spread))

    def on_guard_state(self, state: m.GuardState, time_ns: int) -> Iterator[Entity]:
        """Log changes of the guard's state."""
        del time_ns
        yield from self._health.guard(state, self._name)

    def on_cmd_vel(self, twist: m.Twist, time_ns: int) -> Iterator[Entity]:
        """Plot the commanded velocity."""
        if self._is_due("commanded", time_ns):
            yield from plots.velocity("commanded", twist.to_planar())

    def on_diagnostics(
        self, report: m.DiagnosticArray, time_ns: int, service: str
    ) -> Iterator[Entity]:
        """Show the health of a service, and plot the real-time factor from physics."""
        del time_ns
        yield from self._health.diagnostics(service, report, self._name)
        for status in report.status:
            for pair in status.values:
                if service in WORLDS and pair.key == "rtf":
                    yield plots.real_time(_number(pair.value))

    def statics(self) -> Iterator[Entity]:
        """Return the shapes of newly placed frames, and the grid if it moved."""
        yield from self._placed
        self._placed.clear()
        if self._centre is not None and self._centre != self._grid:
            self._grid = self._centre
            yield things.ground(self._grid)

    def _place(self, frame: Entity) -> Entity:
        """Return a frame, and queue its shapes if they are not drawn yet."""
        self._placed += self._unplaced.pop(frame[0], ())
        return frame

    def _is_due(self, what: str, time_ns: int) -> bool:
        """Return whether an entity limited to ten times a second is due."""
        if time_ns - self._shown_ns.get(what, -PLOT_STEP_NS) < PLOT_STEP_NS:
            return False
        self._shown_ns[what] = time_ns
        return True

    def _in_world(self, frame: m.Observation) -> Pose2D | None:
        """Return the observed position in world, with the yaw of the observation's frame."""
        seen = _in_range(frame.poses[0].pose.to_planar())
        if frame.header.frame_id not in ("base_link", self._scenario.controller.base_frame_id):
            return seen._replace(yaw=0.0)
        robot = self._robot.at(frame.header.stamp.ns)
        return None if robot is None else robot.compose(seen)._replace(yaw=robot.yaw)


def _planar(odom: m.Odometry) -> Pose2D:
    return _in_range(odom.pose.pose.to_planar())


def _in_range(pose: Pose2D) -> Pose2D:
    if max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
        raise RefusedError(f"pose out of range: {pose.x}, {pose.y}")
    return pose


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RefusedError(f"not a number: {text!r:.80}") from None
