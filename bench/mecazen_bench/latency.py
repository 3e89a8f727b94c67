"""Real-time latency from `cmd_vel` of another process to the `joint_command` that follows."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, closing
from multiprocessing import get_context

import numpy as np
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.geometry import Twist2D
from mecazen.messages import JointState, Twist
from mecazen.wire import JSON_ENCODING, Stamp, encode

from mecazen_bench.harness import Row, Tables
from mecazen_bench.processes import running, set_priority, spin, spin_until

PUTS = 500
PAUSE_S = (0.003, 0.009)
"""Minimum and maximum time between two puts, which are at any phase of the 10 ms tick."""
ANSWER_S = 1.0
"""Timeout of an answer; the next tick's command repeats the answer within 10 ms."""
SPEED, SPEED_STEP = 0.05, 1e-5
"""Speed of the first command, and step between commands [m/s]: within the controller's limits."""

BLIND = "sensor.also=[]"
"""Setting without lidar and guard: only the path to the controller is measured."""
TOGETHER = 'processes=[["physics","controller","target"]]'


def run(puts: int = PUTS) -> Tables:
    """Drive the scenario `teleop` from outside, without its guard, idle and under load."""
    with ProcessPoolExecutor(1, get_context("spawn"), set_priority) as driver:
        with running("teleop", BLIND) as stack:
            idle = driver.submit(drive, stack.scenario, puts).result()
            with ExitStack() as exits:
                for _ in range(len(os.sched_getaffinity(0))):
                    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
                    exits.callback(process.wait)
                    exits.callback(process.kill)
                busy = driver.submit(drive, stack.scenario, puts).result()
        with running("teleop", BLIND, TOGETHER) as stack:
            together = driver.submit(drive, stack.scenario, puts).result()
    return {
        "Latency from cmd_vel to joint_command: scenario teleop": {
            "idle": percentiles(idle),
            "idle, all services in one process": percentiles(together),
            "all cores busy": percentiles(busy),
        }
    }


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


def percentiles(latencies: Sequence[float | None]) -> Row:
    """Return the percentiles of the result of `drive`."""
    answered = [latency * 1e3 for latency in latencies if latency is not None]
    half, most = np.percentile(answered, (50, 99)).tolist()
    return {
        "median ms": (half, "less"),
        "p99 ms": (most, "less"),
        "max ms": (max(answered), "less"),
        "lost": (float(len(latencies) - len(answered)), "less"),
    }
