"""The cost of ROS 2 in a tick, in addition to the plain keys."""

from __future__ import annotations

from contextlib import ExitStack, closing
from statistics import median
from typing import Any

from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process, Scenario
from mecazen.messages import Empty
from mecazen.robots import join_key
from mecazen_ros.node import of_ros

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import Stack, paused, running, spent_s, spin

SERVICES = ("physics", "controller", "target", "follower")
LOCKSTEP = 'sim.mode="lockstep"', "sim.duration_s=36000.0"
"""Settings with which no run ends within the measurement."""
OF_ROBOT = ("odom", "ground_truth/odom", "joint_states")
OF_NO_ROBOT = ("clock", "tf")
"""Topics of five subscribers in ROS: samples come in every tick."""
WITHOUT, NONE, FIVE = "without ROS 2", "0 subscribers", "5 subscribers"
WINDOWS, WINDOW_S = 5, 1.0
SETTLED_S = 0.3
"""Time after which both sides know all subscribers."""
UNHEARD_PERCENT: Goal = (None, 2.0)


def run(windows: int = WINDOWS, window_s: float = WINDOW_S) -> list[Group]:
    """Measure the processor time of a tick, in turns without ROS, with 0 and 5 subscribers."""
    spent: dict[str, list[float]] = {name: [] for name in (WITHOUT, NONE, FIVE)}
    with ExitStack() as exits:
        stacks = {}
        for ros in (False, True):
            settings = (*LOCKSTEP, f"bus.ros2={str(ros).lower()}")
            stack = exits.enter_context(running("back", *settings, services=()))
            stack.supervisor.start(Process(SERVICES))
            stacks[ros] = stack, exits.enter_context(paused(stack))
        for _ in range(windows):
            for name, micros in spent.items():
                stack, bus = stacks[name != WITHOUT]
                with closing(_listening(stack.scenario, subscribes=name == FIVE)):
                    spin(bus, SETTLED_S)
                    micros.append(_measure(stack, bus, window_s))
    rows = {}
    for name, micros in spent.items():
        extra = [one / base - 1.0 for one, base in zip(micros, spent[WITHOUT], strict=True)]
        rows[name] = {
            "µs/tick": Figure(median(micros), "less"),
            "% more": Figure(100.0 * median(extra), UNHEARD_PERCENT if name == NONE else "less"),
        }
    how = (
        f"processor time of a process with {len(SERVICES)} services, in lockstep: the "
        f"medians of {windows} windows of {window_s:g} s, in turns"
    )
    return [Group("ROS 2, cost of a tick: scenario back", how, rows)]


def _listening(scenario: Scenario, *, subscribes: bool) -> Any:
    """Return a session that receives five topics of ROS, or no topics."""
    session = open_session(of_ros(scenario.bus), "client")
    names = [*OF_NO_ROBOT, *(join_key(name, scenario.bus.namespace or "") for name in OF_ROBOT)]
    for name in names if subscribes else ():
        # in a topic's key only the type and its hash follow the name
        session.declare_subscriber(f"{scenario.bus.ros_domain_id}/{name}/*/*", lambda _: None)
    return session


def _measure(stack: Stack, bus: ZenohBus, window_s: float) -> float:
    """Return the processor time of a tick within a window [µs]."""
    (process,) = (p for name, p in stack.processes().items() if name != "router")
    first = bus.call(keys.SIM_RESUME, Empty()).tick
    begin = spent_s(process)
    spin(bus, window_s)
    last = bus.call(keys.SIM_PAUSE, Empty()).tick
    return 1e6 * (spent_s(process) - begin) / (last - first)
