"""The same robot in Gazebo's physics: bench/gazebo/gazebo_peer.cpp, which `make` builds."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from mecazen.errors import MecazenError
from mecazen.robot import Robot
from mecazen_physics.rollers import Roller, binary_stl
from mecazen_physics.urdf import build_urdf

from mecazen_bench.energy import Sample

Shape = Literal["capsule", "mesh"]
SHAPES: tuple[Shape, ...] = get_args(Shape)

PROGRAM = Path(__file__).parents[1] / "build" / "gazebo-peer"
MESH_RINGS, MESH_SEGMENTS = 10, 11
"""220 triangles, as many as a roller of the published models for Gazebo has."""


class GazeboEngine:
    """A robot in Gazebo's default engine, as a process; see `mecazen_bench.engine.Engine`.

    Raises:
        MecazenError: The program ends; it has said why.
    """

    def __init__(self, robot: Robot, dt_s: float, shape: Shape) -> None:
        self.name = f"Gazebo, {shape}"
        self.robot = robot
        self.dt_s = dt_s
        self.spent_s = 0.0
        with tempfile.TemporaryDirectory() as folder:
            urdf, mesh = Path(folder) / "robot.urdf", Path(folder) / "roller.stl"
            urdf.write_text(build_urdf(robot))
            roller = Roller.of(robot)
            mesh.write_bytes(binary_stl(*roller.mesh(MESH_RINGS, MESH_SEGMENTS)))
            radius = roller.max_radius
            arguments = {
                "capsule": (str(radius), str(roller.length - 2.0 * radius)),
                "mesh": (str(mesh),),
            }
            self._process = subprocess.Popen(
                [PROGRAM, urdf, str(dt_s), shape, *arguments[shape]],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            self.coast(0)  # it has read the files when it answers

    def advance(self, speeds: Sequence[float], steps: int) -> Sample:
        """Simulate some steps; see `Engine`."""
        return self._ask("drive", *speeds, steps)

    def coast(self, steps: int) -> Sample:
        """Simulate some steps without the motors; see `Engine`."""
        return self._ask("coast", steps)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _ask(self, *words: object) -> Sample:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            print(*words, file=self._process.stdin, flush=True)
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            self.close()
            raise MecazenError(f"{PROGRAM.name} has ended with {self._process.returncode}")
        spent, x, y, z, yaw, *wheels = map(float, answer.split())
        self.spent_s += spent
        return Sample(x, y, z, yaw, wheels)
