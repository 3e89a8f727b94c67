"""Long runs, floods and intruders: no tick is lost, memory does not grow, no trajectory changes.

`-s` prints the figures; `--scale N` makes each N times as long: 120 is two hours in lockstep.
Without it they are brief, and some are skipped.
"""

import time
from contextlib import closing
from functools import partial
from pathlib import Path
from statistics import quantiles

import pytest
import zenoh
from harness import SCENARIOS
from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory
from system.intruders import Intruder, flooding

BACK = SCENARIOS / "back.toml"
CIRCLE = SCENARIOS / "circle.toml"
"""Its person walks without end."""
EVERY_TICK = (keys.CLOCK, keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE, keys.JOINT_COMMAND)
LOCKSTEP_S = 60.0
SHARES = 12
"""Memory is measured after each such part of the run, and compared with the first."""
LEAK_BYTES = 5_000_000
FLOOD_BYTES = 32_000_000
"""Limit of the growth of a process, whose samples wait on all its keys."""
INTRUDER_BYTES = 64_000_000
"""A service may keep 16 samples of 64 KiB on each of its keys; a leak has no bound."""

WINDOW_S = 1.0
SETTLED_S = 1.0
"""After it queues and caches are full."""
EVERY_KEY = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(call.key for call in keys.CALLS),
    "diagnostics/physics",
    "of/ones/own",
)
FLOODS = {
    "cmd_vel": (("cmd_vel",), b'{"linear":{"x":0.1}}'),
    "every key": (EVERY_KEY, bytes(1 << 20)),
}
"""Keys and payload, sent as fast as the bus takes it."""

PAYLOADS = 20_000
"""Multiplied by `--scale`; without it a quarter of them."""
BATCH = 200
TOOLS = 5
HUGE_BYTES = 280 << 20
"""Size of a sample that once killed a router's container [bytes]."""


class Ticks:
    """Counts missing and repeated samples of keys that have one in every tick."""

    def __init__(self, bus, tick_ns):
        self.last = dict.fromkeys(EVERY_TICK, -1)
        self.missed = self.repeated = 0
        self._tick_ns = tick_ns
        for topic in EVERY_TICK:
            bus.subscribe(topic, partial(self._count, topic), every=True)

    def _count(self, topic, _, stamp):
        tick, last = stamp.time_ns // self._tick_ns, self.last[topic]
        self.missed += max(0, tick - last - 1)
        self.repeated += tick <= last
        self.last[topic] = tick


