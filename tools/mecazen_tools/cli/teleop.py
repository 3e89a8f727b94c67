"""`mecazen teleop`: a robot, or its person, driven by keyboard and gamepad."""

from __future__ import annotations

import math
import signal
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.keys import Topic, of_robot
from mecazen.loading import renamed_in
from mecazen.messages import Odometry, Twist
from mecazen.robots import join_key
from mecazen.text import printable
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text
from typer import Option

from mecazen_tools import driving
from mecazen_tools.cli.options import tool_bus
from mecazen_tools.driving import Hand
from mecazen_tools.strays import OWN_WAY, goes_own_way, scenario_at

if TYPE_CHECKING:
    from blessed.keyboard import Keystroke

TELEOP = "teleop"
"""The liveliness token of this command."""
PERIOD_S = 0.05
"""Period of commands while a key is held [s]: a tenth of the controller's watchdog timeout."""
STALE_S = 1.0
"""Age at which a message is no longer shown [s]."""
ANSWER_S = 0.5
"""Timeout of answers from the terminal [s]."""
KITTY = 0b1011
"""Flags of kitty's keyboard protocol: distinct keys, releases, and both for all keys."""
QUIT = {"q", "ctrl_c"}
NAMES = {" ": "space", "equals": "=", "plus": "+", "minus": "-", "underscore": "_"}


class Role(NamedTuple):
    """The driven body: a robot or its person."""

    command: Topic[Twist]
    odometry: Topic[Odometry]
    service: str
    """The service that obeys the commands."""


ROBOT = Role(keys.CMD_VEL, keys.ODOM, "controller")
PERSON = Role(keys.TARGET_CMD_VEL, keys.TARGET_ODOM, "target")


class Remote:
    """Commands a robot or a person, and collects their state.

    Args:
        bus: The bus of all robots.
        role: Whether the robot or the person is driven.
        robot: Name of the robot, if there are several.

    Raises:
        ConfigError: There is no robot of this name.
    """

    def __init__(self, bus: ZenohBus, role: Role, robot: str) -> None:
        scenario = scenario_at(bus)
        robots = [str(robot["name"]) for robot in scenario.get("robots", ())]
        if scenario and robot not in (robots or [""]):
            names = ", ".join(map(printable, robots)) or "one without a name"
            raise ConfigError(f"--robot {robot or 'is needed'}: there is {names}")
        bus.renamed = renamed_in(scenario)
        self._bus = bus
        self._role = role
        self._robot = robot
        self._sent: Twist | None = None
        self._newest: dict[Topic[Any], tuple[float, Any]] = {}
        """Arrival time [s] and content of the newest message."""
        self._obeys = role is ROBOT or not goes_own_way(scenario, robot)
        self._service = join_key(role.service, robot)
        bus.presence.known = {self._service}
        bus.declare_alive(TELEOP, robot)
        topics: list[Topic[Any]] = [role.command, role.odometry]
        if role is ROBOT:
            topics.append(keys.GUARD_STATE)
        for topic in topics:
            bus.subscribe(of_robot(topic, robot), partial(self._take, topic))

    def send(self, twist: Twist2D, *, stops: bool = False) -> None:
        """Publish a motion, the first rest after it, and any command that `stops`."""
        moves = self._sent is not None and self._sent != Twist()
        if any(twist) or moves or stops:
            self._sent = Twist.planar(twist)
            self._bus.publisher(of_robot(self._role.command, self._robot)).put(self._sent, None)

    def end(self) -> None:
        """Stop the driven body if it has been driven."""
        if self._sent is not None:
            self.send(Twist2D(), stops=True)

    def text(self) -> str:
        """Return pose and speed of the driven body, and the state of the guard."""
        odometry = self._recent(self._role.odometry)
        if odometry is None:
            return f"no {self._bus.key_of(of_robot(self._role.odometry, self._robot))}"
        x, y, yaw = odometry.pose.pose.to_planar()
        speed = math.hypot(*odometry.twist.twist.to_planar()[:2])
        pose = f"x {x:+.2f} y {y:+.2f} m {math.degrees(yaw):+4.0f}°  {speed:.2f} m/s"
        guard = self._recent(keys.GUARD_STATE)
        return pose if guard is None else f"{pose}  guard: {printable(guard.state)}"

    def note(self) -> str:
        """Return the reason why commands are not obeyed; empty if they are."""
        key = self._bus.key_of(of_robot(self._role.command, self._robot))
        if self._service not in self._bus.presence.names:
            return f"nobody listens to {key}: is `mecazen up teleop` running?"
        if not self._obeys:
            return OWN_WAY
        if self._recent(self._role.command) is not None:
            return f"another program drives on {key} as well: `mecazen up teleop` has no follower"
        guard = self._recent(keys.GUARD_STATE)
        if guard is not None and guard.reason:
            return f"guard lets {guard.factor:.0%} through: {printable(guard.reason)}"
        return ""

    def _take(self, topic: Topic[Any], message: object, _: object) -> None:
        if message is not self._sent:  # a command of this client returns as the same object
            self._newest[topic] = time.monotonic(), message

    def _recent(self, topic: Topic[Any]) -> Any:
        arrived_s, message = self._newest.get(topic, (-math.inf, None))
        return message if time.monotonic() - arrived_s < STALE_S else None


