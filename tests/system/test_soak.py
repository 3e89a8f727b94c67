"""A long run: memory does not grow, and no tick is lost.

`-s` prints the figures; `--scale N` makes it N times as long: 120 is two hours in lockstep. Without
it, it is a quarter as long.
"""

import time

from harness import SCENARIOS
from mecazen import keys

CIRCLE = SCENARIOS / "circle.toml"
"""Its person walks without end."""
EVERY_TICK = (keys.CLOCK, keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE, keys.JOINT_COMMAND)

LOCKSTEP_S = 60.0
SHARE = 1 / 12
"""Memory is measured after each such share of the run ..."""
GROWTH_BYTES = 5_000_000
"""... and grows by this at most after the first."""


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
