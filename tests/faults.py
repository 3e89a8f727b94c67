"""Helpers for tests of faults: a scenario under `mecazen up`, watched tick by tick, and kills."""

import math
import os
import random
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from itertools import combinations
from typing import NamedTuple

import psutil
from harness import COMMAND_GUARD_S, Newest, command, options, wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import FollowerConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.messages import Odometry
from mecazen.wire import Stamp
from mecazen_tools.processes import private_router

SERVICES = ("physics", "controller", "target", "follower")
PARTS = (*SERVICES, "router")
FREEZING = ("physics", "controller", "follower", "router")
"""Not the target: its person stops dead, and the follower, which predicts them, drives into them.
With a guard it does not: tests/system/test_faults.py."""
WALK = ("robot=nexus", "target.path.speed_m_s=0.5")
"""Settings of the scenario `circle`, whose person walks without end, here at a stroll."""

STANDOFF_M = 1.0
NEAR_M = 0.3
"""Maximum distance of a following robot from its goal."""
STEADY_S = 0.3
"""Minimum time near the goal, so that a robot that only passes does not count."""
FROZEN_S = 0.05, 2.0
"""Shortest and longest freeze, in wall time."""
RESUME_S = 3.0
"""Within this simulated time after a part is back, the robot is to follow again."""
DOUBT_S = 2.0 * FollowerConfig().lost_after_s
"""A person who sets off from rest while a frozen controller gives no odometry is farther away than
the follower expects. It takes them for another person for twice `follower.lost_after_s`."""
MAX_SPEED_M_S = 2.1
"""The limit of the commands, 2 m/s, and what rollers that bump along add to it."""
WINDOW_S = 0.2
"""Over this time decelerations are measured: rollers shake the body in every single tick."""
MAX_CHANGE_M_S2 = 3.5
"""The limit of each axis, 2.5 m/s², and what the rollers and the drive's slip add."""


