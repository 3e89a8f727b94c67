"""Real time: from `cmd_vel` put by another process to the `joint_command` that obeys it."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager, suppress
from multiprocessing import get_context

import numpy as np
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.geometry import Twist2D
from mecazen.loading import load_scenario
from mecazen.messages import JointState, Twist
from mecazen.wire import JSON_ENCODING, Stamp, encode
from mecazen_tools.processes import Supervisor, private_router

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

PUTS = 500
PAUSE_S = (0.003, 0.009)
"""Least and longest time between two puts: any phase of the 10 ms tick."""
ANSWER_S = 1.0
"""After this an answer is lost; the tick's own command repeats it within 10 ms."""
START_S = 20.0

BUSY = "every core kept busy by others"

SPEED, SPEED_STEP = 0.05, 1e-5
"""Of the first command and between two [m/s]: within what the controller's limits let pass."""

MEDIAN_MS = Target.below(0.2)
P99_MS = Target.below(1.0)
BUSY_P99_MS = Target.below(5.0)


class Probe:
    """Puts commands, each with a speed of its own, and sees when the wheels are told of it."""

    def __init__(self, bus: ZenohBus, wheel_radius: float) -> None:
        self._bus = bus
        self._radius = wheel_radius
        self._told = -1
        self._told_s = 0.0
        bus.subscribe(keys.JOINT_COMMAND, self._on_joint_command, every=True)

    def measure(self, number: int, timeout_s: float) -> float | None:
        """Return the time from put to answer of command `number` [s], or None without one."""
        # backwards: away from the person
        twist = Twist.planar(Twist2D(x=-SPEED - number * SPEED_STEP))
        begin = time.perf_counter()
        self._bus.put_bytes(keys.CMD_VEL.key, encode(twist, "json"), JSON_ENCODING)
        while self._told != number:
            left_s = begin + timeout_s - time.perf_counter()
            if left_s <= 0.0:
                return None
            self._bus.spin_once(left_s)
        return self._told_s - begin

    def rest(self, seconds: float) -> None:
        """Take what comes for some time."""
        end = time.perf_counter() + seconds
        while (left_s := end - time.perf_counter()) > 0.0:
            self._bus.spin_once(left_s)

    def _on_joint_command(self, joints: JointState, stamp: Stamp | None) -> None:
        del stamp
        number = round((-joints.velocity[0] * self._radius - SPEED) / SPEED_STEP)
        if number != self._told:
            self._told, self._told_s = number, time.perf_counter()


def run(puts: int = PUTS) -> list[Group]:
    """Drive the scenario `teleop` as an outsider does, alone and while others work."""
    rows = []
    with teleop() as scenario, ProcessPoolExecutor(1, get_context("spawn"), go_first) as driver:
        for subject, goal in (("idle", P99_MS), (BUSY, BUSY_P99_MS)):
            with _others(len(os.sched_getaffinity(0)) if subject == BUSY else 0):
                latencies = driver.submit(_drive, scenario, puts).result()
            rows.append(Row(subject, figures(latencies, goal)))
    how = (
        f"{puts} puts by another process at random phases of the tick, in real time; all go "
        "before what else the machine does, where that is allowed"
    )
    return [Group("Latency from cmd_vel to joint_command: scenario teleop", how, tuple(rows))]


def go_first() -> None:
    """Do as the services do; see `mecazen.runtime`."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))


@contextmanager
def _others(count: int) -> Iterator[None]:
    """Let `count` processes compute without end meanwhile."""
    command = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def _drive(scenario: Scenario, puts: int) -> list[float | None]:
    with closing(ZenohBus(scenario.bus)) as bus:
        return drive(bus, scenario, puts)


def drive(bus: ZenohBus, scenario: Scenario, puts: int) -> list[float | None]:
    """Return the time from put to answer of each command [s], or None without an answer.

    Raises:
        MecazenError: Nothing obeys.
    """
    pause = random.Random(1)  # noqa: S311
    probe = Probe(bus, scenario.robot.wheels.radius_m)
    _wait_until_it_obeys(probe)
    latencies = []
    for number in range(1, puts + 1):
        probe.rest(pause.uniform(*PAUSE_S))
        latencies.append(probe.measure(number, ANSWER_S))
    return latencies


def figures(latencies: Sequence[float | None], goal: Target = P99_MS) -> dict[str, Figure]:
    """Return the percentiles of what `drive` returns; `goal` is that of the 99th."""
    answered = [latency * 1e3 for latency in latencies if latency is not None]
    median, p99 = np.percentile(answered, (50, 99)).tolist()
    return {
        "median ms": Figure.of(median, "less" if goal is BUSY_P99_MS else MEDIAN_MS),
        "p99 ms": Figure.of(p99, goal),
        "max ms": Figure.of(max(answered), "less"),
        "lost": Figure.of(len(latencies) - len(answered), "less"),
    }


@contextmanager
def teleop() -> Iterator[Scenario]:
    """Run the scenario's processes meanwhile, apart from any others; yield how to reach them."""
    path = SCENARIOS / "teleop.toml"
    settings = private_router()
    scenario = load_scenario(path, settings)
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        for part in scenario.services:
            supervisor.start(part)
        yield scenario
        supervisor.poll(0.0)
    finally:
        supervisor.stop()


def _wait_until_it_obeys(probe: Probe) -> None:
    """Repeat the first command until the wheels have reached it.

    Raises:
        MecazenError: They do not.
    """
    deadline = time.monotonic() + START_S
    while probe.measure(0, 0.1) is None:
        if time.monotonic() > deadline:
            raise MecazenError("teleop does not answer cmd_vel")
