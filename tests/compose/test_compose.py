"""`docker compose up` and the other profiles, from the host; and the images."""

import json
import os
import socket
import struct
import urllib.request

import msgspec
import pytest
from compose.containers import docker
from harness import ROOT, SCENARIOS, Newest
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty
from mecazen_recorder.reader import Recording
from mecazen_tools.simulate import simulate

IMAGE_BYTES = 450e6
"""Above the base, of every image but the viewer's: the limit that the project has set itself."""
LOOP = {"router", "physics", "controller", "target", "follower"}


def test_robot_follows_as_seen_from_the_host(following):
    with following.bus() as bus:
        following.await_following(bus, 0.5)
        assert bus.call(keys.SIM_STATE, Empty()).seed == 5
        scenario = bus.call(keys.SIM_SCENARIO, Empty()).data
    assert "standoff_m = 1.2" in scenario


def test_services_are_healthy_without_excess_rights(following):
    waited_for = LOOP | {"viewer"}

    def done(name):
        waited_for.discard(name)
        return not waited_for

    following.await_event("health_status: healthy", done)
    assert set(following.containers()) == LOOP | {"viewer"}
    for name, container in following.containers().items():
        host = container["HostConfig"]
        assert host["ReadonlyRootfs"], name
        assert (host["CapDrop"], host["CapAdd"] or []) == (["ALL"], []), name
        assert "no-new-privileges:true" in host["SecurityOpt"], name
        assert host["RestartPolicy"]["Name"] == "on-failure", name
        assert host["Memory"] > 0, name
        bindings = [each for port in host["PortBindings"].values() for each in port or ()]
        assert all(binding["HostIp"] == "127.0.0.1" for binding in bindings), name
        tried = "id -u; grep CapEff /proc/1/status; touch /x configs/x 2>&1 || true"
        user, capabilities, *writes = following.inside(name, "sh", "-c", tried).splitlines()
        assert int(user) != 0, name
        assert int(capabilities.split()[1], 16) == 0, name
        assert ["Read-only file system" in line for line in writes] == [True, True], name


def test_samples_bypass_the_router(following):
    (network,) = following.containers()["physics"]["NetworkSettings"]["Networks"].values()
    # as the kernel writes it: the four bytes of the address as one number of this machine
    physics = f"{struct.unpack('=I', socket.inet_aton(network['IPAddress']))[0]:08X}"
    for name in ("controller", "target", "viewer"):
        links = following.inside(name, "cat", "/proc/net/tcp").splitlines()[1:]
        assert any(link.split()[2].startswith(physics) for link in links), name


def test_printed_address_works_on_the_host(following):
    serving = "msg=serving url="
    url = following.await_line("viewer", serving).partition(serving)[2].strip()
    assert url.startswith(f"http://127.0.0.1:{following.ports['MECAZEN_WEB_PORT']}/")
    with urllib.request.urlopen(url) as page:  # noqa: S310  # http, as asserted
        assert b"rerun" in page.read().lower()
    socket.create_connection(("127.0.0.1", following.ports["MECAZEN_DATA_PORT"])).close()


@pytest.mark.parametrize("victim", ["follower", "router", "physics"])
def test_killed_service_restarts_and_following_continues(following, victim):
    following.kill(victim)
    with following.bus() as bus:
        following.await_following(bus)


def test_images_are_small(images):
    dockerfile = (ROOT / "Dockerfile").read_text()
    base = dockerfile.partition("FROM ")[2].split()[0]
    for image in set(images) - {"mecazen-viewer"}:
        inspected = docker("image", "inspect", "--format", "{{.Size}}", image, base)
        size, base_size = map(int, inspected.split())
        assert size - base_size < IMAGE_BYTES, image


def test_robot_with_sensors_follows_in_a_crowd(stacks):
    stack = stacks(None, COMPOSE_PROFILES="headless,senses,crowd", MECAZEN_SCENARIO="crowd")
    stack.up()
    with stack.bus() as bus:
        newest = [Newest(bus, topic) for topic in (keys.SCAN, keys.SKELETONS, keys.PEOPLE)]
        stack.wait(bus, lambda: all(topic.message is not None for topic in newest))
        stack.await_following(bus, 0.5)
    assert set(stack.containers()) == LOOP | {"sensors", "guard", "crowd"}


def test_lockstep_has_the_result_of_one_process(stacks):
    settings = ("sim.duration_s=6", "seed=7", "sensor.dropout_probability=0.2")
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
