"""The programs that publish on a key, named by the router and by the processes of this machine."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
from mecazen.bus.base import UNNAMED
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import LIVELINESS
from mecazen.keys import TOPICS, Topic, resolve
from mecazen.text import shortened

LOOPBACK = "127.0.0.1"


class Programs:
    """The programs that are connected to the router of a bus, by their Zenoh ids.

    The router knows the publishers and the liveliness tokens of all programs, and the addresses of
    its own clients. A client that only calls Zenoh's `put`, as `zenoh put` does, declares nothing.
    """

    def __init__(self, bus: ZenohBus | None = None) -> None:
        self.publishers: defaultdict[str, list[str]] = defaultdict(list)
        """Zenoh ids of the declared publishers of each key, in and outside the namespace."""
        self._subscribers: defaultdict[str, list[str]] = defaultdict(list)
        self._prefix = bus.prefix if bus else ""
        self._names = {UNNAMED: "a program that declares no publisher"}
        self._services: defaultdict[str, list[str]] = defaultdict(list)
        self._nodes: set[str] = set()
        self._addresses: dict[str, str] = {}
        declared: set[str] = set()
        for entry, payload in bus.router_entries().items() if bus else ():
            kind, _, key = entry.partition("/")
            if kind == "router":
                for session in msgspec.json.decode(payload)["sessions"]:
                    for link in session["links"]:
                        self._addresses[session["peer"]] = link["dst"]
            elif key:
                holders = msgspec.json.decode(payload)
                programs = [*holders["peers"], *holders["clients"]]
                declared.update(programs)
                if kind == "publisher":
                    self.publishers[key] += programs
                elif kind == "subscriber" and "*" not in key:
                    self._subscribers[key] += programs
                name = key.removeprefix(self._prefix)
                robot, is_token, service = name.rpartition(f"{LIVELINESS}/")
                if is_token and "/" not in service:
                    self._nodes.add(service)
                    for program in programs:
                        self._services[program].append(f"{robot}{service}")
        self._silent = [program for program in self._addresses if program not in declared]
        """Programs without a publisher, subscriber or token: they only put, or ask and answer."""

    def name(self, program: str) -> str:
        """Return the services of a program, or its process, or its address and Zenoh id."""
        if program in self._services:
            return "+".join(sorted(self._services[program]))
        if program not in self._names:
            host, _, port = self._addresses.get(program, "").rpartition("/")[2].rpartition(":")
            address = f" at {host}" if host else ""
            process = _process_at(int(port)) if host == LOOPBACK else None
            self._names[program] = process or f"Zenoh id {program[:8]}{address}"
        return self._names[program]

    def on(self, key: str, senders: Collection[str]) -> list[str]:
        """Return the names of the programs whose samples on a key have arrived.

        Args:
            key: The key, with the robot's name.
            senders: The programs, see `Bus.senders`.
        """
        active = [program for program in senders if program != UNNAMED]
        if UNNAMED in senders:
            programs = self.publishers.get(self._prefix + key, ())
            unnamed = [p for p in programs if p not in self._services and p not in active]
            tool = f"pid {os.getpid()}:"
            silent = [p for p in self._silent if not self.name(p).startswith(tool)]
            active += unnamed or (silent if len(silent) == 1 else [UNNAMED])
        return [self.name(program) for program in active]

    def in_vain(self, heard: Iterable[str] = ()) -> list[str]:
        """Return warnings about commands on keys that no service reads, as `rt/cmd_vel`.

        Keys are those outside the namespace. `heard` are keys of samples that have arrived, since
        programs need not declare a publisher.
        """
        warnings = []
        for key, programs in ({key: [UNNAMED] for key in heard} | self.publishers).items():
            strangers = [program for program in programs if program not in self._services]
            topic = self._commanded(key)
            if not strangers or topic is None:
                continue
            read = [
                name
                for name, readers in self._subscribers.items()
                # in ROS, services have sessions without a token, and keys with a type
                if self._commanded(name) is topic
                and ("::" in name or self._services.keys() & readers)
            ]
            if key in read or not read:
                continue
            alike = [name for name in read if ("::" in name) == ("::" in key)]
            hint = "" if alike else "; ROS needs `mecazen up --ros2`"
            keys = ", ".join(map(shortened, sorted(alike or read)))
            names = " and ".join(self.on(key, strangers))
            problem = f"{shortened(key)}: no service reads this key, only {keys}{hint}"
            warnings.append(f"{problem} (publisher: {names})")
        return warnings

    def _commanded(self, key: str) -> Topic[Any] | None:
        """Return the open topic that a key names with a prefix or in rmw_zenoh's form, or None."""
        name = key.rsplit("/", 2)[0] if "::" in key else key  # domain/name/type/hash
        prefix, topic = resolve(name, TOPICS)
        is_output = prefix.rpartition("/")[2] in self._nodes  # as follower/cmd_vel in ROS
        return topic if topic is not None and topic.open and not is_output else None


def _process_at(port: int) -> str | None:
    """Return pid and command line of the local process with a TCP port; None: it is not visible."""
    rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    sockets = {f"socket:[{row[9]}]" for row in rows if row[1].endswith(f":{port:04X}")}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # the process has ended, or is another user's
            if any(str(file.readlink()) in sockets for file in (folder / "fd").iterdir()):
                words = (folder / "cmdline").read_text().rstrip("\0").split("\0")
                if words[1:] and "/bin/" in words[1]:
                    del words[0]  # the interpreter of an installed command
                return (
                    f"pid {folder.name}: {shortened(' '.join([Path(words[0]).name, *words[1:]]))}"
                )
    return None
