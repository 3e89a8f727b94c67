"""What every follower shares: which samples make up a tick. One's own begins here."""

from __future__ import annotations

from abc import abstractmethod

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.geometry import Twist2D
from mecazen.messages import Observation, Odometry, Twist
from mecazen.service import Service
from mecazen.wire import Stamp

MAX_COORDINATE_M = 1e6
"""Beyond it the arithmetic of poses loses millimetres; no robot gets there."""


class Follower(Service):
    """Answers every tick's `odom` with `cmd_vel`.

    In ticks that bring a frame of the sensor it waits for `target/observation` as well, so
    that the answer does not depend on which of the two comes first. A frame that is late is
    taken in with the next tick.
    """

    NAME = "follower"

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.dt = scenario.sim.tick_s
        self.late_frames = 0
        self._ticks_per_frame = scenario.sensor.ticks_per_frame(self.dt)
        self._sees = "target" in scenario.services
        self._only_stamped = self._sees and scenario.sim.mode == "lockstep"
        self._cmd_vel = bus.publisher(keys.CMD_VEL)
        self._open: tuple[Odometry, Stamp] | None = None
        self._frame: Observation | None = None
        self._frame_stamp: Stamp | None = None
        self._last: Stamp | None = None
        super().__init__(bus, scenario)
        self.answer_every_tick(keys.ODOM, self._on_odom)
        self.subscribe(keys.OBSERVATION, self._on_observation)

    @abstractmethod
    def follow(self, odom: Odometry, frame: Observation | None, stamp: Stamp) -> Twist2D:
        """Return the twist wanted in this tick, in base_link.

        Args:
            odom: The robot, in odom.
            frame: What the sensor saw, where a frame has come; without poses if nothing.
            stamp: The tick.
        """

    def on_return(self, name: str) -> None:
        """Begin anew with a controller that does: its odometry starts from another pose."""
        if name == "controller":
            self.reset(self.stamp.seed)

    def _on_odom(self, odom: Odometry, stamp: Stamp) -> None:
        position = odom.pose.pose.position
        if max(abs(position.x), abs(position.y)) > MAX_COORDINATE_M:
            self.bus.refuse(keys.ODOM.key, f"pose out of range: {position.x}, {position.y}")
            return
        if self._open is not None and self._open[1].run == stamp.run:
            self.late_frames += 1
            self._answer(*self._open)
        due, self._last = self._is_frame_due(stamp), stamp
        if due and not self._has_frame(stamp):
            self._open = odom, stamp
        else:
            self._answer(odom, stamp)

    def _on_observation(self, frame: Observation, stamp: Stamp | None) -> None:
        if stamp is None and self._only_stamped:
            return
        self._frame = frame
        if stamp is not None:
            self._frame_stamp = stamp
        if self._open is not None and self._has_frame(self._open[1]):
            self._answer(*self._open)

    def _frame_tick_ns(self, stamp: Stamp) -> int:
        """Return the tick [ns] of the newest frame that is due by a tick."""
        return stamp.time_ns - self.tick_of(stamp) % self._ticks_per_frame * self.tick_ns

    def _is_frame_due(self, stamp: Stamp) -> bool:
        """Return whether a frame belongs to a tick: one that is due since the last odometry."""
        last = self._last
        since_ns = last.time_ns if last and last.run == stamp.run else stamp.time_ns - 1
        return self._sees and self._frame_tick_ns(stamp) > since_ns

    def _has_frame(self, stamp: Stamp) -> bool:
        """Return whether the newest frame that is due by a tick has come."""
        seen = self._frame_stamp
        return (
            seen is not None
            and seen.run == stamp.run
            and seen.time_ns >= self._frame_tick_ns(stamp)
        )

    def _answer(self, odom: Odometry, stamp: Stamp) -> None:
        frame, self._frame, self._open = self._frame, None, None
        if self._frame_stamp is not None and self._frame_stamp.run != stamp.run:
            frame = None
        self._cmd_vel.put(Twist.planar(self.follow(odom, frame, stamp)), stamp)
