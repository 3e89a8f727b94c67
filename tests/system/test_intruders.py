"""One client against a running scenario, open or secured: nothing that it sends changes it.

`--scale N` makes it last N times as long.
"""

from contextlib import closing
from functools import partial
from pathlib import Path

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
from system.intruders import Intruder, sample_messages

BACK = SCENARIOS / "back.toml"

PAYLOADS = 20_000
"""Multiplied by `--scale`; without it a quarter of them."""
BATCH = 200
GROWTH_BYTES = 64_000_000
"""A service may keep 16 samples of 64 KiB on each of its keys; a leak has no bound."""
TOOLS = 5

HUGE_BYTES = 280 << 20
"""Size of a sample that once killed a router's container [bytes]."""


@pytest.mark.parametrize("secured", [False, True], ids=["open", "secured"])
def test_an_intruder_crashes_nothing_and_changes_no_trajectory(
    stack, access_control, tmp_path, scale, secured
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
    join = partial(open_session, config, "client", "viewer")
    intruder = Intruder(join, sample_messages(tmp_path))
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
    assert (
        trajectory.rows()
        == simulate(load_scenario(BACK, parse_settings(settings)), "back")[1].rows()
    )
    late = running.memory()
    growth = {name: late[name] - early[name] for name in early}
    print(f"{intruder.sent} payloads, {sum(early.values())} then {sum(late.values())} bytes")
    assert max(growth.values()) < GROWTH_BYTES, growth
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
    assert max(growth.values()) < GROWTH_BYTES, growth


def peaks(running) -> dict[str, int]:
    """The most memory that each process has had [bytes]."""
    pids = running.supervisor.pids.items()
    status = {name: Path(f"/proc/{pid}/status").read_text() for name, pid in pids}
    return {name: 1024 * int(text.split("VmHWM:")[1].split()[0]) for name, text in status.items()}