def test_hours_in_lockstep_lose_no_tick_and_no_memory(stack, scale):
    seconds = LOCKSTEP_S * scale if scale > 1 else LOCKSTEP_S / 4.0
    # "test" is a part of the run, for which lockstep waits
    running = stack(CIRCLE, "sim.mode=lockstep", f"sim.duration_s={seconds}")
    ticks = Ticks(running.bus, running.scenario.sim.tick_ns)
    running.start()
    settled, most, total = {}, {}, running.scenario.sim.ticks
    for share in range(1, SHARES + 1):
        while min(ticks.last.values()) < share * total // SHARES - 1:
            running.supervisor.poll(0.0)
            running.bus.spin_once(0.25)
        now = running.memory("uss")
        settled = settled or now
        most = {name: max(now[name], most.get(name, 0)) for name in now}
        print(f"{share} of {SHARES}", now)
    assert (ticks.missed, ticks.repeated) == (0, 0)
    assert all(most[name] - settled[name] <= LEAK_BYTES for name in settled)


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
    if scale == 1 and (flood, secured) != ("every key", True):
        pytest.skip("with --scale 2 or more")
    running = stack(BACK, *(access_control if secured else ()))
    answers = Answers(running.bus)
    running.start()
    running.wait(lambda: answers.latencies_ms)

    def spin(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            running.bus.spin_once(0.05)

    with flooding(*FLOODS[flood], running.scenario.bus) as sent:
        running.wait(lambda: sent.value)
        spin(SETTLED_S)
        before, puts = running.memory(), sent.value
        missed = running.call(keys.SIM_STATE, Empty()).missed_deadlines
        answers.latencies_ms.clear()
        spin(WINDOW_S * scale)
        missed = running.call(keys.SIM_STATE, Empty()).missed_deadlines - missed
        rate = (sent.value - puts) / (WINDOW_S * scale)
        running.wait(lambda: len(answers.latencies_ms) > 1)
        growth = {name: now - before[name] for name, now in running.memory().items()}
    percentiles = quantiles(answers.latencies_ms, n=100)
    print(f"{rate:.0f} puts/s; median {percentiles[49]:.1f} ms, p99 {percentiles[98]:.1f} ms; ")
    print(f"{missed} ticks missed; growth {max(growth.values()) / 1e6:.1f} MB")
    assert max(growth.values()) < FLOOD_BYTES, growth


@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_an_intruder_crashes_nothing_and_changes_no_trajectory(
    stack, access_control, scale, secured
):
    if scale == 1 and secured:
        pytest.skip("with --scale 2 or more")
    settings = ("sim.duration_s=10.0", "seed=11")
    running = stack(BACK, *settings, "sim.mode=lockstep", *(access_control if secured else ()))
    sim, config = running.scenario.sim, running.scenario.bus
    trajectory = Trajectory(running.bus, running.scenario)
    running.start()
    running.watch(trajectory)
    payloads, early = PAYLOADS * scale if scale > 1 else PAYLOADS // 4, None
    intruder = Intruder(partial(open_session, config, "client", "viewer"))
    while intruder.sent < payloads or not trajectory.complete:
        # half of them at least while it runs
        if intruder.sent < payloads and trajectory.done * payloads >= (
            intruder.sent * sim.ticks // 2
        ):
            intruder.send(BATCH)
        if early is None and intruder.sent >= payloads / 4:
            early = running.memory()
        running.supervisor.poll(0.0)  # a process that ends is an error
        running.bus.drain()
        running.bus.spin_once(0.01)
    intruder.leave()
    assert intruder.accepted == 0
    expected = simulate(load_scenario(BACK, parse_settings(settings)), "back")[1]
    assert trajectory.rows() == expected.rows()
    late = running.memory()
    growth = {name: late[name] - early[name] for name in early}
    print(f"{intruder.sent} payloads, {sum(early.values())} then {sum(late.values())} bytes")
    assert max(growth.values()) < INTRUDER_BYTES, growth
    for _ in range(TOOLS):
        with closing(ZenohBus(config, "client")) as tool:
            assert tool.call(keys.SIM_STATE, Empty()).tick == sim.ticks - 1


def test_what_is_far_too_long_is_not_even_put_together(stack):
    running = stack(BACK)
    ticks = []
    running.bus.subscribe(keys.FOLLOWER_STATE, lambda _, stamp: ticks.append(stamp.time_ns))
    running.start()
    running.wait(lambda: bool(ticks))
    before = peaks(running)
    with open_session(running.scenario.bus, "client") as session:
        huge = bytes(HUGE_BYTES)
        block = zenoh.CongestionControl.BLOCK
        session.put("cmd_vel", huge, congestion_control=block)
        session.put("of/ones/own", b"", attachment=huge, congestion_control=block)
        begin = ticks[-1]
        running.wait(lambda: ticks[-1] > begin + 10**9)
    growth = {name: peak - before[name] for name, peak in peaks(running).items()}
    assert max(growth.values()) < INTRUDER_BYTES, growth


def peaks(running) -> dict[str, int]:
    """The most memory that each process has had [bytes]."""
    pids = running.supervisor.pids.items()
    status = {name: Path(f"/proc/{pid}/status").read_text() for name, pid in pids}
    return {name: 1024 * int(text.split("VmHWM:")[1].split()[0]) for name, text in status.items()}
