"""Paths of entities in a recording, their colours, and the layout of the views that show them."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

Entity = tuple[str, rr.AsComponents]
"""A path in the recording and the data to log there."""

TIMELINE = "sim_time"

WORLD = "world"
FOLLOW = "world/follow"
"""The frame of the large view: it moves with the robot and does not rotate."""
ABOVE = "world/follow/above"
"""A camera so far above that its picture has no perspective."""
GROUND = "world/ground"
ROBOT = "world/robot"
PERSON = "world/person"
OBSTACLES = "world/obstacles"
ADDED = "world/obstacles/added"
RIDGES = "world/ridges"
PATCHES = "world/patches"
OBSERVATION = "world/observation"
OBSERVATION_ELLIPSE = "world/observation_covariance"
ODOM = "world/odom"
"""The odom frame, placed so that odometry and ground truth of the robot coincide."""
ESTIMATE = "world/odom/estimate"
ESTIMATE_ELLIPSE = "world/odom/estimate_covariance"
GOAL = "world/odom/goal"
TRAILS = "world/trails"
BODY = "world/body"
"""The person's true limbs."""
PEOPLE = "world/people"
"""The limbs of people whom no robot follows."""
SKELETON = "world/skeleton"
"""The bones that the body tracker sees."""
SCAN = "world/scan"
FRUSTUM = "world/robot/camera_view"
DEPTH = "camera/depth"

DISTANCE = "plots/distance"
ANGLE = "plots/angle"
VELOCITY = "plots/velocity"
YAW_RATE = "plots/yaw_rate"
WHEEL_SPEED = "plots/wheel_speed"
NEES = "plots/nees"
REAL_TIME = "plots/real_time"
"""The only plot that all robots share."""

LOG = "log"
HEALTH = "health"

Colour = tuple[int, int, int]

# after Okabe and Ito: safe for the colour-blind, readable on dark and light backgrounds
BLUE: Colour = (0, 114, 178)
ORANGE: Colour = (230, 159, 0)
GREEN: Colour = (0, 158, 115)
PURPLE: Colour = (190, 90, 160)
RED: Colour = (213, 40, 30)
GREY: Colour = (128, 128, 128)
BACKGROUND: Colour = (206, 211, 218)
"""Background of the scene in both themes of the viewer: light, since the robot is dark."""

PLOTTED_NS = 30 * 10**9
"""Time span of each plot [ns]."""
LEGEND_NS = 15 * 10**9
"""Empty time before it, for the legend [ns]."""
WHEEL_SHARE = 1.5
"""Height of the plot with the longest legend, relative to the others."""


def path_of_robot(path: str, robot: str) -> str:
    """Return a path in the namespace of one of several robots, whose name follows the first part.

    A path of one part, such as the table of health, belongs to all robots.
    """
    branch, slash, below = path.partition("/")
    return f"{branch}/{robot}/{below}" if robot and slash else path


def blueprint(robots: Sequence[str]) -> rrb.Blueprint:
    """Return the layout; each of several robots has a tab of its name."""
    tabs = [_views(robot) for robot in robots]
    return rrb.Blueprint(
        tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs),
        rrb.TimePanel(timeline=TIMELINE, play_state="following", state="collapsed"),
        collapse_panels=True,
    )


def _views(robot: str) -> rrb.Horizontal:
    """Return views of the scene that follow a robot, and the robot's plots."""
    start = rrb.TimeRangeBoundary.cursor_relative(nanos=-PLOTTED_NS)
    before = rrb.TimeRangeBoundary.cursor_relative(nanos=-PLOTTED_NS - LEGEND_NS)
    end = rrb.TimeRangeBoundary.cursor_relative()
    past = rrb.VisibleTimeRange(TIMELINE, start=start, end=end)

    def plot(path: str, name: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            origin=path if path == REAL_TIME else path_of_robot(path, robot),
            name=name,
            time_ranges=past,
            axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=before, end=end)),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
        )

    def scene(name: str, eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin=path_of_robot(FOLLOW, robot),
            contents=f"{WORLD}/**",
            name=name,
            background=BACKGROUND,
            line_grid=False,
            eye_controls=eye,
        )

    follow = rrb.EyeControls3D(
        position=(-1.75, 2.0, 1.4), look_target=(0.05, 0.0, 0.72), eye_up=(0.0, 0.0, 1.0)
    )
    above = rrb.Spatial2DView(
        origin=path_of_robot(ABOVE, robot),
        contents=f"{WORLD}/**",
        name="from above",
        background=BACKGROUND,
    )
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    text = rrb.Vertical(
        rrb.TextDocumentView(origin=HEALTH, name="health"),
        rrb.TextLogView(origin=LOG, name="log", columns=columns),
    )
    scenes = rrb.Vertical(
        scene("following", follow),
        rrb.Horizontal(above, text),
        row_shares=[3, 2],
    )
    plots = rrb.Vertical(
        plot(DISTANCE, "distance error [m]"),
        plot(ANGLE, "heading error [°]"),
        rrb.Horizontal(
            plot(VELOCITY, "body velocity [m/s]"),
            plot(YAW_RATE, "yaw rate [rad/s]"),
        ),
        plot(WHEEL_SPEED, "wheel speed [rad/s]"),
        rrb.Horizontal(plot(NEES, "estimator: NEES"), plot(REAL_TIME, "real-time factor")),
        row_shares=[1, 1, 1, WHEEL_SHARE, 1],
    )
    return rrb.Horizontal(scenes, plots, column_shares=[3, 2], name=robot or None)
