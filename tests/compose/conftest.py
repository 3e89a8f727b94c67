"""Whole systems in containers, each test's under a name and at ports of its own."""

import json
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest
from compose.containers import Compose, command, docker
from harness import Newest
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError, MecazenError
from mecazen.geometry import Pose2D

GUARD_S = 120.0
"""Far beyond what anything here takes: only a hang gets there."""

STOP_S = 10.0
"""The limit for stopping everything, which takes 3 s on an idle machine."""

BUILT = [
    "router",
    "physics",
    "controller",
    "target",
    "follower",
    "viewer",
    "recorder",
    "sensors",
    "guard",
]
"""Services of docker-compose.yml, one for each image; `crowd` runs in that of `target`."""


class Stack(Compose):
    """Containers that run, and a bus of the host through their router."""

    def up(self) -> None:
        """Start everything."""
        self.begin = time.time()
        self.run("up", "--detach")

    @contextmanager
    def bus(self) -> Iterator[ZenohBus]:
        """Connect as the host's tools do, once the router listens."""
        end = time.monotonic() + GUARD_S
        while True:
            try:
                bus = ZenohBus(BusConfig(connect=(self.endpoint,)), "client")
                break
            except BusError:
                assert time.monotonic() < end, "the router does not listen"
        with closing(bus):
            yield bus

    def inside(self, service: str, *command: str) -> str:
        """Return what a command in a service's container prints."""
        return docker("exec", self.containers()[service]["Id"], *command)

    def kill(self, service: str) -> None:
        """Kill a service as a crash does, and wait until its container runs again."""
        number = self.containers()[service]["Id"]
        # all that its user may signal in the container, but the first process and this one
        crash = ["docker", "exec", number, "sh", "-c", "kill -9 -1"]
        subprocess.run(crash, check=False)
        self.await_event(
            "start",
            lambda name: name == service and self.containers()[service]["RestartCount"] > 0,
        )

    def wait(self, bus: ZenohBus, condition: Callable[[], bool]) -> None:
        """Deliver samples until a condition holds."""
        end = time.monotonic() + GUARD_S
        while not condition():
            assert time.monotonic() < end, f"what was waited for did not come: {self.run('logs')}"
            bus.spin_once(0.1)

    def await_following(self, bus: ZenohBus, distance_m: float = 0.0) -> None:
        """Wait until the robot follows, and is so far from its start."""
        topics = keys.FOLLOWER_STATE, keys.ODOM, keys.TARGET_ODOM
        state, robot, person = newest = [Newest(bus, topic) for topic in topics]

        def follows() -> bool:
            if any(topic.message is None for topic in newest):
                return False
            moved = robot.pose.distance(Pose2D(-1.0))  # from the start of `back`
            apart = robot.pose.distance(person.pose)
            # it is to keep 1.2 m; one that stands still soon falls behind
            is_near = moved > distance_m and 0.8 < apart < 1.6
            return is_near and state.message.tracking == "following"

        self.wait(bus, follows)

    def down(self) -> None:
        """Stop all containers: in time, and nothing is left of the project."""
        begin = time.monotonic()
        self.run("stop")
        stopped_s = time.monotonic() - begin
        self.close()
        assert stopped_s < STOP_S
        for kind in (("ps", "--all"), ("network", "ls"), ("volume", "ls")):
            assert docker(*kind, "--quiet", *self.filters) == ""

    def await_event(self, event: str, done: Callable[[str], bool]) -> None:
        """Wait until `done` accepts a service that has had an event since `up`."""
        since = f"--since={self.begin:.3f}"
        filters = (*self.filters, f"--filter=event={event}")
        for line in self._follow("events", "--format", "{{json .}}", since, *filters):
            report: dict[str, Any] = json.loads(line)
            service = report["Actor"]["Attributes"]["com.docker.compose.service"]
            if event in report["status"] and done(service):
                return
        raise AssertionError(f"no {event} in {GUARD_S:g} s: {self.run('logs')}")

    def await_line(self, service: str, words: str) -> str:
        """Return the first line with some words in it that a service logs."""
        lines = self._follow("logs", "--follow", self.containers()[service]["Id"])
        return next(line for line in lines if words in line)

    def _follow(self, *arguments: str) -> Iterator[str]:
        command = ["docker", *arguments]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as followed:
            guard = threading.Timer(GUARD_S, followed.kill)
            guard.start()
            try:
                yield from followed.stdout
            finally:
                guard.cancel()
                followed.kill()


@pytest.fixture(scope="session")
def images():
    """All images, as this checkout makes them."""
    try:
        command()
    except MecazenError as error:
        pytest.skip(str(error))
    Compose().run("build", *BUILT)
    return tuple(f"mecazen-{name}" for name in BUILT)


@pytest.fixture(scope="module")
def following(images):
    """The stack of `docker compose up`, with a seed and a standoff of its own."""
    stack = Stack(MECAZEN_SET="seed=5 follower.standoff_m=1.2")
    try:
        stack.up()
        yield stack
    finally:
        stack.down()


@pytest.fixture
def stacks(images):
    """Make stacks of containers that are removed after the test."""
    made = []

    def make(profile, **environment):
        made.append(Stack(profile, **environment))
        return made[-1]

    yield make
    for stack in made:
        stack.down()
