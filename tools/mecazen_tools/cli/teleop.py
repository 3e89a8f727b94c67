"""`mecazen teleop`: a robot, or its person, driven by keyboard and gamepad.

Terminals report the press of a key, the first repeat after about half a second, then some tens of
repeats a second, and no release. A key therefore counts as held until its next repeat is overdue.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import termios
import time
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.commands import FOLLOWER
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.keys import Topic, of_robot
from mecazen.loading import renamed_in, robots_in
from mecazen.messages import Twist
from mecazen.robots import join_key
from mecazen.text import printable
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text
from typer import Option

from mecazen_tools.cli.options import scenario_at, tool_bus

TELEOP = "teleop"
"""The liveliness token of this command."""
PERIOD_S = 0.05
"""Period of commands while a key is held [s]: a tenth of the controller's watchdog timeout."""
STALE_S = 1.0
"""Age at which a message is no longer shown [s]."""
FIRST_S = 0.7
"""Maximum time from a press to the first repeat [s]: 0.66 s in X, 0.5 s on most desktops."""
REPEAT_S = 0.25
"""Maximum time between two repeats [s]: 0.04 s, and the delay of a network."""

_AHEAD, _BACK = Twist2D(x=1.0), Twist2D(x=-1.0)
_LEFT, _RIGHT = Twist2D(yaw=1.0), Twist2D(yaw=-1.0)
DIRECTIONS = {
    **{"w": _AHEAD, "up": _AHEAD, "s": _BACK, "down": _BACK},
    **{"j": _LEFT, "left": _LEFT, "l": _RIGHT, "right": _RIGHT},
    **{"a": Twist2D(y=1.0), "d": Twist2D(y=-1.0)},
    # curves, since only the newest key counts
    **{"u": Twist2D(x=1.0, yaw=1.0), "o": Twist2D(x=1.0, yaw=-1.0)},
}
"""Direction of each key, as shares of the speeds."""
SPEEDS = {"-": -10, "_": -10, "+": 10, "=": 10}
"""Change of the speeds by each key [%]."""
MIN_PERCENT, MAX_PERCENT = 10, 300
STOP = " "
QUIT = "q"
HELP = "w a s d or ↑ ↓ move · ← → or j l turn · u o curve · + - speed · space stops · q ends"

SDL = {
    "SDL_VIDEODRIVER": "dummy",  # no window,
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",  # so none has the focus
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}
FULL_DEFLECTION = 32768.0
DEAD_ZONE = 0.15
"""Maximum deflection of a released stick, as a share of its full deflection."""


class Hand:
    """The velocity commanded by hand.

    Args:
        speed_m_s: Speed along the ground at 100 % [m/s].
        turn_rad_s: Yaw rate at 100 % [rad/s].
    """

    def __init__(self, speed_m_s: float, turn_rad_s: float) -> None:
        self.percent = 100
        self._speed = speed_m_s
        self._turn = turn_rad_s
        self._key, self._until_s = "", -math.inf
        """The newest key, and the time until which it counts as held [s]."""

    def press(self, key: str, time_s: float) -> None:
        """Process a press or repeat of a key; keys outside the tables have no effect."""
        if key == STOP:
            self._until_s = -math.inf
        elif key in SPEEDS:
            self.percent = min(max(self.percent + SPEEDS[key], MIN_PERCENT), MAX_PERCENT)
        elif key in DIRECTIONS:
            repeats = key == self._key and time_s < self._until_s
            self._key, self._until_s = key, time_s + (REPEAT_S if repeats else FIRST_S)

    def command(self, time_s: float, stick: Twist2D) -> Twist2D:
        """Return the commanded velocity [m/s, m/s, rad/s].

        Args:
            time_s: The time on the clock of `press` [s].
            stick: Contribution of a gamepad, as shares of the speeds.
        """
        held = DIRECTIONS[self._key] if time_s < self._until_s else Twist2D()
        x, y, yaw = (pad + key for pad, key in zip(stick, held, strict=True))
        # diagonal motion is no faster than straight motion
        speed = self._speed * self.percent / 100 / max(math.hypot(x, y), 1.0)
        turn = self._turn * self.percent / 100 / max(abs(yaw), 1.0)
        return Twist2D(x * speed, y * speed, yaw * turn)


