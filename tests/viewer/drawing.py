"""Messages in, and what Rerun's recording of them contains."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from harness import load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.geometry import Pose2D, Twist2D
from mecazen.runtime.process import observe
from mecazen.wire import Stamp
from rerun.chunk import RrdReader

MS = 10**6
COVARIANCE = m.diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))
KIND, COMPONENT = b"rerun:kind", b"rerun:component"


class Content:
    """The values in a recording, by path and component, in the order of their times."""

    def __init__(self, file: Path) -> None:
        self._values: dict[tuple[str, str], list[Any]] = {}
        for chunk in RrdReader(file).stream().to_chunks():
            batch = chunk.to_record_batch()
            kinds = {field.name: (field.metadata or {}).get(KIND) for field in batch.schema}
            times = [batch.column(name) for name, kind in kinds.items() if kind == b"index"]
            times_ns = times[0].cast(pa.int64()).to_pylist() if times else [-1] * batch.num_rows
            for field in batch.schema:
                if (field.metadata or {}).get(KIND) == b"data":
                    key = chunk.entity_path.lstrip("/"), field.metadata[COMPONENT].decode()
                    rows = zip(times_ns, batch.column(field.name).to_pylist(), strict=True)
                    self._values.setdefault(key, []).extend(
                        row for row in rows if row[1] is not None
                    )

    @property
    def paths(self) -> set[str]:
        return {path for path, _ in self._values}

    def all(self, path: str, component: str) -> list[np.ndarray]:
        """The values that a component of a path has had."""
        rows = sorted(self._values.get((path, component), ()), key=lambda row: row[0])
        return [np.array(value) for _, value in rows]

    def last(self, path: str, component: str) -> np.ndarray:
        """The newest value of a component of a path."""
        return self.all(path, component)[-1]

    def pose(self, path: str) -> Pose2D:
        """The newest planar pose of a frame."""
        ((x, y, _),) = self.last(path, "Transform3D:translation")
        ((_, _, z, w),) = self.last(path, "Transform3D:quaternion")
        return Pose2D(x, y, 2.0 * math.atan2(z, w))

    def plotted(self, path: str) -> list[float]:
        """The newest values of a plot."""
        return self.last(path, "Scalars:scalars").tolist()

    def log(self, source: str) -> list[str]:
        """The lines in the log of a source, with their levels."""
        lines = self.all(f"log/{source}", "TextLog:text")
        levels = self.all(f"log/{source}", "TextLog:level")
        return [f"{level[0]} {line[0]}" for level, line in zip(levels, lines, strict=True)]


class Drawing:
    """A viewer that draws a run of a scenario into a file."""

    def __init__(self, folder: Path, scenario: Scenario | None = None) -> None:
        self.bus = Bus()
        self.viewer = observe("viewer", self.bus, scenario or Scenario(robot=load_robot()))
        self.viewer.send = self._save
        self._file = folder / "run.rrd"

    def _save(self, recording: rr.RecordingStream) -> None:
        recording.save(self._file)

    def put(self, topic: Any, message: Any, ms: int = 0, robot: str = "") -> None:
        """Publish a message at a simulated time."""
        on_bus = keys.of_robot(topic, robot)
        self.bus.publisher(on_bus).put(message, Stamp(ms * MS, 1, 7))

    def end(self) -> Content:
        """End the run; return what was drawn."""
        self.viewer.close()
        return Content(self._file)


def odometry(pose: Pose2D, speed: float = 0.0) -> m.Odometry:
    return m.planar_odometry(m.Time(), "world", "base_link", pose, Twist2D(speed))


def following(estimate: Pose2D, goal: Pose2D, tracking: str = "following") -> m.FollowerState:
    pose = m.PoseWithCovariance(pose=m.Pose.planar(estimate), covariance=COVARIANCE)
    return m.FollowerState(
        tracking=tracking,
        estimate=(m.Odometry(pose=pose),),
        goal=(m.Pose.planar(goal),),
        distance_error=0.25,
        heading_error=0.5,
    )


def report(name: str, level: int = 0, message: str = "ok", **values: str) -> m.DiagnosticArray:
    pairs = tuple(m.KeyValue(key=key, value=value) for key, value in values.items())
    status = m.DiagnosticStatus(level=level, name=name, message=message, values=pairs)
    return m.DiagnosticArray(status=(status,))