def teleop(
    context: typer.Context,
    person: Annotated[bool, Option("--person", help="Walk the person instead.")] = False,
    robot: Annotated[str, Option(metavar="NAME", help="The robot, of several.")] = "",
    speed: Annotated[
        float, Option(metavar="M_S", min=0.01, max=10, help="Along the ground, at 100 %.")
    ] = 0.3,
    turn: Annotated[
        float, Option(metavar="RAD_S", min=0.01, max=10, help="About itself, at 100 %.")
    ] = 0.6,
) -> None:
    """Drive a robot by keyboard, and by a gamepad where one is: it moves while a key is held.

    Examples: mecazen teleop · mecazen teleop --person · mecazen teleop --robot two --speed 0.5
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("teleop needs a terminal; `mecazen pub cmd_vel` drives without one")
    with tool_bus(context) as bus:
        remote = Remote(bus, PERSON if person else ROBOT, robot)
        stick, about = driving.find_gamepad()
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler)
        try:
            with _keyboard() as (read, reports_release):
                typer.echo(f"{driving.HELP}\n{about}")
                hand = Hand(speed, turn, reports_release=reports_release)
                _drive(bus, remote, hand, stick, read)
        except (OSError, EOFError, termios.error):
            pass  # the terminal has gone
        finally:
            remote.end()


def _drive(
    bus: ZenohBus,
    remote: Remote,
    hand: Hand,
    stick: Callable[[], Twist2D],
    read: Callable[[float], Keystroke],
) -> None:
    """Publish the velocity of the held keys and sticks until a key quits."""
    due_s = time.monotonic()
    with Live(console=Console(), auto_refresh=False) as live:
        while True:
            due_s = max(due_s + PERIOD_S, time.monotonic())  # skips periods missed during a Ctrl-Z
            stops = False
            while (left_s := due_s - time.monotonic()) > 0.0:
                if not (press := read(left_s)):
                    continue
                key = _name(press)
                if press.released:
                    hand.release(key)
                elif key in QUIT:
                    return
                else:
                    hand.press(key, time.monotonic(), repeated=press.repeated)
                stops |= key == driving.STOP
            bus.drain()
            twist = hand.command(time.monotonic(), stick())
            remote.send(twist, stops=stops)
            x, y, yaw = twist
            velocity = f"vx {x:+.2f} vy {y:+.2f} m/s wz {yaw:+.2f} rad/s  {hand.percent} %"
            lines = Text(f"{velocity}  {remote.text()}"), Text(remote.note(), "yellow")
            for line in lines:
                line.no_wrap, line.overflow = True, "ellipsis"
            live.update(Group(*lines), refresh=True)


@contextmanager
def _keyboard() -> Iterator[tuple[Callable[[float], Keystroke], bool]]:
    """Yield a function that waits for a key up to a time [s], and whether releases are reported."""
    from blessed import Terminal  # noqa: PLC0415  # only teleop needs it

    # with styles, blessed queries the terminal, and waits 10 s for a terminal that does not answer
    terminal = Terminal(force_styling=None)
    with terminal.cbreak():
        reports_release = terminal.get_kitty_keyboard_state(ANSWER_S) is not None
        if reports_release:
            print(f"\x1b[>{KITTY}u", end="", flush=True)
        try:
            yield partial(terminal.inkey, esc_delay=0.0), reports_release
        finally:
            if reports_release:
                with suppress(OSError):
                    print("\x1b[<u", end="", flush=True)


def _name(key: Keystroke) -> str:
    """Return the name of a key in `driving`, equal for capitals and for both protocols."""
    name = (key.key_name or str(key)).removeprefix("KEY_").removeprefix("SHIFT_").lower()
    return NAMES.get(name, name)
