"""The examples, and other programs of a user: nodes of a scenario, and processes of plain Zenoh."""

import importlib.util
import os
import subprocess
import sys
from contextlib import closing

import msgspec
import numpy as np
import pytest
from harness import ROOT, SCENARIOS, Newest, here, tools
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario
from mecazen_gym.policy import SIZE
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.cli.up import settings_without

BACK = SCENARIOS / "back.toml"


PLAIN = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
session = zenoh.open(config)
publisher = session.declare_publisher(sys.argv[2])
for line in sys.stdin:
    publisher.put('{"linear":{"x":0.1}}')
"""


@pytest.fixture
def programs():
    """Start plain programs of Python; they end with the test."""
    started = []

    def start(*arguments):
        environment = {"PATH": os.environ["PATH"]}  # nothing of mecazen
        command = [sys.executable, *map(str, arguments)]
        process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdin.close()


def test_programs_that_drive_are_named_and_so_are_commands_that_no_service_reads(
    stack, programs, tmp_path
):
    running = stack(BACK)
    running.start()
    namespace = running.scenario.bus.namespace
    (tmp_path / "plain.py").write_text(PLAIN)
    with closing(ZenohBus(running.scenario.bus, "client")) as tool:
        diagnostics = Diagnostics(tool, closely=True)

        def drivers():
            tool.drain()
            return diagnostics.drives().get("", "")

        running.wait(lambda: drivers() == "follower")
        command = tmp_path / "plain.py", running.endpoint
        plain = programs(*command, f"{namespace}/cmd_vel")

        def put():
            plain.stdin.write("\n")
            plain.stdin.flush()
            return drivers()

        running.wait(lambda: f"pid {plain.pid}: python" in put())
        assert "follower and pid" in here(*tools(running.scenario.bus), "topics", "--live").stdout
        declared = programs(*command, "rt/cmd_vel")
        warning = (
            f"rt/cmd_vel: no service reads this key, only {namespace}/cmd_vel "
            f"(publisher: pid {declared.pid}: "
        )
        running.wait(lambda: warning in "\n".join(diagnostics.contests()))
        declared.kill()
        running.wait(lambda: warning not in "\n".join(diagnostics.contests()))


def test_a_process_of_plain_zenoh_follows(stack, programs, tmp_path):
    here("new", "process", "my_process", folder=tmp_path)
    running = stack(BACK, *settings_without(load_scenario(BACK), ["follower"]))
    robot, person = (Newest(running.bus, topic) for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM))
    running.start()
    file = tmp_path / "my_process.py"
    source = file.read_text()  # its keys are those of a run without a namespace
    for key in ("cmd_vel", "target/observation"):
        source = source.replace(f'"{key}"', f'"{running.scenario.bus.namespace}/{key}"')
    file.write_text(source)
    programs(file, running.endpoint)
    running.wait(lambda: robot.message and person.message and robot.pose.x > 0.0)
    # it lags by speed over gain, 0.2/1.5 m
    assert robot.pose.distance(person.pose) == pytest.approx(1.13, abs=0.1)


def test_training_writes_weights_that_compare_takes(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("train", ROOT / "examples" / "train.py")
    train = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(train)
    for name, value in {"CANDIDATES": 4, "PERSONS": 2, "WALKS": train.WALKS[-1:]}.items():
        monkeypatch.setattr(train, name, value)
    train.main(str(tmp_path / "mine.npz"), "1")
    weights = np.load(tmp_path / "mine.npz")["weights"]
    assert weights.shape == (SIZE,)
    assert weights.any()
    short = ("--seeds", "1", "--duration", "1", "--json")
    compared = here("compare", "back", "policy:mine.npz", "default", *short, folder=tmp_path)
    means = msgspec.json.decode(compared.stdout)["means"]
    assert [*means] == ["mine.npz", "default"], compared.stderr
