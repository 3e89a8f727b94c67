"""A robot that is driven by hand, as docs/quickstart.md has it, and the guard that holds it."""

import math

from harness import SCENARIOS, Command, tools
from mecazen import keys

AT_REST_M_S = 0.02
"""Rollers that settle still move the body by less."""


def test_the_drive_command_of_the_page_stops_before_the_person_and_it_is_said_why(stack):
    running = stack(SCENARIOS / "teleop.toml")
    newest = {}
    for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM, keys.GUARD_STATE):
        running.bus.subscribe(
            topic, lambda message, _, key=topic.key: newest.update({key: message})
        )
    running.start()
    running.wait(lambda: len(newest) == 3)
    # without --duration: until the robot stands, however slow the machine is
    drive = ("pub", "cmd_vel", '{"linear":{"x":0.3}}', "--rate", "20")
    driving = Command(*tools(running.scenario.bus), *drive)

    def stopped():
        state, robot = newest[keys.GUARD_STATE.key], newest[keys.GROUND_TRUTH.key]
        return state.state == "stop" and abs(robot.twist.twist.linear.x) < AT_REST_M_S

    running.wait(stopped)
    state = newest[keys.GUARD_STATE.key]
    robot, person = (
        newest[topic.key].pose.pose.position for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM)
    )
    driving.end()
    length, _ = running.scenario.robot.footprint
    apart = math.hypot(person.x - robot.x, person.y - robot.y)
    gap = apart - length - running.scenario.world.person.radius_m
    assert 0.0 < gap < 0.5  # at the start, 1 m apart, it is 0.6 m
    assert state.reason.endswith("m ahead")
