"""`docker compose up` with nothing else, from the host: following, with the viewer."""

import socket
import struct
import urllib.request

import pytest
from mecazen import keys
from mecazen.messages import Empty

SERVICES = {"router", "physics", "controller", "target", "follower", "viewer"}


def test_the_robot_follows_and_is_seen_from_the_host(following):
    with following.bus() as bus:
        following.await_following(bus, 0.5)
        assert bus.call(keys.SIM_STATE, Empty()).seed == 5
        scenario = bus.call(keys.SIM_SCENARIO, Empty()).data
    assert "standoff_m = 1.2" in scenario


def test_every_service_becomes_healthy(following):
    waited_for = set(SERVICES)

    def done(name):
        waited_for.discard(name)
        return not waited_for

    following.await_event("health_status: healthy", done)
    assert set(following.containers()) == SERVICES


def test_containers_have_no_rights_that_they_do_not_need(following):
    for name, container in following.containers().items():
        host = container["HostConfig"]
        assert host["ReadonlyRootfs"], name
        assert host["CapDrop"] == ["ALL"], name
        assert not host["CapAdd"], name
        assert "no-new-privileges:true" in host["SecurityOpt"], name
        assert host["RestartPolicy"]["Name"] == "on-failure", name
        assert host["Memory"] > 0, name
        bindings = [each for port in host["PortBindings"].values() for each in port or ()]
        assert all(binding["HostIp"] == "127.0.0.1" for binding in bindings), name
        tried = following.inside(
            name, "sh", "-c", "id -u; grep CapEff /proc/1/status; touch /x configs/x 2>&1 || true"
        ).splitlines()
        assert int(tried[0]) != 0, name
        assert int(tried[1].split()[1], 16) == 0, name
        assert ["Read-only file system" in line for line in tried[2:]] == [True, True], name


def test_samples_go_from_service_to_service_and_not_through_the_router(following):
    (network,) = following.containers()["physics"]["NetworkSettings"]["Networks"].values()
    # as the kernel writes it: the four bytes of the address as one number of this machine
    physics = f"{struct.unpack('=I', socket.inet_aton(network['IPAddress']))[0]:08X}"
    for name in ("controller", "target", "viewer"):
        links = following.inside(name, "cat", "/proc/net/tcp").splitlines()[1:]
        assert any(link.split()[2].startswith(physics) for link in links), name


def test_the_printed_address_is_one_for_the_hosts_browser(following):
    serving = "msg=serving url="
    url = following.await_line("viewer", serving).partition(serving)[2].strip()
    assert url.startswith(f"http://127.0.0.1:{following.ports['MECAZEN_WEB_PORT']}/")
    with urllib.request.urlopen(url) as page:  # noqa: S310  # http, as asserted
        assert b"rerun" in page.read().lower()
    socket.create_connection(("127.0.0.1", following.ports["MECAZEN_DATA_PORT"])).close()


@pytest.mark.parametrize("victim", ["follower", "router", "physics"])
def test_a_service_that_is_killed_comes_back_and_following_goes_on(following, victim):
    following.kill(victim)
    with following.bus() as bus:
        following.await_following(bus)
