"""The health check of a container: is a service alive, by its liveliness token."""

import os
import signal
import subprocess
import sys

import pytest
from harness import COMMAND_GUARD_S, SCENARIOS
from mecazen_tools.processes import ProcessError


def health(name: str, scenario: str, *settings: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "mecazen.health", name],
        env={**os.environ, "MECAZEN_SCENARIO": scenario, "MECAZEN_SET": " ".join(settings)},
        capture_output=True,
        text=True,
        timeout=COMMAND_GUARD_S,
        check=False,
    )
    assert not done.stderr
    return done.returncode, done.stdout.strip()


def test_a_service_is_healthy_as_long_as_it_lives(stack):
    running = stack(SCENARIOS / "teleop.toml", "sensor.also=[]")
    asked = (str(SCENARIOS / "teleop.toml"), *running.settings)
    running.launch("target")
    running.wait(lambda: "target" in running.bus.presence.names)
    assert health("target", *asked) == (0, "target: waiting for others")
    os.kill(running.supervisor.pids["target"], signal.SIGKILL)
    with pytest.raises(ProcessError, match="target"):
        running.wait(lambda: False)
    assert health("target", *asked) == (1, "error: target is not on the bus")
    code, line = health("target", asked[0], "bus.mode=star")
    assert code == 1
    assert "bus.mode" in line
    assert len(line.splitlines()) == 1
