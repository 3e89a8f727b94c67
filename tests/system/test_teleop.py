"""`mecazen teleop` in a terminal that the test plays, against a bus on which it is the robot."""

import os
import pty
import secrets
import select
import subprocess
from contextlib import ExitStack, closing

import pytest
from harness import command, forward, tools, wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.geometry import Twist2D
from mecazen.messages import GuardState


class Terminal:
    """`mecazen teleop` in a terminal of its own, on a bus that hears its commands."""

    def __init__(self, endpoint, *arguments):
        config = BusConfig(connect=(endpoint,), namespace=f"teleop{secrets.token_hex(6)}")
        self.bus = ZenohBus(config)
        self.commands = []
        for topic in (keys.CMD_VEL, keys.TARGET_CMD_VEL):
            self.bus.subscribe(topic, self._take(topic.key), every=True)
        self._master, slave = pty.openpty()
        self.process = subprocess.Popen(
            **command([*tools(config), "teleop", *arguments], TERM="xterm", COLUMNS="200"),
            stdin=slave,
            stdout=slave,
            stderr=slave,
            preexec_fn=lambda: os.login_tty(slave),  # noqa: PLW1509  # it holds no lock
        )
        os.close(slave)
        self.text = ""
        """The output so far."""

    def _take(self, key):
        return lambda message, _: self.commands.append((key, message.to_planar()))

    def _read(self):
        while self._master is not None and select.select([self._master], [], [], 0)[0]:
            try:
                self.text += os.read(self._master, 4096).decode(errors="replace")
            except OSError:  # the command has ended
                return

    def type(self, text):
        os.write(self._master, text.encode())

    def hang_up(self):
        """Close the terminal, as a lost connection does."""
        os.close(self._master)
        self._master = None

    def wait(self, condition):
        def holds():
            self._read()
            return condition()

        wait(self.bus, holds)

    def wait_for(self, *commands):
        """Wait until these have come in this order, among others, and the last one last."""

        def came():
            later = iter(self.commands)
            return all(each in later for each in commands) and self.commands[-1] == commands[-1]

        self.wait(came)

    def wait_for_end(self):
        self.wait(lambda: self.process.poll() == 0)

    def close(self):
        self.process.kill()
        self.process.wait()
        if self._master is not None:
            self.hang_up()
        self.bus.close()


@pytest.fixture
def teleop(router):
    """Start `mecazen teleop`; it ends with the test."""
    with ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(closing(Terminal(router, *arguments)))


def cmd(x=0.0, y=0.0, yaw=0.0, key="cmd_vel"):
    return key, Twist2D(x, y, yaw)


def test_a_key_drives_until_its_release(teleop):
    hand = teleop()
    hand.wait(lambda: "nobody listens to cmd_vel" in hand.text)
    hand.bus.declare_alive("controller")
    hand.type("w")
    hand.wait_for(cmd(0.3), cmd())
    hand.type("++L")
    hand.wait_for(cmd(yaw=-0.72), cmd())
    hand.commands.clear()
    hand.type(" ")  # stops whoever drives
    hand.wait_for(cmd())
    state = GuardState(state="slow", factor=0.5, reason="a wall\x1b[2J is near")
    hand.bus.publisher(keys.GUARD_STATE).put(state, None)
    hand.wait(lambda: "guard lets 50% through" in hand.text)
    assert "a wall\\u001b[2J is near" in hand.text
    hand.bus.publisher(keys.CMD_VEL).put(forward(0.1), None)
    hand.wait(lambda: "another program drives on cmd_vel as well" in hand.text)
    hand.commands.clear()
    hand.type("q")
    hand.wait_for_end()
    hand.wait_for(cmd())


def test_a_lost_terminal_brings_the_person_to_rest(teleop):
    key = keys.TARGET_CMD_VEL.key
    hand = teleop("--person", "--speed", "1")
    hand.wait(lambda: f"nobody listens to {key}" in hand.text)
    hand.type("w")
    hand.wait_for(cmd(1.0, key=key))
    hand.hang_up()
    hand.wait_for(cmd(1.0, key=key), cmd(key=key))
    assert not any(name == "cmd_vel" for name, _ in hand.commands)
    hand.wait_for_end()
