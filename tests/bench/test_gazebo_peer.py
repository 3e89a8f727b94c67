"""The same robot in Gazebo's physics, where it is built."""

import subprocess
from contextlib import closing

import pytest
from mecazen.errors import MecazenError
from mecazen.robot import WHEELS
from mecazen_bench import gazebo_peer, physics
from mecazen_bench.gazebo_peer import GazeboEngine
from mecazen_bench.stack import robot

STEP_S = 0.001
needs_gazebo = pytest.mark.skipif(
    not gazebo_peer.PROGRAM.exists(), reason="Gazebo's physics is not built: make gazebo"
)


@needs_gazebo
@pytest.mark.parametrize("shape", gazebo_peer.SHAPES)
def test_the_same_robot_drives_in_gazebos_physics_and_the_same_twice(shape):
    ways = []
    for _ in range(2):
        with closing(GazeboEngine(robot("nexus"), STEP_S, shape)) as engine:
            driven = engine.advance([6.0] * len(WHEELS), 300)
            ways.append([driven, engine.advance(None, 20)])
            assert engine.spent_s > 0.0
    # 6 rad/s on wheels of 5 cm for 0.3 s; it slips and judders at the start
    assert driven.x == pytest.approx(6.0 * 0.05 * 0.3, rel=0.15)
    assert driven.wheels == pytest.approx([6.0 * 0.3] * len(WHEELS), rel=0.1)
    assert ways[0][1].x > driven.x
    assert ways[0] == ways[1]


@needs_gazebo
def test_gazebos_program_says_what_it_does_not_understand_and_how_it_is_used(capfd):
    with (
        closing(GazeboEngine(robot("nexus"), STEP_S, "capsule")) as engine,
        pytest.raises(MecazenError, match="gazebo-peer has ended with 1"),
    ):
        engine.advance(["fast"], 1)
    assert capfd.readouterr().err == "gazebo-peer: not understood: drive fast 1\n"
    done = subprocess.run([gazebo_peer.PROGRAM], capture_output=True, text=True, check=False)
    assert (done.returncode, "usage" in done.stderr) == (1, True)


def test_engines_that_are_not_here_are_left_out_and_one_line_says_so(monkeypatch):
    monkeypatch.setattr(gazebo_peer, "PROGRAM", gazebo_peer.PROGRAM.with_name("not-built"))
    with physics.peers([robot("nexus")]) as (engines, missing):
        assert not any("Gazebo" in engine.name for engine in engines)
        assert sum("Gazebo" in line for line in missing) == 1
