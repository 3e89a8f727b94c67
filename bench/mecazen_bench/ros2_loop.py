"""ROS 2 beside the plain keys: what it adds to a tick, and how late a command from it comes."""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from functools import partial
from multiprocessing import get_context
from statistics import median
from typing import Any

from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process, Scenario
from mecazen.messages import Clock, Empty, JointState, Message, Odometry, Twist
from mecazen.robots import join_key
from mecazen_ros import cdr
from mecazen_ros.interfaces import message
from mecazen_ros.node import of_ros
from mecazen_ros.protocol import Attachment, data_key, dds_type
from mecazen_ros.types import type_hash

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.latency import ANSWER_S, BLIND, PAUSE_S, PUTS, Probe, figures, set_priority
from mecazen_bench.stack import Stack, running, spent_s, spin, spin_until

SERVICES = ("physics", "controller", "target", "follower")
LOCKSTEP = 'sim.mode="lockstep"', "sim.duration_s=36000.0"
"""No run ends within the measurement."""
SUBSCRIBED: dict[str, type[Message]] = {
    "clock": Clock, "tf": message("TFMessage"), "odom": Odometry, "ground_truth/odom": Odometry,
    "joint_states": JointState,
}  # fmt: skip
"""What five subscribers in ROS hear: all of it comes every tick, but for most frames."""
SHARED = ("clock", "tf")
"""Of no robot."""
WITHOUT, NONE, FIVE = "without ROS 2", "0 subscribers", "5 subscribers"
WINDOWS, WINDOW_S = 5, 1.0
SETTLED_S = 0.3
"""After it both sides know who subscribes."""

UNHEARD_PERCENT = Target(high=2.0)


def run(puts: int = PUTS, windows: int = WINDOWS, window_s: float = WINDOW_S) -> list[Group]:
    """Measure both."""
    return [_ticks(windows, window_s), _latency(puts)]


def _key(scenario: Scenario, name: str, kind: type[Message]) -> str:
    """Return the key of a topic in ROS."""
    whole = name if name in SHARED else join_key(name, scenario.bus.namespace or "")
    return data_key(scenario.bus.ros_domain_id, whole, dds_type(kind.ROS_TYPE), type_hash(kind))


def _ticks(windows: int, window_s: float) -> Group:
    """Measure the processor time of a tick, in turns without ROS, unheard and with subscribers."""
    spent: dict[str, list[float]] = {name: [] for name in (WITHOUT, NONE, FIVE)}
    with (
        running("back", *LOCKSTEP, services=()) as plain,
        running("back", *LOCKSTEP, "bus.ros2=true", services=()) as seen,
    ):
        for stack in (plain, seen):
            stack.supervisor.start(Process(SERVICES))
        buses = [ZenohBus(stack.scenario.bus) for stack in (plain, seen)]
        for bus in buses:
            spin_until(bus, partial(_is_ready, bus), "`back` does not start")
            bus.call(keys.SIM_PAUSE, Empty())
        for _ in range(windows):
            for name, micros in spent.items():
                stack, bus = (plain, buses[0]) if name == WITHOUT else (seen, buses[1])
                with closing(_listening(stack.scenario, subscribes=name == FIVE)):
                    spin(bus, SETTLED_S)
                    micros.append(_measure(stack, bus, window_s))
        for bus in buses:
            bus.close()
    rows = []
    for name, micros in spent.items():
        more = [one / base - 1.0 for one, base in zip(micros, spent[WITHOUT], strict=True)]
        goal: Target | Better = UNHEARD_PERCENT if name == NONE else "less"
        shown = {
            "µs/tick": Figure.of(median(micros), "less"),
            "% more": Figure.of(100.0 * median(more), goal),
        }
        rows.append(Row(name, shown))
    how = (
        f"processor time of a process with {len(SERVICES)} services, in lockstep: the "
        f"medians of {windows} windows of {window_s:g} s, in turns"
    )
    return Group("ROS 2, cost of a tick: scenario back", how, tuple(rows))


def _is_ready(bus: ZenohBus) -> bool:
    return bool(bus.alive() >= {f"{name}/ready" for name in SERVICES})


def _listening(scenario: Scenario, *, subscribes: bool) -> Any:
    """Return a session that hears five topics, or none."""
    session = open_session(of_ros(scenario.bus), "client")
    for name, kind in SUBSCRIBED.items() if subscribes else ():
        session.declare_subscriber(_key(scenario, name, kind), lambda _: None)
    return session


def _measure(stack: Stack, bus: ZenohBus, window_s: float) -> float:
    """Return the processor time of a tick within a window [µs]."""
    (process,) = (p for name, p in stack.processes().items() if name != "router")
    first = bus.call(keys.SIM_RESUME, Empty()).tick
    begin = spent_s(process)
    spin(bus, window_s)
    last = bus.call(keys.SIM_PAUSE, Empty()).tick
    return 1e6 * (spent_s(process) - begin) / (last - first)


def _latency(puts: int) -> Group:
    with (
        running("teleop", BLIND, "bus.ros2=true") as stack,
        ProcessPoolExecutor(1, get_context("spawn"), set_priority) as driver,
    ):
        plain, ros = driver.submit(drive, stack.scenario, puts).result()
    how = f"{puts} puts of each, in turns, by another process at random phases of the tick"
    rows = Row("plain", figures(plain)), Row("from ROS 2", figures(ros, "less", Target(high=5.0)))
    return Group("ROS 2, latency from cmd_vel to joint_command: scenario teleop", how, rows)


def _is_answered(probe: Probe) -> bool:
    return probe.measure(0, 0.1) is not None


class _RosProbe(Probe):
    """Puts commands as a ROS node does."""

    def __init__(self, bus: ZenohBus, scenario: Scenario, session: Any) -> None:
        super().__init__(bus, scenario.robot.wheels.radius_m)
        self._publisher = session.declare_publisher(_key(scenario, keys.CMD_VEL.key, Twist))

    def put(self, twist: Twist) -> None:
        attachment = Attachment(1, time.time_ns(), bytes(16))
        self._publisher.put(cdr.encode(twist), attachment=attachment.pack())


def drive(scenario: Scenario, puts: int) -> tuple[Sequence[float | None], Sequence[float | None]]:
    """Return the time from put to answer of plain commands and of ROS's [s]; see `latency.drive`.

    Raises:
        MecazenError: There is no answer at all.
    """
    pause = random.Random(1)  # noqa: S311
    found: tuple[list[float | None], list[float | None]] = [], []
    with (
        closing(ZenohBus(scenario.bus)) as bus,
        closing(open_session(of_ros(scenario.bus), "client")) as session,
    ):
        probes = Probe(bus, scenario.robot.wheels.radius_m), _RosProbe(bus, scenario, session)
        for probe in probes:
            failure = "teleop does not answer cmd_vel"
            spin_until(bus, partial(_is_answered, probe), failure)
        for number in range(1, 2 * puts + 1):
            spin(bus, pause.uniform(*PAUSE_S))
            found[number % 2].append(probes[number % 2].measure(number, ANSWER_S))
    return found
