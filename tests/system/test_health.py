"""The health check of a container: is a service alive, by its liveliness token."""

import os
import signal
import subprocess
import sys

import pytest
from harness import COMMAND_GUARD_S, SCENARIOS
from mecazen_tools.processes import ProcessError, private_router


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


@pytest.mark.parametrize(
    ("scenario", "settings", "words"),
    [
        (str(SCENARIOS / "back.toml"), private_router()[:1], "nothing answers"),
        (str(SCENARIOS / "back.toml"), ("bus.mode=star",), "bus.mode"),
        ("/nowhere.toml", (), "/nowhere.toml"),
    ],
)
def test_what_can_not_be_asked_is_one_line(scenario, settings, words):
    code, said = health("physics", scenario, *settings)
    assert code == 1
    assert words in said
    assert len(said.splitlines()) == 1
