"""The same robot in Gazebo's physics: bench/gazebo/gazebo_peer.cpp, built by `make gazebo`."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from mecazen.errors import MecazenError
from mecazen.robot import Robot
from mecazen.rollers import Roller, binary_stl
from mecazen.urdf import build_urdf

from mecazen_bench.engine import Engine, RobotPose

Shape = Literal["capsule", "mesh"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
"""Shapes of the rollers in other engines."""

PROGRAM = Path(__file__).parents[1] / "build" / "gazebo-peer"
MESH_RINGS, MESH_SEGMENTS = 10, 11
"""220 triangles, as in the published models for Gazebo."""


class GazeboEngine(Engine):
    """A robot in Gazebo's default engine, in a separate process."""

    def __init__(self, robot: Robot, dt_s: float, shape: Shape) -> None:
        super().__init__(f"Gazebo, {shape}", robot, dt_s)
        with tempfile.TemporaryDirectory() as folder:
            urdf, mesh = Path(folder) / "robot.urdf", Path(folder) / "roller.stl"
            urdf.write_text(build_urdf(robot))
            roller = Roller.from_robot(robot)
            mesh.write_bytes(binary_stl(*roller.mesh(MESH_RINGS, MESH_SEGMENTS)))
            radius = roller.max_radius
            capsule = (str(radius), str(roller.length - 2.0 * radius))
            friction = str(robot.rollers.contact_friction)
            rollers = capsule if shape == "capsule" else [mesh]
            self._process = subprocess.Popen(
                [PROGRAM, urdf, str(dt_s), friction, shape, *rollers],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            self.advance(None, 0)  # after its answer, the process has read the files

    def advance(self, speeds: Sequence[float] | None, steps: int) -> RobotPose:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        words = ("coast", steps) if speeds is None else ("drive", *speeds, steps)
        try:
            print(*words, file=self._process.stdin, flush=True)
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            self.close()
            raise MecazenError(f"{PROGRAM.name} has ended with {self._process.returncode}")
        spent, x, y, _, yaw, *wheels = map(float, answer.split())
        self.spent_s += spent
        return RobotPose(x, y, yaw, wheels)

    def close(self) -> None:
        self._process.communicate()
