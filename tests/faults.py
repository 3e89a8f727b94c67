"""What tests of faults share: a scenario under `mecazen up --restart`, watched tick by tick."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, scenario_path
from mecazen.messages import FollowerState, Odometry
from mecazen.processes import private_meeting_point
from mecazen.wire import Stamp

ROOT = Path(__file__).parents[1]
GUARD_S = 60.0
"""Far beyond what anything here takes: only a hang gets there."""

SERVICES = ("physics", "controller", "target", "follower")
STANDOFF_M = 1.0
NEAR_M = 0.3
"""Who follows is at most so far from where it is to be."""
RESUMED_S = 0.3
"""... and has been so for so long, so that nobody passes by chance."""
MAX_SPEED_M_S = 2.1
"""The limit of the commands, 2 m/s, and what rollers that bump along add to it."""
WINDOW_TICKS = 20
"""Over so many ticks decelerations are measured: rollers shake the body in every single one."""
MAX_CHANGE_M_S2 = 4.5
"""The limits of both axes, 2.5 m/s², together, and what the rollers add."""


class Tick(NamedTuple):
    """The robot in a tick: its pose in the world, its speed along the world's axes."""

    stamp: Stamp
    pose: Pose2D
    vx: float
    vy: float


class Watch:
    """Sees every tick of the robot, and says what is wrong with it."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self.ticks = 0
        self.now: Tick | None = None
        self.person: Pose2D | None = None
        self.tracking = ""
        self.tracked: Stamp | None = None
        self.fastest_m_s = 0.0
        self.hardest_m_s2 = 0.0
        self._recent: deque[Tick] = deque(maxlen=WINDOW_TICKS + 1)
        self._following_since: Stamp | None = None
        bus.subscribe(keys.GROUND_TRUTH, self._on_robot, every=True)
        bus.subscribe(keys.TARGET_ODOM, self._on_person)
        bus.subscribe(keys.FOLLOWER_STATE, self._on_state)

    def follows(self, *, since: Stamp | None = None) -> bool:
        """Whether the robot has been following for a while; of another run than `since`."""
        begin, now = self._following_since, self.now
        if begin is None or now is None or (since is not None and begin.run == since.run):
            return False
        return now.stamp.time_ns - begin.time_ns >= RESUMED_S * 1e9

    def begin_anew(self) -> None:
        """Count as following only what follows."""
        self._following_since = None

    @property
    def speed_m_s(self) -> float:
        """How fast the robot is."""
        return math.inf if self.now is None else math.hypot(self.now.vx, self.now.vy)

    @property
    def off_m(self) -> float:
        """How far the robot is from where it is to be."""
        if self.now is None or self.person is None:
            return math.inf
        return abs(self.now.pose.distance(self.person) - STANDOFF_M)

    def assert_sane(self) -> None:
        """The robot kept its limits, and nobody published what is no number."""
        assert self.fastest_m_s <= MAX_SPEED_M_S
        assert self.hardest_m_s2 <= MAX_CHANGE_M_S2
        assert not self.bus.refused  # what is not finite is refused

    def _on_robot(self, odom: Odometry, stamp: Stamp | None) -> None:
        assert stamp is not None
        pose, twist = odom.pose.pose.to_planar(), odom.twist.twist.to_planar()
        if self._recent and (
            stamp.run != self._recent[-1].stamp.run
            or stamp.time_ns <= self._recent[-1].stamp.time_ns
        ):
            self._recent.clear()
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        self.now = Tick(stamp, pose, c * twist.x - s * twist.y, s * twist.x + c * twist.y)
        self._recent.append(self.now)
        self.ticks += 1
        self.fastest_m_s = max(self.fastest_m_s, self.speed_m_s)
        first = self._recent[0]
        passed_s = (stamp.time_ns - first.stamp.time_ns) / 1e9
        if len(self._recent) > WINDOW_TICKS:
            change = math.hypot(self.now.vx - first.vx, self.now.vy - first.vy) / passed_s
            self.hardest_m_s2 = max(self.hardest_m_s2, change)
        fresh = self.tracked is not None and self.tracked.run == stamp.run
        if not (fresh and self.tracking == "following" and self.off_m < NEAR_M):
            self._following_since = None
        elif self._following_since is None:
            self._following_since = stamp

    def _on_person(self, odom: Odometry, stamp: Stamp | None) -> None:
        del stamp
        self.person = odom.pose.pose.to_planar()

    def _on_state(self, state: FollowerState, stamp: Stamp | None) -> None:
        self.tracking, self.tracked = state.tracking, stamp


class Up:
    """`mecazen up --restart`, and a bus beside it."""

    def __init__(self, scenario: str, *settings: str) -> None:
        self.settings = (*settings, *private_meeting_point())
        self.scenario = load_scenario(scenario_path(scenario), self.settings)
        flags = [f"--set={setting}" for setting in self.settings]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mecazen", "up", scenario, "--restart", "--no-viewer", *flags],
            stdout=subprocess.DEVNULL,
            cwd=ROOT,
        )
        self.bus = ZenohBus(self.scenario.bus, lossless=True)
        self.bus.declare_alive("test")
        self.watch = Watch(self.bus)

    def pid(self, name: str) -> int | None:
        """The process that plays a part now, or None while there is none."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        for pid in map(int, children.read_text().split()):
            try:
                command = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if command[1:4] == [b"-m", b"mecazen.runtime", name.encode()]:
                return pid
        return None

    def kill(self, *names: str) -> dict[str, int]:
        """Kill parts at once; return the processes that they were."""
        pids = {name: pid for name in names if (pid := self.pid(name)) is not None}
        assert len(pids) == len(names)
        for pid in pids.values():
            os.kill(pid, signal.SIGKILL)
        return pids

    def wait(self, condition: Callable[[], bool]) -> None:
        """Deliver samples until a condition holds."""
        end = time.monotonic() + GUARD_S
        while not condition():
            assert time.monotonic() < end, "what was waited for did not come"
            assert self.process.poll() is None, "`up` has ended"
            self.bus.spin_once(0.05)

    def ready(self, names: Iterable[str] = SERVICES) -> bool:
        """Whether services are ready."""
        return {f"{name}/ready" for name in names} <= self.bus.presence.names

    def close(self) -> None:
        """End everything."""
        self.bus.close()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(GUARD_S)
