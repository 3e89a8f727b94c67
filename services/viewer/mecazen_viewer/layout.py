"""The initial layout of a viewer: follow view, top view, plots, text."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from mecazen_viewer import entities as e
from mecazen_viewer.plots import TIME_LINES

BACKGROUND = (206, 211, 218)
"""Background of the scene in both themes of the viewer: light, since the robot is dark."""
PLOTTED_NS = 30 * 10**9
"""Time span of each plot [ns]."""
WHEEL_SHARE = 1.5
"""Height of the plot with the longest legend, relative to the others."""


def application(robots: Sequence[str]) -> str:
    """Return the name under which Rerun stores the user's changes of the layout."""
    return " ".join(("mecazen", *filter(None, robots)))


def blueprint(robots: Sequence[str]) -> rrb.Blueprint:
    """Return the layout; each of several robots has a tab of its name."""
    parts = [_of_robot(robot) for robot in robots]
    return rrb.Blueprint(
        parts[0] if len(parts) == 1 else rrb.Tabs(*parts),
        rrb.TimePanel(timeline=e.TIMELINE, play_state="following", state="collapsed"),
        collapse_panels=True,
    )


def _of_robot(robot: str) -> rrb.Horizontal:
    """Return views of the scene that follow a robot, and the robot's plots."""
    start = rrb.TimeRangeBoundary.cursor_relative(nanos=-PLOTTED_NS)
    end = rrb.TimeRangeBoundary.cursor_relative()
    past = rrb.VisibleTimeRange(e.TIMELINE, start=start, end=end)

    def plot(path: str, name: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            origin=path if path in TIME_LINES else e.of_robot(path, robot),
            name=name,
            time_ranges=past,
            axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end)),
            # covers the oldest values
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
        )

    def scene(name: str, eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin=e.of_robot(e.FOLLOW, robot),
            contents=f"{e.WORLD}/**",
            name=name,
            background=BACKGROUND,
            line_grid=False,
            eye_controls=eye,
        )

    follow = rrb.EyeControls3D(
        position=(-1.75, 2.0, 1.4), look_target=(0.05, 0.0, 0.72), eye_up=(0.0, 0.0, 1.0)
    )
    above = rrb.EyeControls3D(
        position=(0.0, 0.0, 5.0), look_target=(0.0, 0.0, 0.0), eye_up=(0.0, 1.0, 0.0)
    )
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    text = rrb.Vertical(
        rrb.TextDocumentView(origin=e.HEALTH, name="health"),
        rrb.TextLogView(origin=e.LOG, name="log", columns=columns),
    )
    scenes = rrb.Vertical(
        scene("following", follow),
        rrb.Horizontal(scene("from above", above), text),
        row_shares=[3, 2],
    )
    plots = rrb.Vertical(
        plot(e.DISTANCE, "distance error [m]"),
        plot(e.ANGLE, "heading error [°]"),
        rrb.Horizontal(
            plot(e.VELOCITY, "body velocity [m/s]"),
            plot(e.YAW_RATE, "yaw rate [rad/s]"),
        ),
        plot(e.WHEEL_SPEED, "wheel speed [rad/s]"),
        rrb.Horizontal(plot(e.NEES, "estimator: NEES"), plot(e.REAL_TIME, "real-time factor")),
        row_shares=[1, 1, 1, WHEEL_SHARE, 1],
    )
    return rrb.Horizontal(scenes, plots, column_shares=[3, 2], name=robot or None)