def find_gamepad() -> tuple[Callable[[], Twist2D], str]:
    """Find the first gamepad that is plugged in; SDL knows the sticks of most models.

    Returns:
        A function that returns the velocity of its sticks as shares of the speeds, zero without a
        gamepad; and a line for the user.
    """
    os.environ.update(SDL)
    try:
        import pygame  # noqa: PLC0415  # an extra
        from pygame._sdl2 import controller  # noqa: PLC0415
    except ImportError:
        return Twist2D, "keyboard only: a gamepad needs pip install 'mecazen[gamepad]'"
    try:
        pygame.display.init()
        controller.init()
        known = [n for n in range(controller.get_count()) if controller.is_controller(n)]
        pad: Any = controller.Controller(known[0]) if known else None
    except pygame.error as error:
        return Twist2D, f"keyboard only: no gamepad can be read: {error}"
    if pad is None:
        return Twist2D, "keyboard only: no gamepad is plugged in"

    def deflection(axis: int) -> float:
        """Return a stick's deflection from -1 to 1, without its dead zone."""
        share = pad.get_axis(axis) / FULL_DEFLECTION
        beyond = max(abs(share) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
        return math.copysign(beyond, share) if beyond else 0.0

    def twist() -> Twist2D:
        pygame.event.pump()
        if not pad.attached():
            return Twist2D()
        # positive to the right and towards the hand
        return Twist2D(
            x=-deflection(pygame.CONTROLLER_AXIS_LEFTY),
            y=-deflection(pygame.CONTROLLER_AXIS_LEFTX),
            yaw=-deflection(pygame.CONTROLLER_AXIS_RIGHTX),
        )

    return twist, f"gamepad {pad.name}: the left stick moves, the right one turns"


class Remote:
    """Commands a robot or a person, and collects their state.

    Args:
        bus: The bus of all robots.
        robot: Name of the robot, if there are several.
        person: Whether the person is driven.

    Raises:
        ConfigError: There is no robot of this name.
    """

    def __init__(self, bus: ZenohBus, robot: str, *, person: bool) -> None:
        scenario = scenario_at(bus)
        robots = robots_in(scenario)
        if scenario and robot not in robots:
            names = ", ".join(map(printable, robots)) or "one without a name"
            raise ConfigError(f"--robot {robot or 'is needed'}: there is {names}")
        bus.renamed = renamed_in(scenario)
        self._bus, self._person = bus, person
        self._command = of_robot(keys.TARGET_CMD_VEL if person else keys.CMD_VEL, robot)
        self._odometry = of_robot(keys.TARGET_ODOM if person else keys.ODOM, robot)
        self._guard = of_robot(keys.GUARD_STATE, robot)
        self._sent: Twist | None = None
        self._newest: dict[Topic[Any] | str, tuple[float, Any]] = {}
        """Arrival time [s] and content of the newest message; `FOLLOWER`: of the follower's."""
        self._service = join_key("target" if person else "controller", robot)
        bus.presence.known = {self._service}
        bus.declare_alive(TELEOP, robot)
        topics: list[Topic[Any]] = [self._command, self._odometry]
        for topic in topics if person else [*topics, self._guard]:
            bus.subscribe(topic, partial(self._take, topic))

    def send(self, twist: Twist2D, *, stops: bool = False) -> None:
        """Publish a motion, the rest after it, and any command that `stops`.

        A person gets the first rest only; a robot all, so that no follower drives until the end.
        """
        holds = self._sent is not None and not (self._person and self._sent == Twist())
        if any(twist) or holds or stops:
            self._sent = Twist.planar(twist)
            self._bus.publisher(self._command).put(self._sent, None)

    def end(self) -> None:
        """Stop the driven body if it has been driven."""
        if self._sent is not None:
            self.send(Twist2D(), stops=True)

    def text(self) -> str:
        """Return pose and speed of the driven body, and the state of the guard."""
        odometry, guard = self._recent(self._odometry), self._recent(self._guard)
        if odometry is None:
            return f"no {self._bus.key_of(self._odometry)}"
        x, y, yaw = odometry.pose.pose.to_planar()
        speed = math.hypot(*odometry.twist.twist.to_planar()[:2])
        pose = f"x {x:+.2f} y {y:+.2f} m {math.degrees(yaw):+4.0f}°  {speed:.2f} m/s"
        return pose if guard is None else f"{pose}  guard: {printable(guard.state)}"

    def note(self) -> str:
        """Return the reason why commands are not obeyed; empty if they are."""
        key, guard = self._bus.key_of(self._command), self._recent(self._guard)
        if self._service not in self._bus.presence.names:
            return f"nobody listens to {key}: is `mecazen up teleop` running?"
        if self._recent(self._command) is not None:
            return f"another program drives on {key} as well: `mecazen topics --live` names it"
        if guard is not None and guard.reason:
            return f"guard lets {guard.factor:.0%} through: {printable(guard.reason)}"
        if self._sent is not None and self._recent(FOLLOWER) is not None:
            return f"you drive, and the follower waits until {QUIT} is pressed"
        return ""

    def _take(self, topic: Topic[Any], message: object, stamp: object) -> None:
        is_follower = topic is self._command and stamp is not None and not self._person
        if message is not self._sent:  # a command of this client returns as the same object
            self._newest[FOLLOWER if is_follower else topic] = time.monotonic(), message

    def _recent(self, source: Topic[Any] | str) -> Any:
        arrived_s, message = self._newest.get(source, (-math.inf, None))
        return message if time.monotonic() - arrived_s < STALE_S else None


def teleop(
    context: typer.Context,
    person: Annotated[bool, Option("--person", help="Move the person instead.")] = False,
    robot: Annotated[str, Option(metavar="NAME", help="The robot, if there are several.")] = "",
    speed: Annotated[
        float, Option(metavar="M_S", min=0.01, max=10, help="Linear speed at 100 %.")
    ] = 0.3,
    turn: Annotated[
        float, Option(metavar="RAD_S", min=0.01, max=10, help="Turning speed at 100 %.")
    ] = 0.6,
) -> None:
    """Drive a robot by keyboard or connected gamepad; the robot moves while a key is held.

    Examples: mecazen teleop · mecazen teleop --person · mecazen teleop --robot two --speed 0.5
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("teleop needs a terminal; `mecazen pub cmd_vel` drives without one")
    with tool_bus(context) as bus:
        remote = Remote(bus, robot, person=person)
        stick, about = find_gamepad()
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler)
        try:
            typer.echo(f"{HELP}\n{about}")
            _drive(bus, remote, Hand(speed, turn), stick)
        except (OSError, EOFError, termios.error):
            pass  # the terminal has gone
        finally:
            remote.end()


def _drive(bus: ZenohBus, remote: Remote, hand: Hand, stick: Callable[[], Twist2D]) -> None:
    """Publish the velocity of the held key and the sticks until a key quits."""
    from blessed import Terminal  # noqa: PLC0415  # only teleop needs it

    # with styles, blessed queries the terminal, and waits 10 s for a terminal that does not answer
    terminal = Terminal(force_styling=None)
    due_s = time.monotonic()
    with terminal.cbreak(), Live(console=Console(), auto_refresh=False) as live:
        while True:
            due_s = max(due_s + PERIOD_S, time.monotonic())  # skips periods missed during a Ctrl-Z
            stops = False
            while (left_s := due_s - time.monotonic()) > 0.0:
                press = terminal.inkey(left_s, esc_delay=0.0)
                name = press.name or str(press)  # empty if none came in time
                key = name.removeprefix("KEY_").removeprefix("SHIFT_").lower()
                if key == QUIT:
                    return
                hand.press(key, time.monotonic())
                stops |= key == STOP
            bus.drain()
            twist = hand.command(time.monotonic(), stick())
            remote.send(twist, stops=stops)
            x, y, yaw = twist
            velocity = f"vx {x:+.2f} vy {y:+.2f} m/s wz {yaw:+.2f} rad/s  {hand.percent} %"
            lines = Text(f"{velocity}  {remote.text()}"), Text(remote.note(), "yellow")
            for line in lines:
                line.no_wrap, line.overflow = True, "ellipsis"
            live.update(Group(*lines), refresh=True)
