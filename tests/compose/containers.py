"""The containers of docker-compose.yml, under a name and at ports of their own."""

import json
import os
import secrets
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

from harness import ROOT, Newest
from mecazen import keys
from mecazen.bus.ports import free_port
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.geometry import Pose2D

PORTS = ("MECAZEN_ROUTER_PORT", "MECAZEN_WEB_PORT", "MECAZEN_DATA_PORT")
GUARD_S = 120.0
"""Far beyond what anything here takes: only a hang gets there."""
STOP_S = 10.0
"""The limit for stopping everything, which takes 3 s on an idle machine."""


def run(*arguments: str, **variables: str) -> str:
    """Return what a command prints that succeeds, with variables of docker-compose.yml."""
    # only what a test says counts, not what .env or the environment say
    ours = {n: v for n, v in os.environ.items() if not n.startswith(("MECAZEN_", "COMPOSE_"))}
    done = subprocess.run(
        arguments, cwd=ROOT, env=ours | variables, check=False,
        stdin=subprocess.DEVNULL, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, f"{arguments}: {done.stdout}\n{done.stderr}"
    return done.stdout


def docker(*arguments: str) -> str:
    """Return what `docker ARGUMENTS` prints."""
    return run("docker", *arguments)


def compose() -> list[str] | None:
    """Return the command that Compose has here, None where there is none or no engine answers."""
    for command in (["docker", "compose"], ["docker-compose"]):
        try:
            run(*command, "version")
            run("docker", "info")  # Compose shows its version without an engine
        except (FileNotFoundError, AssertionError):
            continue
        return command
    return None


class Stack:
    """A project of Compose, until `down`, and a bus of the host through its router.

    Without a profile it starts what `docker compose up` starts.
    """

    def __init__(self, profile: str | None = None, **variables: str) -> None:
        self.name = f"mecazen-{secrets.token_hex(4)}"
        self.ports = {name: free_port() for name in PORTS}
        self._command = [*(compose() or ()), "--project-name", self.name]
        if profile is not None:
            self._command += ["--profile", profile]
        self._variables = {name: str(port) for name, port in self.ports.items()} | variables
        self._filters = ("--filter", f"label=com.docker.compose.project={self.name}")

    def run(self, *arguments: str) -> str:
        """Return what `docker compose ARGUMENTS` prints."""
        return run(*self._command, *arguments, **self._variables)

    def up(self) -> None:
        """Start everything."""
        self._begin = time.time()
        self.run("up", "--detach")

    def containers(self) -> dict[str, Any]:
        """Return what Docker knows of each container, by its service."""
        numbers = docker("ps", "--all", "--quiet", *self._filters).split()
        containers = json.loads(docker("inspect", *numbers)) if numbers else []
        label = "com.docker.compose.service"
        return {container["Config"]["Labels"][label]: container for container in containers}

    @property
    def endpoint(self) -> str:
        """Where the host's tools connect."""
        return f"tcp/127.0.0.1:{self.ports['MECAZEN_ROUTER_PORT']}"

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
        # all that its user may signal in the container, but the first process and this one
        crash = ["docker", "exec", self.containers()[service]["Id"], "sh", "-c", "kill -9 -1"]
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

    def await_event(self, event: str, done: Callable[[str], bool]) -> None:
        """Wait until `done` accepts a service that has had an event since `up`."""
        since = f"--since={self._begin:.3f}"
        filters = (*self._filters, f"--filter=event={event}")
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
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        with subprocess.Popen(command, text=True, **pipes) as followed:
            guard = threading.Timer(GUARD_S, followed.kill)
            guard.start()
            try:
                yield from followed.stdout
            finally:
                guard.cancel()
                followed.kill()

    def down(self) -> None:
        """Stop all containers: in time, and nothing is left of the project."""
        begin = time.monotonic()
        self.run("stop")
        stopped_s = time.monotonic() - begin
        self.run("down", "--volumes")
        assert stopped_s < STOP_S
        for kind in (("ps", "--all"), ("network", "ls"), ("volume", "ls")):
            assert docker(*kind, "--quiet", *self._filters) == ""
