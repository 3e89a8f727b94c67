"""Real-time latency from `cmd_vel` of another process to the `joint_command` that follows."""

from __future__ import annotations

import os
import queue
import random
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager, suppress
from multiprocessing import get_context
from typing import Any

import numpy as np
from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus, direct
from mecazen.config import BusConfig, Scenario
from mecazen.geometry import Twist2D
from mecazen.messages import JointState, Twist
from mecazen.wire import JSON_ENCODING, Stamp, encode

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import running, spin, spin_until

PUTS = 500
PAUSE_S = (0.003, 0.009)
"""Minimum and maximum time between two puts, which are at any phase of the 10 ms tick."""
ANSWER_S = 1.0
"""Timeout of an answer; the next tick's command repeats the answer within 10 ms."""

SPEED, SPEED_STEP = 0.05, 1e-5
"""Speed of the first command, and step between commands [m/s]: within the controller's limits."""

MEDIAN_MS: Goal = (None, 0.2)
P99_MS: Goal = (None, 1.0)
BUSY_P99_MS: Goal = (None, 5.0)

BLIND = "sensor.also=[]"
"""Setting without lidar and guard: only the path to the controller is measured."""

TOGETHER = 'processes=[["physics","controller","target"]]'

THERE, BACK = "bench/there", "bench/back"


def run(puts: int = PUTS) -> list[Group]:
    """Drive the scenario `teleop` from outside, without its guard, idle and under load."""
    cores = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(2, get_context("spawn"), set_priority) as drivers:
        with running("teleop", BLIND) as stack:
            idle = drivers.submit(drive, stack.scenario, puts).result()
            with _busy_processes(cores):
                busy = drivers.submit(drive, stack.scenario, puts).result()
            echo = drivers.submit(send_back, stack.scenario.bus)
            bare = drivers.submit(round_trips, stack.scenario.bus, puts).result()
            echo.result()
        with running("teleop", BLIND, TOGETHER) as stack:
            together = drivers.submit(drive, stack.scenario, puts).result()
    rows = {
        "idle": figures(idle),
        "idle, all services in one process": figures(together),
        "all cores busy": figures(busy, "less", BUSY_P99_MS),
        "bytes there and back, without any of our code": figures(bare, "less"),
    }
    how = (
        f"{puts} puts by another process at random phases of the tick, in real time; all "
        "processes with real-time priority, where that is allowed"
    )
    return [Group("Latency from cmd_vel to joint_command: scenario teleop", how, rows)]


def send_back(config: BusConfig) -> None:
    """Send back each payload, until an empty one arrives."""
    ended = threading.Event()
    with open_session(config, "peer") as session:
        publisher = session.declare_publisher(BACK)

        def receive(sample: Any) -> None:
            publisher.put(sample.payload)
            if not len(sample.payload):
                ended.set()

        session.declare_subscriber(THERE, direct(receive))
        ended.wait()


def round_trips(config: BusConfig, puts: int) -> list[float | None]:
    """Return the round-trip times of a payload to `send_back` [s]; None for a lost one."""
    pause, payload = random.Random(1), bytes(100)  # noqa: S311
    back: queue.SimpleQueue[float] = queue.SimpleQueue()
    times: list[float | None] = []
    with open_session(config, "peer") as session:
        session.declare_subscriber(BACK, direct(lambda _: back.put(time.perf_counter())))
        publisher = session.declare_publisher(THERE)
        while not times or times[-1] is None:  # until both processes have found each other
            times = [_round_trip(publisher, payload, back)]
        for _ in range(puts):
            time.sleep(pause.uniform(*PAUSE_S))
            times.append(_round_trip(publisher, payload, back))
        publisher.put(b"")
        back.get()
    return times[1:]


def _round_trip(publisher: Any, payload: bytes, back: queue.SimpleQueue[float]) -> float | None:
    begin = time.perf_counter()
    publisher.put(payload)
    with suppress(queue.Empty):
        return back.get(timeout=0.1) - begin
    return None


def set_priority() -> None:
    """Set the real-time priority of the services; see `mecazen.runtime`."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))


@contextmanager
def _busy_processes(count: int) -> Iterator[None]:
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def drive(scenario: Scenario, puts: int) -> list[float | None]:
    """Return the time from put to answer of each command [s], or None without an answer."""
    pause = random.Random(1)  # noqa: S311
    with closing(ZenohBus(scenario.bus)) as bus:
        answers: dict[int, float] = {}  # times when the wheels reached each command

        def receive(joints: JointState, _: Stamp | None) -> None:
            rim = -joints.velocity[0] * scenario.robot.wheels.radius_m
            answers.setdefault(round((rim - SPEED) / SPEED_STEP), time.perf_counter())

        def measure(number: int, timeout_s: float) -> float | None:
            # backwards: away from the person
            twist = Twist.planar(Twist2D(x=-SPEED - number * SPEED_STEP))
            begin = time.perf_counter()
            bus.put_bytes(keys.CMD_VEL.key, encode(twist), JSON_ENCODING)
            while number not in answers:
                left_s = begin + timeout_s - time.perf_counter()
                if left_s <= 0.0:
                    return None
                bus.spin_once(left_s)
            return answers[number] - begin

        bus.subscribe(keys.JOINT_COMMAND, receive, every=True)
        failure = "teleop does not answer cmd_vel"
        spin_until(bus, lambda: measure(0, 0.1) is not None, failure)
        latencies = []
        for number in range(1, puts + 1):
            spin(bus, pause.uniform(*PAUSE_S))
            latencies.append(measure(number, ANSWER_S))
    return latencies


def figures(
    latencies: Sequence[float | None], median: Goal = MEDIAN_MS, p99: Goal = P99_MS
) -> dict[str, Figure]:
    """Return the percentiles of the result of `drive`, with goals for median and p99."""
    answered = [latency * 1e3 for latency in latencies if latency is not None]
    half, most = np.percentile(answered, (50, 99)).tolist()
    return {
        "median ms": Figure(half, median),
        "p99 ms": Figure(most, p99),
        "max ms": Figure(max(answered), "less"),
        "lost": Figure(len(latencies) - len(answered), "less"),
    }
