"""The containers of docker-compose.yml, under a name and at ports of their own."""

from __future__ import annotations

import os
import secrets
import socket
import subprocess
from contextlib import ExitStack
from typing import Any

import msgspec
from harness import ROOT
from mecazen.errors import MecazenError

PORTS = ("MECAZEN_ROUTER_PORT", "MECAZEN_WEB_PORT", "MECAZEN_DATA_PORT")
VARIABLES = (*PORTS, "MECAZEN_SCENARIO", "MECAZEN_SET", "COMPOSE_PROFILES", "COMPOSE_FILE")
"""What docker-compose.yml and .env are to say, unless it is said here."""


def command() -> list[str]:
    """Return the command that Compose has here.

    Raises:
        MecazenError: There is none, or no engine answers; in one line.
    """
    reason = "docker is not installed"
    for arguments in (["docker", "compose"], ["docker-compose"]):
        try:
            # the second probe reaches the engine: Compose shows its version without one
            for probe in ([*arguments, "version"], ["docker", "info"]):
                subprocess.run(probe, capture_output=True, text=True, check=True)
        except FileNotFoundError:
            continue
        except subprocess.CalledProcessError as error:
            reason = (error.stderr.strip().splitlines() or ["docker does not answer"])[-1]
            continue
        return arguments
    raise MecazenError(f"no containers here: {reason}")


class Compose:
    """One project of Compose, until `close`, with variables of docker-compose.yml.

    Without a profile it starts what `docker compose up` starts. Raises as `command`.
    """

    def __init__(self, profile: str | None = None, **environment: str) -> None:
        self.name = f"mecazen-{secrets.token_hex(4)}"
        with ExitStack() as taken:  # all at once, so that they differ
            servers = [taken.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in PORTS]
            numbers = [server.getsockname()[1] for server in servers]
        self.ports: dict[str, int] = dict(zip(PORTS, numbers, strict=True))
        self._command = [*command(), "--project-name", self.name]
        if profile is not None:
            self._command += ["--profile", profile]
        ours = {name: value for name, value in os.environ.items() if name not in VARIABLES}
        ports = {name: str(port) for name, port in self.ports.items()}
        self._environment = {**ours, **ports, **environment}

    @property
    def endpoint(self) -> str:
        """Where the host's tools connect."""
        return f"tcp/127.0.0.1:{self.ports['MECAZEN_ROUTER_PORT']}"

    def run(self, *arguments: str) -> str:
        """Return what `docker compose ARGUMENTS` prints; raises as `docker`."""
        return _run(*self._command, *arguments, environment=self._environment)

    def containers(self) -> dict[str, Any]:
        """Return what Docker knows of each container, by its service."""
        numbers = docker("ps", "--all", "--quiet", *self.filters).split()
        found = msgspec.json.decode(docker("inspect", *numbers)) if numbers else []
        return {one["Config"]["Labels"]["com.docker.compose.service"]: one for one in found}

    @property
    def filters(self) -> tuple[str, ...]:
        """Options that select this project in `docker ps` and alike commands."""
        return ("--filter", f"label=com.docker.compose.project={self.name}")

    def close(self) -> None:
        """End and remove all of it."""
        self.run("down", "--volumes")


def docker(*arguments: str) -> str:
    """Return what `docker ARGUMENTS` prints.

    Raises:
        MecazenError: It failed; with all that it said.
    """
    return _run("docker", *arguments)


def _run(*arguments: str, environment: dict[str, str] | None = None) -> str:
    options: dict[str, Any] = {"stdin": subprocess.DEVNULL, "capture_output": True, "text": True}
    done = subprocess.run(arguments, cwd=ROOT, env=environment, check=False, **options)
    if done.returncode != 0:
        said = f"{done.stdout}\n{done.stderr}".strip()
        raise MecazenError(f"{' '.join(arguments)}: {said}")
    return str(done.stdout)
