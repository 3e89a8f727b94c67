"""Real time while one client floods the bus: ticks are answered, and memory does not grow.

`-s` prints the figures; `--scale N` makes each flood last N times as long.
"""

import time
from statistics import quantiles

import pytest
from harness import SCENARIOS
from mecazen import keys
from mecazen.messages import Empty
from system.intruders import flooding

WINDOW_S = 1.0
SETTLED_S = 1.0
"""After it queues and caches are full."""
GROWTH_BYTES = 32_000_000
"""Limit of the growth of a process, whose samples wait on all its keys."""
RATE_HZ = 10_000
EVERY_KEY = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(call.key for call in keys.CALLS),
    "diagnostics/physics",
    "of/ones/own",
)
FLOODS = {
    "quiet": ((), b"", None),
    "cmd_vel": (("cmd_vel",), b'{"linear":{"x":0.1}}', RATE_HZ),
    "every key": (EVERY_KEY, bytes(1 << 20), None),
}
"""Keys, payload, and rate [Hz], None for as fast as the bus takes it."""

SHORT = ("every key", True)
"""The flood that `make test` sends, with access control."""


class Answers:
    """Measures the time from each tick's clock to its joint command [ms]."""

    def __init__(self, bus):
        self.latencies_ms = []
        self._clocks = {}
        bus.subscribe(keys.CLOCK, self._on_clock, every=True)
        bus.subscribe(keys.JOINT_COMMAND, self._on_command, every=True)

    def _on_clock(self, _, stamp):
        self._clocks[stamp] = time.perf_counter()

    def _on_command(self, _, stamp):
        # the first command of a tick; later ones only improve it
        begin = self._clocks.pop(stamp, None)
        if begin is not None:
            self.latencies_ms.append((time.perf_counter() - begin) * 1e3)


@pytest.mark.parametrize("flood", FLOODS)
@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_under_a_flood_ticks_are_answered_and_memory_does_not_grow(
    stack, access_control, scale, secured, flood
):
    if scale == 1 and (flood, secured) != SHORT:
        pytest.skip("with --scale 2 or more")
    running = stack(SCENARIOS / "back.toml", *(access_control if secured else ()))
    answers = Answers(running.bus)
    running.start()
    running.wait(lambda: answers.latencies_ms)
    window_s = WINDOW_S * scale

    def spin(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            running.bus.spin_once(0.05)

    with flooding(*FLOODS[flood], running.scenario.bus) as sent:
        running.wait(lambda: sent.value or flood == "quiet")
        spin(SETTLED_S)
        before, puts = running.memory(), sent.value
        missed = running.call(keys.SIM_STATE, Empty()).missed_deadlines
        answers.latencies_ms.clear()
        spin(window_s)
        state = running.call(keys.SIM_STATE, Empty())
        rate = (sent.value - puts) / window_s
        running.wait(lambda: len(answers.latencies_ms) > 1)
        growth = {name: now - before[name] for name, now in running.memory().items()}
    percentiles = quantiles(answers.latencies_ms, n=100)
    print(
        f"{rate:.0f} puts/s; median {percentiles[49]:.1f} ms, p99 {percentiles[98]:.1f} ms; "
        f"{state.missed_deadlines - missed} of {100.0 * window_s:.0f} ticks missed; "
        f"growth {max(growth.values()) / 1e6:.1f} MB"
    )
    assert max(growth.values()) < GROWTH_BYTES, growth
