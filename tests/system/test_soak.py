"""Long runs: memory does not grow, no tick is lost, and time does not drift.

`-s` prints the figures; `--scale N` makes the runs N times as long: 120 is two hours in lockstep.
Without it they are shorter.
"""

import time

from harness import SCENARIOS
from mecazen import keys

CIRCLE = SCENARIOS / "circle.toml"
"""Its person walks without end."""
EVERY_TICK = (keys.CLOCK, keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE, keys.JOINT_COMMAND)

LOCKSTEP_S = 60.0
REAL_TIME_S = 8.0
SHARE = 1 / 12
"""Memory is measured after each such share of the run ..."""
GROWTH_BYTES = 5_000_000
"""... and grows by this at most after the first."""
DRIFT_MS = 10.0
"""Largest drift of the schedule against the wall clock."""


class Ticks:
    """Counts missing and repeated samples of keys that have one in every tick."""

    def __init__(self, bus, tick_ns):
        self.newest = self.missed = self.repeated = 0
        self._tick_ns = tick_ns
        self._last = dict.fromkeys(EVERY_TICK, -1)
        for topic in EVERY_TICK:
            bus.subscribe(topic, self._counter(topic), every=True)

    def _counter(self, topic):
        def count(_, stamp):
            tick, last = stamp.time_ns // self._tick_ns, self._last[topic]
            self.missed += max(0, tick - last - 1)
            self.repeated += tick <= last
            self._last[topic] = tick
            self.newest = max(self.newest, tick)

        return count


def test_hours_in_lockstep_lose_no_tick_and_no_memory(stack, scale):
    seconds = LOCKSTEP_S * scale if scale > 1 else LOCKSTEP_S / 4.0
    # "test" is a part of the run, for which lockstep waits
    running = stack(CIRCLE, "sim.mode=lockstep", f"sim.duration_s={seconds}")
    sim = running.scenario.sim
    ticks = Ticks(running.bus, sim.tick_ns)
    settled, most = {}, {}
    begin = time.monotonic()
    running.start()
    due = sim.ticks * SHARE
    while ticks.newest < sim.ticks - 1:
        running.supervisor.poll(0.0)
        running.bus.spin_once(0.25)
        if ticks.newest < due:
            continue
        due += sim.ticks * SHARE
        now = running.memory("uss")
        settled = settled or now
        most = {name: max(now[name], most.get(name, 0)) for name in now}
        print(f"{ticks.newest * sim.tick_s / 60:6.0f} min", now)
    running.wait(lambda: min(ticks._last.values()) == sim.ticks - 1)
    print(f"{seconds:g} s in {time.monotonic() - begin:.0f} s")
    assert (ticks.missed, ticks.repeated) == (0, 0)
    assert all(most[name] - settled[name] <= GROWTH_BYTES for name in settled)


def test_real_time_keeps_to_the_wall_clock(stack, scale):
    running = stack(CIRCLE)
    ticks = []

    def on_clock(_, stamp):
        if stamp.time_ns > 0:  # the second tick is the first that is scheduled
            ticks.append((stamp.time_ns / 1e9, time.monotonic() - stamp.time_ns / 1e9))

    running.bus.subscribe(keys.CLOCK, on_clock, every=True)
    running.start()
    end_s = REAL_TIME_S * scale if scale > 1 else REAL_TIME_S / 2.0
    running.wait(lambda: bool(ticks))
    while ticks[-1][0] < end_s:
        running.supervisor.poll(0.0)
        running.bus.spin_once(0.25)
    # the earliest tick of both ends counts: others were late
    window_s = end_s / 4.0
    first = min(lag for time_s, lag in ticks if time_s < ticks[0][0] + window_s)
    last = min(lag for time_s, lag in ticks if time_s > end_s - window_s)
    print(f"in {end_s:g} s the schedule drifts by {1e3 * (last - first):+.3f} ms")
    assert abs(last - first) * 1e3 < DRIFT_MS