class Watch:
    """Sees every tick of the robot, and remembers the worst."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self.stamp: Stamp | None = None
        self.robot = Pose2D()
        self.twist = Twist2D()
        """Twist of the robot, in base_link."""
        self.person = Newest(bus, keys.TARGET_ODOM)
        self.state = Newest(bus, keys.FOLLOWER_STATE)
        self.fastest_m_s = self.hardest_m_s2 = 0.0
        self._recent: deque[tuple[Stamp, Twist2D]] = deque()
        self.following_since: Stamp | None = None
        bus.subscribe(keys.GROUND_TRUTH, self._on_robot, every=True)

    def begin_anew(self) -> None:
        """Forget the worst, and count as following only what comes now."""
        self.fastest_m_s = self.hardest_m_s2 = 0.0
        self.following_since = None

    def __repr__(self) -> str:
        follower = self.state.message
        return f"{self.stamp}: {self.robot} {self.twist}, {self.person.message}, {follower}"

    @property
    def follows(self) -> bool:
        """Whether the robot has been following for a while."""
        begin, now = self.following_since, self.stamp
        return begin is not None and now is not None and seconds(begin, now) >= STEADY_S

    @property
    def speed_m_s(self) -> float:
        """How fast the robot is."""
        return math.hypot(self.twist.x, self.twist.y)

    def assert_sane(self) -> None:
        """Check that the robot kept its limits and every published number is finite."""
        assert self.fastest_m_s <= MAX_SPEED_M_S
        assert self.hardest_m_s2 <= MAX_CHANGE_M_S2, self.hardest_m_s2
        assert not self.bus.refused, "what is not finite is refused"

    def _on_robot(self, odom: Odometry, stamp: Stamp | None) -> None:
        if self.stamp is not None and stamp.run != self.stamp.run:
            self._recent.clear()
        self.stamp = stamp
        self.robot, self.twist = odom.pose.pose.to_planar(), odom.twist.twist.to_planar()
        self.fastest_m_s = max(self.fastest_m_s, self.speed_m_s)
        self._recent.append((stamp, self.twist))
        while seconds(self._recent[0][0], stamp) > WINDOW_S + 1e-6:
            self._recent.popleft()
        begin, before = self._recent[0]
        passed_s = seconds(begin, stamp)
        if passed_s > WINDOW_S / 2:
            change = max(abs(self.twist.x - before.x), abs(self.twist.y - before.y))
            self.hardest_m_s2 = max(self.hardest_m_s2, change / passed_s)
        if not self._is_near(stamp):
            self.following_since = None
        elif self.following_since is None:
            self.following_since = stamp

    def _is_near(self, stamp: Stamp) -> bool:
        """Whether in this run it says that it follows, and is where it is to be."""
        state = self.state
        return (
            None not in (state.stamp, self.person.message)
            and (state.stamp.run, state.message.tracking) == (stamp.run, "following")
            and abs(self.robot.distance(self.person.pose) - STANDOFF_M) < NEAR_M
        )


def seconds(begin: Stamp, end: Stamp) -> float:
    """Return the simulated time between two ticks of a run."""
    return (end.time_ns - begin.time_ns) / 1e9


class Up(AbstractContextManager["Up"]):
    """`mecazen up`, and a bus beside it."""

    def __init__(self, scenario: str, *settings: str, restart: bool = True) -> None:
        self.settings = (*settings, *private_router())
        self.scenario = load_scenario(scenario_path(scenario), parse_settings(self.settings))
        how = [*(["--restart"] if restart else []), "--no-viewer", *options(self.settings)]
        self.process = subprocess.Popen(
            **command(["up", scenario, *how]), stdout=subprocess.DEVNULL
        )
        self.bus = ZenohBus(self.scenario.bus)
        self.bus.declare_alive("test")
        self.watch = Watch(self.bus)

    def pid(self, name: str) -> int | None:
        """The process that plays a part now, or None while there is none."""
        for child in psutil.Process(self.process.pid).children(recursive=True):
            with suppress(psutil.NoSuchProcess):  # it has just ended
                if child.name() == name:
                    return child.pid
        return None

    def wait(self, condition: Callable[[], bool]) -> None:
        """Deliver samples until a condition holds."""

        def going() -> bool:
            assert self.process.poll() is None, "`up` has ended"
            return condition()

        wait(self.bus, going)

    def wait_until_it_follows(self) -> None:
        """Deliver samples until all are ready, and the robot follows."""
        self.wait(lambda: self.ready(SERVICES) and self.watch.follows)

    def ready(self, names: Iterable[str]) -> bool:
        """Whether services are ready."""
        return {f"{name}/ready" for name in names} <= self.bus.presence.names

    def __exit__(self, *error: object) -> None:
        """End everything."""
        self.bus.close()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(COMMAND_GUARD_S)


class Strike(NamedTuple):
    """The effect of killing some parts at once, or of freezing one."""

    names: tuple[str, ...]
    frozen: bool
    back_s: float
    """Wall time until all killed parts were ready again; for which the frozen one was frozen."""
    resumed_s: float
    """Simulated time from then on until the robot followed again."""
    fastest_m_s: float
    hardest_m_s2: float

    @property
    def in_time(self) -> bool:
        """Whether the robot followed again as soon as it should."""
        return self.resumed_s <= RESUME_S + (DOUBT_S if self.frozen else 0.0)


def strike(up: Up, names: tuple[str, ...]) -> Strike:
    """Kill parts at once, see that the robot stays sane, and wait until it follows again."""
    watch = up.watch
    services = [name for name in names if name != "router"]
    watch.begin_anew()
    before = watch.stamp
    pids = {name: up.pid(name) for name in names}
    returns = {name: up.bus.presence.returns[name] for name in services}
    begin = time.monotonic()
    for pid in pids.values():
        os.kill(pid, signal.SIGKILL)
    # the first of two may be back before the second is gone
    up.wait(lambda: all(up.bus.presence.returns[n] > count for n, count in returns.items()))
    up.wait(lambda: up.ready(services) and all(up.pid(n) not in (None, pids[n]) for n in names))
    back_s = time.monotonic() - begin
    back = watch.stamp
    if services:
        watch.following_since = None
    if "physics" in names:
        # what had been sent in the run before may come as late as that
        up.wait(lambda: watch.stamp is not None and watch.stamp.run != before.run)
        back = back._replace(time_ns=0)
    return _recovery(up, names, back, back_s, frozen=False)


def freeze(up: Up, name: str, frozen_s: float) -> Strike:
    """Freeze a part for a while, and wait until the robot follows again."""
    up.watch.begin_anew()
    pid, begin = up.pid(name), time.monotonic()
    os.kill(pid, signal.SIGSTOP)
    try:
        up.wait(lambda: time.monotonic() - begin >= frozen_s)
    finally:
        os.kill(pid, signal.SIGCONT)
    up.watch.following_since = None
    return _recovery(up, (name,), up.watch.stamp, frozen_s, frozen=True)


def _recovery(
    up: Up, names: tuple[str, ...], back: Stamp, back_s: float, *, frozen: bool
) -> Strike:
    """Wait until the robot follows again, at most twice as long as it may take; check it."""
    watch = up.watch
    up.wait(lambda: watch.follows or seconds(back, watch.stamp or back) > RESUME_S + 2 * DOUBT_S)
    since = watch.following_since
    assert since is not None, f"{names}: does not follow again"
    watch.assert_sane()
    resumed_s = max(0.0, seconds(back, since))
    return Strike(names, frozen, back_s, resumed_s, watch.fastest_m_s, watch.hardest_m_s2)


def strikes(up: Up, count: int, seed: int) -> Iterable[Strike]:
    """Kill parts at random moments, alone or two at once, and freeze others; a third of each."""
    chance = random.Random(seed)
    pairs = list(combinations(PARTS, 2))
    for _ in range(count):
        kind, part, freezes = chance.randrange(3), chance.choice(PARTS), chance.choice(FREEZING)
        pause_s, frozen_s = chance.uniform(0.0, 1.0), chance.uniform(*FROZEN_S)
        begin = up.watch.stamp
        up.wait(lambda begin=begin, s=pause_s: seconds(begin, up.watch.stamp or begin) >= s)
        if kind == 0:
            yield freeze(up, freezes, frozen_s)
        else:
            yield strike(up, (part,) if kind == 1 else chance.choice(pairs))
