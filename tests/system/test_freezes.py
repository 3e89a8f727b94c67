"""No service that freezes while the robot drives at a person makes it touch the person."""

import os
import signal

from harness import SCENARIOS, Newest
from mecazen import keys
from mecazen.geometry import Twist2D
from mecazen.messages import ResetRequest, Twist

TELEOP = SCENARIOS / "teleop.toml"
SPEED_M_S = 1.0
FROZEN_S = 2.0
"""Simulated time for which it is frozen: four times as long as a watchdog without a guard waits."""
PERSON_RADIUS_M = 0.2
GAP_M = 0.5
"""At which the guard brakes."""


def test_a_robot_that_drives_at_a_person_touches_nobody_if_a_service_freezes(stack):
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

    for name in ("guard", "controller", "sensors", "target"):
        drive_until(lambda: gaps and gaps[-1] < GAP_M)
        pid, begin_ns = running.supervisor.pids[name], robot.stamp.time_ns
        os.kill(pid, signal.SIGSTOP)
        try:
            drive_until(lambda end=begin_ns + FROZEN_S * 1e9: robot.stamp.time_ns > end)
        finally:
            os.kill(pid, signal.SIGCONT)
        thawed_ns = robot.stamp.time_ns
        drive_until(lambda end=thawed_ns + 1e9: robot.stamp.time_ns > end)
        assert 0.0 < min(gaps) < 0.3, name  # it did drive at them
        run = running.call(keys.SIM_RESET, ResetRequest()).run
        running.wait_unwatched(lambda run=run: robot.stamp.run == person.stamp.run == run)
        gaps.clear()
