"""The other profiles of docker-compose.yml, from the host; and the images."""

import json
import os
import subprocess
import sys

import msgspec
import pytest
from compose.containers import docker
from harness import ROOT, SCENARIOS, Newest
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen_recorder.reader import Recording
from mecazen_tools.simulate import simulate

IMAGE_BYTES = 450e6
"""Above the base, of every image but the viewer's: the limit that the project has set itself."""
LOCKSTEP_S = 6.0
LOOP = {"router", "physics", "controller", "target", "follower"}


def test_images_are_small(images):
    base = next(
        line.split()[1]
        for line in (ROOT / "Dockerfile").read_text().splitlines()
        if line.startswith("FROM")
    )
    for name in set(images) - {"mecazen-viewer"}:
        sizes = [
            int(docker("image", "inspect", "--format", "{{.Size}}", image))
            for image in (name, base)
        ]
        assert sizes[0] - sizes[1] < IMAGE_BYTES, name


def test_teleop_is_driven_by_zenoh_cli_on_the_host(stacks):
    stack = stacks("teleop")
    stack.up()
    robot = []
    zenoh = [sys.executable, "-m", "zenoh_cli", "--mode", "client", "--connect", stack.endpoint]
    with stack.bus() as bus:
        bus.subscribe(keys.ODOM, lambda odom, _: robot.append(odom.pose.pose.position.x))
        stack.wait(bus, lambda: bool(robot))
        assert robot[-1] == robot[0] == -1.0
        subprocess.run([*zenoh, "put", "-k", "cmd_vel", "-v", '{"linear":{"x":0.3}}'], check=True)
        # one command drives 0.3 m/s for 0.5 s, less what it takes to speed up
        stack.wait(bus, lambda: robot[-1] > robot[0] + 0.1)
    assert set(stack.containers()) == {
        "router", "teleop-physics", "teleop-controller", "teleop-target", "teleop-sensors",
        "teleop-guard", "teleop-viewer",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("profiles", "settings", "beside", "topics"),
    [
        ("senses", {"MECAZEN_SET": "sensor.kind=fused"}, set(), ()),
        ("senses,crowd", {"MECAZEN_SCENARIO": "crowd"}, {"crowd"}, (keys.PEOPLE,)),
    ],
    ids=["alone", "in a crowd"],
)
def test_a_robot_follows_by_sensors_in_a_container_of_their_own(
    stacks, profiles, settings, beside, topics
):
    stack = stacks(None, COMPOSE_PROFILES=f"headless,{profiles}", **settings)
    stack.up()
    with stack.bus() as bus:
        newest = [Newest(bus, topic) for topic in (keys.SCAN, keys.SKELETONS, *topics)]
        stack.wait(bus, lambda: all(one.message is not None for one in newest))
        stack.await_following(bus, 0.5)
    assert set(stack.containers()) == LOOP | {"sensors", "guard"} | beside


def test_a_run_in_lockstep_ends_by_itself_with_the_result_of_one_process(stacks):
    settings = (f"sim.duration_s={LOCKSTEP_S}", "seed=7", "sensor.dropout_probability=0.2")
    stack = stacks("lockstep", MECAZEN_SCENARIO="side", MECAZEN_SET=" ".join(settings))
    stack.run("up", "--abort-on-container-exit", "--exit-code-from", "score")
    result = json.loads(docker("logs", stack.containers()["score"]["Id"]))
    scenario = load_scenario(SCENARIOS / "side.toml", parse_settings(settings))
    expected = msgspec.to_builtins(simulate(scenario, "side")[0])
    for fields in (result, expected):
        del fields["wall_s"], fields["rtf"]
    assert result == expected


def test_a_recording_outlives_its_recorder(stacks, tmp_path):
    user, group = os.getuid() or 1000, os.getgid() or 1000
    os.chown(tmp_path, user, group)
    stack = stacks(
        "record",
        MECAZEN_RECORDINGS=str(tmp_path),
        MECAZEN_UID=str(user),
        MECAZEN_GID=str(group),
    )
    stack.up()
    with stack.bus() as bus:
        stack.await_following(bus, 0.05)
    assert set(stack.containers()) == LOOP | {"recorder"}
    stack.kill("recorder")
    with stack.bus() as bus:
        stack.wait(bus, lambda: "recorder/ready" in bus.alive())
    stack.run("stop")
    recordings = sorted(tmp_path.glob("*.mcap"))
    assert len(recordings) == 2
    for file in recordings:
        samples = [sample.key for sample in Recording(file).samples()]
        assert {"odom", "cmd_vel", "target/observation"} <= set(samples)
