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
from mecazen.messages import GuardState, Odometry, Twist
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import Stamp
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from mecazen_tools import driving, gamepad
from mecazen_tools.cli.options import Connect, Namespace, Tls, tool_bus
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
OTHERS_S = 0.5
"""Time after a command of another client during which that client counts as driving [s]."""
ANSWER_S = 0.5
"""Timeout of answers from the terminal [s]."""
KITTY = 0b1011
"""Flags of kitty's keyboard protocol: distinct keys, releases, and both for all keys."""
OTHER = "other"
A_NODE = "a follower (`mecazen up teleop` has none)"
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


class Driven:
    """Commands a robot or a person, and collects their state.

    Args:
        bus: The bus of all robots.
        role: Whether the robot or the person is driven.
        robot: Name of the robot, if there are several.

    Raises:
        ConfigError: There is no robot of this name.
    """

    def __init__(self, bus: ZenohBus, role: Role, robot: str) -> None:
        self._bus = bus
        self._role = role
        self._robot = robot
        self._sent: Twist | None = None
        self._last: dict[str, tuple[float, Any]] = {}
        """Arrival time [s] and content of the newest message, by key."""
        self._join()
        bus.presence.known = {join_key(role.service, robot)}
        bus.declare_alive(TELEOP, robot)
        self._presence = bus.presence
        self._obeys = ""
        self._is_new = True
        """Whether to query the scenario again."""
        bus.presence.on_change.append(self._on_change)
        self._ask()

    def send(self, twist: Twist2D) -> None:
        """Publish a command."""
        self._sent = Twist.planar(twist)
        self._bus.publisher(of_robot(self._role.command, self._robot)).put(self._sent, None)

    @property
    def moves(self) -> bool:
        """Whether the last command was a motion."""
        return self._sent is not None and self._sent != Twist()

    def end(self) -> None:
        """Stop the driven body."""
        if self._sent is not None:
            self.send(Twist2D())

    def update(self) -> None:
        """Process received samples."""
        self._bus.drain()
        if self._is_new:
            self._ask()

    def text(self) -> str:
        """Return pose and speed of the driven body, and the state of the guard."""
        odometry = self._recent(self._role.odometry.key, STALE_S)
        if odometry is None:
            return f"no {self._key_of(self._role.odometry)}"
        x, y, yaw = odometry.pose.pose.to_planar()
        speed = math.hypot(*odometry.twist.twist.to_planar()[:2])
        where = f"x {x:+.2f} y {y:+.2f} m {math.degrees(yaw):+4.0f}°  {speed:.2f} m/s"
        guard = self._recent(keys.GUARD_STATE.key, STALE_S)
        return where if guard is None else f"{where}  guard: {printable(guard.state)}"

    def note(self) -> str:
        """Return the reason why commands are not obeyed; empty if they are."""
        key = self._key_of(self._role.command)
        if join_key(self._role.service, self._robot) not in self._presence.names:
            return f"nobody listens to {key}: is `mecazen up teleop` running?"
        if self._obeys:
            return self._obeys
        is_node = self._recent(OTHER, OTHERS_S)
        if is_node is not None:
            return f"{A_NODE if is_node else 'somebody else'} drives on {key} as well"
        guard: GuardState | None = self._recent(keys.GUARD_STATE.key, STALE_S)
        if guard is not None and guard.reason:
            return f"guard lets {guard.factor:.0%} through: {printable(guard.reason)}"
        return ""

    def _recent(self, what: str, within_s: float) -> Any:
        came_s, message = self._last.get(what, (-math.inf, None))
        return message if time.monotonic() - came_s < within_s else None

    def _key_of(self, topic: Topic[Any]) -> str:
        return self._bus.key_of(of_robot(topic, self._robot))

    def _join(self) -> None:
        """Subscribe to the commands of other clients and to the state of the driven body."""
        bus, role, robot = self._bus, self._role, self._robot
        bus.subscribe(of_robot(role.command, robot), self._hear_other)
        heard = (role.odometry, keys.GUARD_STATE) if role is ROBOT else (role.odometry,)
        for topic in heard:
            bus.subscribe(of_robot(topic, robot), partial(self._hear, topic.key))

    def _hear(self, what: str, message: object, stamp: Stamp | None) -> None:
        del stamp
        self._last[what] = time.monotonic(), message

    def _hear_other(self, message: Twist, stamp: Stamp | None) -> None:
        if message is not self._sent:  # an own command returns as the same object
            self._last[OTHER] = time.monotonic(), stamp is not None

    def _on_change(self) -> None:
        self._is_new = True

    def _ask(self) -> None:
        """Query the scenario, and check that the robot exists and obeys."""
        self._is_new, self._obeys = False, ""
        tables = scenario_at(self._bus)
        robots = [str(robot["name"]) for robot in tables.get("robots", ())]
        if tables and (robots or self._robot) and self._robot not in robots:
            told = ", ".join(map(printable, robots)) or "one without a name"
            raise ConfigError(f"--robot {self._robot or 'is needed'}: there is {told}")
        if tables and (renamed := renamed_in(tables)) != self._bus.renamed:
            self._bus.renamed = renamed
            self._join()
        if self._role is PERSON and goes_own_way(tables, self._robot):
            self._obeys = OWN_WAY


