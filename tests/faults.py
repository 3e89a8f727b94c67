"""Helpers for tests of faults: a stack that is watched tick by tick, kills and freezes."""

import math
import os
import random
import signal
import time
from collections import deque
from collections.abc import Iterable
from itertools import combinations
from typing import NamedTuple

from harness import Newest
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import FollowerConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Odometry
from mecazen.wire import Stamp
from stack import Stack

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
        return f"{self.stamp}: {self.robot} {self.twist}, {self.state.message}"

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


class Following:
    """A stack whose robot follows, and a watch over it."""

    def __init__(self, stack: Stack, *, restart: bool = False) -> None:
        self.stack = stack
        self.watch = Watch(stack.bus)
        self.wait = stack.wait if restart else stack.wait_unwatched
        stack.start()
        self.wait(lambda: self.watch.follows)

    @property
    def now(self) -> Stamp:
        """The newest tick."""
        assert self.watch.stamp is not None
        return self.watch.stamp

    def signal(self, name: str, number: int) -> None:
        os.kill(self.stack.supervisor.pids[name], number)

    def ready(self, names: Iterable[str]) -> bool:
        """Whether services are ready."""
        return {f"{name}/ready" for name in names} <= self.stack.bus.presence.names

    def recovery_s(self, back: Stamp) -> float:
        """Wait until the robot follows again; return the simulated time from a tick on."""
        watch = self.watch
        self.wait(lambda: watch.follows or seconds(back, self.now) > RESUME_S + 2 * DOUBT_S)
        assert watch.following_since is not None, f"does not follow again: {watch}"
        watch.assert_sane()
        return max(0.0, seconds(back, watch.following_since))


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


def strike(robot: Following, names: tuple[str, ...]) -> Strike:
    """Kill parts at once, see that the robot stays sane, and wait until it follows again."""
    watch, supervisor = robot.watch, robot.stack.supervisor
    presence = robot.stack.bus.presence
    services = [name for name in names if name != "router"]
    watch.begin_anew()
    before, pids, begin = robot.now, supervisor.pids, time.monotonic()
    returns = {name: presence.returns[name] for name in services}
    for name in names:
        robot.signal(name, signal.SIGKILL)
    # the first of two may be back before the second is gone
    robot.wait(lambda: all(presence.returns[name] > count for name, count in returns.items()))
    robot.wait(lambda: all(supervisor.pids[name] != pids[name] for name in names))
    robot.wait(lambda: all(map(supervisor.works, names)) and robot.ready(services))
    back_s, back = time.monotonic() - begin, robot.now
    if services:
        watch.following_since = None
    if "physics" in names:
        # what had been sent in the run before may come as late as that
        robot.wait(lambda: robot.now.run != before.run)
        back = back._replace(time_ns=0)
    resumed_s = robot.recovery_s(back)
    return Strike(names, False, back_s, resumed_s, watch.fastest_m_s, watch.hardest_m_s2)


def freeze(robot: Following, name: str, frozen_s: float) -> Strike:
    """Freeze a part for a while, and wait until the robot follows again."""
    watch, begin = robot.watch, time.monotonic()
    watch.begin_anew()
    robot.signal(name, signal.SIGSTOP)
    try:
        robot.wait(lambda: time.monotonic() - begin >= frozen_s)
    finally:
        robot.signal(name, signal.SIGCONT)
    watch.following_since = None
    resumed_s = robot.recovery_s(robot.now)
    return Strike((name,), True, frozen_s, resumed_s, watch.fastest_m_s, watch.hardest_m_s2)


def strikes(robot: Following, count: int, seed: int) -> Iterable[Strike]:
    """Kill parts at random moments, alone or two at once, and freeze others; a third of each."""
    chance = random.Random(seed)
    pairs = list(combinations(PARTS, 2))
    for _ in range(count):
        kind, part, freezes = chance.randrange(3), chance.choice(PARTS), chance.choice(FREEZING)
        pause_s, frozen_s = chance.uniform(0.0, 1.0), chance.uniform(*FROZEN_S)
        begin = robot.now
        robot.wait(lambda begin=begin, s=pause_s: seconds(begin, robot.now) >= s)
        if kind == 0:
            yield freeze(robot, freezes, frozen_s)
        else:
            yield strike(robot, (part,) if kind == 1 else chance.choice(pairs))
