"""One client against a running scenario: payloads that are no messages, and floods."""

from pathlib import Path

import psutil
import pytest
import zenoh
from harness import SCENARIOS
from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.loading import load_scenario
from mecazen.messages import Empty
from mecazen.wire import JSON_ENCODING, MAX_PAYLOAD_BYTES
from mecazen_bench.malformed import CALLS, Malformed, sample_messages
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory

BACK = SCENARIOS / "back.toml"

PAYLOADS = 30_000
BATCH = 100
GROWTH_BYTES = 64_000_000
"""A service may keep 16 samples of 64 KiB on each of its keys; a leak has no bound."""

HUGE_BYTES = 280 << 20
"""What once killed a router's container."""


def intruder(running) -> zenoh.Session:
    return open_session(running.scenario.bus, "client")


def test_malformed_payloads_crash_nothing_and_change_no_trajectory(stack):
    settings = ("sim.duration_s=10.0", "seed=11")
    malformed = Malformed(sample_messages(load_scenario(BACK, ("sim.duration_s=1.0",))))
    running = stack(BACK, *settings, "sim.mode=lockstep")
    sim = running.scenario.sim
    trajectory = Trajectory(running.bus, sim.tick_ns, sim.ticks, running.scenario.services)
    running.start()
    source = iter(malformed)
    with intruder(running) as session:
        sent = 0
        while sent < PAYLOADS or not trajectory.complete:
            # half of them at least while it runs
            if sent < PAYLOADS and trajectory.done * PAYLOADS >= sent * sim.ticks // 2:
                for _ in range(BATCH):
                    made = next(source)
                    if made.key in CALLS:
                        channel = zenoh.handlers.FifoChannel(1)
                        session.get(made.key, payload=made.payload, handler=channel)
                    else:
                        session.put(
                            made.key,
                            made.payload,
                            encoding=made.encoding or None,
                            attachment=made.attachment,
                        )
                sent += BATCH
            running.supervisor.poll(0.0)  # a process that ends is an error
            running.bus.spin_once(0.01)
    assert trajectory.rows() == simulate(load_scenario(BACK, settings), "back")[1].rows()
    assert running.bus.call(keys.SIM_STATE, Empty()).tick == sim.ticks - 1


def test_under_a_flood_time_goes_on_and_memory_does_not_grow(stack):
    running = stack(BACK)
    ticks = []
    running.bus.subscribe(keys.FOLLOWER_STATE, lambda _, stamp: ticks.append(stamp.time_ns))
    running.start()
    running.wait(lambda: bool(ticks))
    floods = {"cmd_vel": b'{"linear":{"x":0.1}}', "of/ones/own": bytes(MAX_PAYLOAD_BYTES)}
    floods |= {topic.key: bytes(MAX_PAYLOAD_BYTES) for topic in keys.TOPICS[:10:3]}
    with intruder(running) as session:

        def flood_until(time_ns):
            def going():
                for key, payload in floods.items():
                    for _ in range(1 if len(payload) > 1000 else 100):
                        session.put(key, payload, encoding=JSON_ENCODING)
                return ticks[-1] > time_ns

            running.wait(going)

        flood_until(ticks[-1] + 10**9)
        before = memory(running)
        flood_until(ticks[-1] + 4 * 10**9)
        after = memory(running)
    growth = {name: after[name] - before[name] for name in before}
    assert max(growth.values()) < GROWTH_BYTES, growth


@pytest.mark.parametrize("part", ["payload", "attachment"])
def test_what_is_far_too_long_is_not_even_put_together(stack, part):
    running = stack(BACK)
    ticks = []
    running.bus.subscribe(keys.FOLLOWER_STATE, lambda _, stamp: ticks.append(stamp.time_ns))
    running.start()
    running.wait(lambda: bool(ticks))
    before = peaks(running)
    with intruder(running) as session:
        sent = {"payload": b"", part: bytes(HUGE_BYTES)}
        for key in ("cmd_vel", "of/ones/own"):
            session.put(key, congestion_control=zenoh.CongestionControl.BLOCK, **sent)
        begin = ticks[-1]
        running.wait(lambda: ticks[-1] > begin + 10**9)
    growth = {name: peak - before[name] for name, peak in peaks(running).items()}
    assert max(growth.values()) < GROWTH_BYTES, growth


def peaks(running) -> dict[str, int]:
    """The most memory that each process has had [bytes]."""
    pids = running.supervisor.pids.items()
    status = {name: Path(f"/proc/{pid}/status").read_text() for name, pid in pids}
    return {name: 1024 * int(text.split("VmHWM:")[1].split()[0]) for name, text in status.items()}


def memory(running) -> dict[str, int]:
    return {
        name: psutil.Process(pid).memory_info().rss for name, pid in running.supervisor.pids.items()
    }
