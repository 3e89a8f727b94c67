"""The sensors of a real robot: what no node of the scenario gives comes from ROS."""

import math

import pytest
from harness import SCENARIOS, Newest
from mecazen import keys
from mecazen.messages import Empty, LaserScan
from mecazen_ros import cdr
from mecazen_ros.interfaces import service

SCAN = LaserScan(range_min=0.1, range_max=12.0, ranges=(0.5, math.inf, math.nan))


@pytest.fixture(scope="module")
def running(up):
    """A robot behind a guard, as a dry run: the lidar is missing."""
    services = 'services=["hardware","controller"]'
    robot = "robot=rosmaster_x3"
    return up(SCENARIOS / "teleop.toml", services, robot, "hardware.dry_run=true")


@pytest.fixture(scope="module")
def there(running, raw_node):
    return raw_node(running.endpoint)


@pytest.fixture
def key_of(running, there):
    """Return the key of a declared topic or service."""
    prefix = f"/{running.scenario.bus.namespace}"
    return lambda kind, name: there.key_of(kind, f"{prefix}/{name}")


def test_a_scan_of_a_ros_driver_reaches_the_services(running, there, key_of):
    heard = Newest(running.bus, keys.SCAN)
    key = key_of("MS", "scan")

    def comes() -> bool:
        there.put(key, cdr.encode(SCAN))
        return heard.message is not None

    running.wait(comes)
    assert heard.message.ranges == (0.5, 13.0, 0.0)


def test_the_emergency_stop_is_a_topic_and_a_service_of_ros(running, there, key_of):
    health = Newest(running.bus, keys.diagnostics("hardware"))
    key = key_of("MS", "emergency_stop")

    def stops() -> bool:
        there.put(key, cdr.encode(Empty()))
        values = [] if health.message is None else health.message.status[0].values
        return any("emergency stop" in pair.value for pair in values)

    running.wait(stops)
    trigger = service("std_srvs/srv/Trigger")
    (answer,) = there.call(key_of("SS", "emergency_stop/release"), cdr.encode(trigger.request()))
    told = cdr.decode(answer.payload, trigger.response)
    assert (told.success, told.message) == (True, "released")
