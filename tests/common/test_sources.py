"""Which session publishes what a service alone publishes: real sessions on loopback."""

import pytest
from harness import wait
from mecazen import keys
from mecazen.messages import Odometry
from mecazen.wire import Stamp

AT = Stamp(0, 7, 3)


def heard_of(bus, service):
    """Return the senders, by their frame, of the odometry that counts as the service's."""
    heard = []
    bus.subscribe(keys.ODOM, lambda odom, _: heard.append(odom.child_frame_id), of=service)
    bus.declare_alive("ear")
    return heard


def say(bus, name, stamp=AT):
    bus.publisher(keys.ODOM).put(Odometry(child_frame_id=name), stamp)


def meet(ear, bus, name):
    bus.declare_alive(name)
    wait(bus, lambda: "ear" in bus.presence.names)
    wait(ear, lambda: name in ear.presence.names)


@pytest.fixture
def three(open_bus):
    """Three sessions, the first of which hears the odometry of the controller, and the senders."""
    ear, one, other = open_bus(), open_bus(), open_bus()
    return ear, one, other, heard_of(ear, "controller")


def test_samples_of_another_session_are_refused_and_counted(three):
    ear, service, other, heard = three
    meet(ear, service, "controller")
    meet(ear, other, "other")
    say(service, "service")
    wait(ear, lambda: heard == ["service"])
    say(other, "other")
    other.put_bytes("odom", b"{}")  # as by the Zenoh command line, which names no source
    wait(ear, lambda: ear.refused["odom"] == 2)
    say(service, "service")
    wait(ear, lambda: heard == ["service"] * 2)


def test_a_service_that_has_started_again_has_another_session(three):
    ear, service, again, heard = three
    meet(ear, service, "controller")
    say(service, "service")
    wait(ear, lambda: heard == ["service"])
    service.close()
    wait(ear, lambda: "controller" not in ear.presence.names)
    meet(ear, again, "controller")
    say(again, "again")
    wait(ear, lambda: heard == ["service", "again"])
    assert not ear.refused


def test_a_session_that_publishes_before_the_service_comes_does_not_keep_it_out(three):
    ear, service, other, heard = three
    meet(ear, other, "other")
    say(other, "other")
    wait(ear, lambda: heard == ["other"])
    meet(ear, service, "controller")
    say(service, "service")
    wait(ear, lambda: heard == ["other", "service"])
