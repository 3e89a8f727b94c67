"""No service that freezes while the robot drives at a person makes it touch the person.

As a program it counts false stops: ticks in which the command of a running guard was too old.
"""

import os
import signal
import subprocess
import sys

import pytest
from harness import SCENARIOS, Newest
from mecazen import keys
from mecazen.geometry import Twist2D
from mecazen.messages import Twist
from stack import Stack

TELEOP = SCENARIOS / "teleop.toml"
SPEED_M_S = 1.0
FROZEN_S = 2.0
"""Simulated time for which it is frozen: four times as long as a watchdog without a guard waits."""
PERSON_RADIUS_M = 0.2


@pytest.mark.parametrize("gap_m", [0.7, 0.5, 0.3])  # before the guard brakes, as it does, and late
@pytest.mark.parametrize("name", ["guard", "controller", "sensors", "target"])
def test_a_robot_that_drives_at_a_person_touches_nobody_if_a_service_freezes(stack, name, gap_m):
    running = stack(TELEOP, "start.x_m=-2.0")
    robot, person = Newest(running.bus, keys.GROUND_TRUTH), Newest(running.bus, keys.TARGET_ODOM)
    front_m = running.scenario.robot.footprint[0]
    gaps: list[float] = []

    def note(_, stamp) -> None:
        if person.message is not None and robot.message is not None:
            gaps.append(robot.pose.distance(person.pose) - front_m - PERSON_RADIUS_M)

    running.bus.subscribe(keys.GROUND_TRUTH, note, every=True)
    command = running.bus.publisher(keys.CMD_VEL)
    running.start()

    def drive_until(condition) -> None:
        def check() -> bool:
            command.put(Twist.planar(Twist2D(SPEED_M_S)), None)
            return condition()

        running.wait_unwatched(check)

    drive_until(lambda: gaps and gaps[-1] < gap_m)
    pid, begin_ns = running.supervisor.pids[name], robot.stamp.time_ns
    os.kill(pid, signal.SIGSTOP)
    try:
        drive_until(lambda: robot.stamp.time_ns > begin_ns + FROZEN_S * 1e9)
    finally:
        os.kill(pid, signal.SIGCONT)
    thawed_ns = robot.stamp.time_ns
    drive_until(lambda: robot.stamp.time_ns > thawed_ns + 1e9)
    assert 0.0 < min(gaps) < 0.3  # it did drive at them


def false_stops(busy: int, seconds: float) -> tuple[int, int]:
    """Return the ticks of a run beside busy processes, and those in which a command was too old."""
    running = Stack(SCENARIOS / "safety.toml", ())
    clock, report = (
        Newest(running.bus, topic) for topic in (keys.CLOCK, keys.diagnostics("controller"))
    )
    load = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    try:
        running.start()
        running.wait(lambda: clock.stamp is not None and clock.stamp.time_ns > seconds * 1e9)
        values = {value.key: value.value for value in report.message.status[0].values}
        return clock.stamp.time_ns // 10_000_000, int(values["expired_ticks"])
    finally:
        for process in load:
            process.kill()
        running.close()


if __name__ == "__main__":
    for busy in (0, 4):
        ticks, expired = false_stops(busy, 30.0)
        print(f"{busy} busy processes: {expired} of {ticks} ticks without a fresh command")