def teleop(
    person: Annotated[bool, typer.Option("--person", help="Walk the person instead.")] = False,
    robot: Annotated[
        str, typer.Option(metavar="NAME", help="The robot, of several.", show_default=False)
    ] = "",
    speed: Annotated[
        float, typer.Option(metavar="M_S", min=0.01, max=10, help="Along the ground, at 100 %.")
    ] = 0.3,
    turn: Annotated[
        float, typer.Option(metavar="RAD_S", min=0.01, max=10, help="About itself, at 100 %.")
    ] = 0.6,
    connect: Connect = None,
    namespace: Namespace = None,
    tls: Tls = None,
) -> None:
    """Drive a robot by keyboard, and by a gamepad where one is: it moves while a key is held.

    Examples: mecazen teleop · mecazen teleop --person · mecazen teleop --robot two --speed 0.5
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("teleop needs a terminal; `mecazen pub cmd_vel` drives without one")
    role = PERSON if person else ROBOT
    with tool_bus(connect, namespace, tls) as bus:
        driven = Driven(bus, role, robot)
        stick, told = gamepad.find()
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, _interrupt)
        try:
            with _keyboard() as (read, tells_release), _live(f"{driving.HELP}\n{told}") as show:
                hand = Hand(speed, turn, tells_release=tells_release)
                _drive(driven, hand, stick, read, show)
        except (OSError, EOFError, termios.error):
            pass  # the terminal has gone
        finally:
            driven.end()


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _drive(
    driven: Driven,
    hand: Hand,
    stick: Callable[[], Twist2D] | None,
    read: Callable[[float], Keystroke],
    show: Callable[[Group], None],
) -> None:
    """Publish the velocity of the held keys and sticks until a key quits."""
    due = time.monotonic()
    while True:
        due = max(due + PERIOD_S, time.monotonic())  # periods missed during a Ctrl-Z are skipped
        stops = False
        while (left_s := due - time.monotonic()) > 0.0:
            press = read(left_s)
            if not press:
                continue
            key = _name(press)
            if press.released:
                hand.release(key)
            elif key in QUIT:
                return
            else:
                hand.press(key, time.monotonic(), repeated=press.repeated)
            stops |= key == driving.STOP
        driven.update()
        twist = hand.command(time.monotonic(), None if stick is None else stick())
        if any(twist) or driven.moves or stops:
            driven.send(twist)
        x, y, yaw = twist
        line = f"vx {x:+.2f} vy {y:+.2f} m/s wz {yaw:+.2f} rad/s  {hand.percent} %  {driven.text()}"
        lines = Text(line), Text(driven.note(), "yellow")
        for text in lines:
            text.no_wrap, text.overflow = True, "ellipsis"
        show(Group(*lines))


@contextmanager
def _live(head: str) -> Iterator[Callable[[Group], None]]:
    """Show a head; yield a function that replaces the lines below it."""
    typer.echo(head)
    with Live(console=Console(), auto_refresh=False) as live:
        yield partial(live.update, refresh=True)


@contextmanager
def _keyboard() -> Iterator[tuple[Callable[[float], Keystroke], bool]]:
    """Yield a function that waits for a key up to a time [s], and whether releases are reported."""
    from blessed import Terminal  # noqa: PLC0415  # only teleop needs it

    # with styles, blessed queries the terminal, and waits 10 s for a terminal that does not answer
    terminal = Terminal(force_styling=None)
    with terminal.cbreak():
        tells_release = terminal.get_kitty_keyboard_state(ANSWER_S) is not None
        if tells_release:
            _tell(f"\x1b[>{KITTY}u")
        try:
            yield partial(terminal.inkey, esc_delay=0.0), tells_release
        finally:
            if tells_release:
                with suppress(OSError):
                    _tell("\x1b[<u")


def _tell(sequence: str) -> None:
    sys.stdout.write(sequence)
    sys.stdout.flush()


def _name(key: Keystroke) -> str:
    """Return the name of a key in `driving`, equal for capitals and for both protocols."""
    name = (key.key_name or str(key)).removeprefix("KEY_").removeprefix("SHIFT_").lower()
    return NAMES.get(name, name)
