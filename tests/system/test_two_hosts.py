"""Services on two hosts: network namespaces, and between them a slow link that loses and breaks."""

import fcntl
import json
import os
import random
import secrets
import select
import shutil
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, options
from mecazen_tools import certificates

BACK = SCENARIOS / "back.toml"
SECURE = ROOT / "configs" / "zenoh" / "secure.json5"

DELAY_S = 0.005
LOSS = 0.01
CUT_S = 3.0
MAX_DECELERATION = 2.5
"""The controller's limit, as the scenario has it [m/s²]."""

TUN = Path("/dev/net/tun")
TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000

pytestmark = [
    pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces need root"),
    pytest.mark.skipif(shutil.which("ip") is None, reason="network namespaces need iproute2"),
    pytest.mark.skipif(not TUN.exists(), reason="the link between hosts needs /dev/net/tun"),
]


def ip(*arguments: str) -> None:
    command = ["ip", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


class Host:
    """A network namespace with one address, at one end of the link."""

    def __init__(self, address: str, stack: ExitStack) -> None:
        self.name = f"mecazen{secrets.token_hex(3)}"
        self.address = address
        ip("netns", "add", self.name)
        stack.callback(ip, "netns", "del", self.name)
        # packets, not frames, and as long as the device allows: nothing is left to hardware
        device = f"mz{secrets.token_hex(3)}"
        self.packets = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        stack.callback(os.close, self.packets)
        request = struct.pack("16sH22x", device.encode(), IFF_TUN | IFF_NO_PI)
        fcntl.ioctl(self.packets, TUNSETIFF, request)
        ip("link", "set", device, "netns", self.name)
        ip("-n", self.name, "addr", "add", f"{address}/24", "dev", device)
        for one in ("lo", device):
            ip("-n", self.name, "link", "set", one, "up")

    def run(self, *arguments: str, **options: Any) -> subprocess.Popen[str]:
        command = ["ip", "netns", "exec", self.name, sys.executable, "-m", *arguments]
        return subprocess.Popen(command, text=True, **options)


class Link(threading.Thread):
    """Carries packets between two hosts: late, not all of them, and none while it is cut."""

    def __init__(self, near: Host, far: Host) -> None:
        super().__init__(daemon=True)
        self.is_cut = False
        self._to = {near.packets: far.packets, far.packets: near.packets}
        self._random = random.Random(5)
        self._on_their_way: deque[tuple[float, int, bytes]] = deque()
        self._wake, self._end = os.pipe()

    def run(self) -> None:
        while True:
            wait = self._on_their_way[0][0] - time.monotonic() if self._on_their_way else None
            ends = [*self._to, self._wake]
            ready = select.select(ends, [], [], None if wait is None else max(wait, 0.0))[0]
            if self._wake in ready:
                return
            for end in ready:
                packet = os.read(end, 65536)
                if not self.is_cut and self._random.random() >= LOSS:
                    self._on_their_way.append((time.monotonic() + DELAY_S, self._to[end], packet))
            while self._on_their_way and self._on_their_way[0][0] <= time.monotonic():
                _, end, packet = self._on_their_way.popleft()
                if not self.is_cut:
                    os.write(end, packet)

    def close(self) -> None:
        os.close(self._end)
        self.join()
        os.close(self._wake)


class Echo:
    """The newest message of a key, as `mecazen echo` prints it on a host."""

    def __init__(self, host: Host, key: str, tools: list[str]) -> None:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self.process = host.run("mecazen_tools", *tools, "echo", key, **pipes)
        self.messages: list[Any] = []
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            with self._changed:
                self.messages.append(json.loads(line))
                self._changed.notify_all()

    def wait(self, condition: Callable[[Any], bool]) -> Any:
        """Return the first message that a condition holds for, from now on."""
        seen = len(self.messages)
        with self._changed:
            met = self._changed.wait_for(
                lambda: len(self.messages) > seen and condition(self.messages[-1]), COMMAND_GUARD_S
            )
            assert met, f"what was waited for did not come; the last was {self.messages[-1:]}"
            return self.messages[-1]

    def close(self) -> None:
        self.process.kill()
        self._thread.join()
        self.process.stdout.close()
        self.process.wait()


class Hosts:
    """Physics and controller with the router on one host, target and follower on the other."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        near, far = Host("10.77.0.1", stack), Host("10.77.0.2", stack)
        self.link = Link(near, far)
        self.link.start()
        stack.callback(self.link.close)
        certificates.create(folder, [near.address, far.address])
        endpoint = f"tls/{near.address}:7447"
        tools = ["--connect", endpoint, "--tls", str(folder)]
        settings = [f'bus.connect=["{endpoint}"]', f"bus.zenoh_config={SECURE}"]
        settings += [f"bus.keys={folder}", "bus.mode=client", "target.path.start_after_s=0.0"]
        for host, names in (
            (near, ("router", "physics", "controller")),
            (far, ("target", "follower")),
        ):
            for name in names:
                service = "mecazen.runtime", name, str(BACK), *options(settings)
                process = host.run(*service, stderr=subprocess.PIPE)
                stack.callback(end, process)
                if name == "router":
                    assert "msg=started" in process.stderr.readline()
        self.truth, self.commands, self.state = (
            stack.enter_context(closing(Echo(host, key, tools)))
            for host, key in (
                (near, "ground_truth/odom"),
                (near, "cmd_vel"),
                (far, "follower/state"),
            )
        )


def end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.communicate(timeout=10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


@pytest.fixture
def hosts(tmp_path):
    with ExitStack() as stack:
        yield Hosts(tmp_path / "keys", stack)


def time_s(odom: Any) -> float:
    stamp = odom["header"]["stamp"]
    return stamp["sec"] + stamp["nanosec"] / 1e9


def speed(odom: Any) -> float:
    return float(odom["twist"]["twist"]["linear"]["x"])


def hardest_braking(odoms: list[Any]) -> float:
    """Return the largest loss of speed over 0.1 s, as a deceleration [m/s²]."""
    return max(
        (speed(before) - speed(after)) / (time_s(after) - time_s(before))
        for before, after in zip(odoms, odoms[10:], strict=False)
    )


def test_when_the_link_is_cut_the_robot_comes_to_rest_and_follows_when_it_is_back(hosts):
    moving = hosts.truth.wait(lambda odom: speed(odom) > 0.15)
    hosts.state.wait(lambda state: state["tracking"] == "following")
    hosts.link.is_cut = True
    cut_s = time_s(moving)
    resting = hosts.truth.wait(lambda odom: abs(speed(odom)) < 0.01)
    hosts.truth.wait(lambda odom: time_s(odom) > cut_s + CUT_S)
    assert abs(speed(hosts.truth.messages[-1])) < 0.01
    assert time_s(resting) - cut_s < CUT_S
    assert hardest_braking(hosts.truth.messages) < MAX_DECELERATION * 1.1  # the rollers' ripple
    hosts.link.is_cut = False
    hosts.commands.wait(lambda _: True)
    hosts.truth.wait(lambda odom: speed(odom) > 0.15)
    hosts.state.wait(lambda state: state["tracking"] == "following")
