"""The loop in real time, as processes: following, several robots, and driving by hand."""

import os
import re
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from harness import COMMAND_GUARD_S, SCENARIOS, Command, Newest, here, tools, wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, ResetRequest
from mecazen.robots import join_key
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory

ZENOH_CLI = Path(sys.executable).parent / "zenoh"
TWIST = '{"linear":{"x":0.3}}'


def test_without_a_missed_deadline_real_time_gives_the_lockstep_trajectory(stack):
    # ticks of 0.25 s of wall time: 50 times what the loop takes, so no deadline is missed
    settings = ("sim.duration_s=0.12", "target.path.start_after_s=0.04", "sim.speed=0.04")
    running = stack(SCENARIOS / "back.toml", *settings)
    sim = running.scenario.sim
    trajectory = Trajectory(running.bus, running.scenario)
    running.start()
    running.watch(trajectory)
    running.wait(lambda: trajectory.complete)
    assert running.call(keys.SIM_STATE, Empty()).missed_deadlines == 0
    lockstep = simulate(load_scenario(SCENARIOS / "back.toml", parse_settings(settings)), "back")[1]
    assert trajectory.rows()[: sim.ticks] == lockstep.rows()


def zenoh_cli(running, *arguments: str) -> subprocess.Popen[str]:
    """Start a command of Zenoh's own tool."""
    namespace = f'namespace:"{running.scenario.bus.namespace}"'
    where = "--mode", "client", "--connect", running.endpoint, "--cfg", namespace
    return subprocess.Popen(
        [ZENOH_CLI, *where, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip


def test_an_unmodified_zenoh_cli_drives_the_robot_until_the_guard_stops_it_and_resets_it(stack):
    running = stack(SCENARIOS / "teleop.toml")
    odom, guard = Newest(running.bus, keys.ODOM), Newest(running.bus, keys.GUARD_STATE)
    running.start()
    zenoh_cli(running, "put", "-k", "cmd_vel", "-v", TWIST).communicate(timeout=COMMAND_GUARD_S)
    running.wait(lambda: odom.message is not None and odom.pose.x > -0.95)
    # one command: the robot comes to rest when it is stale
    running.wait(lambda: odom.message.twist.twist.linear.x < 1e-3)
    with zenoh_cli(running, "subscribe", "-k", "odom", "--decoder", "json") as shown:
        line = msgspec.json.decode(shown.stdout.readline())
        shown.kill()
    assert line["child_frame_id"] == "base_link"
    reset = zenoh_cli(running, "get", "-s", "sim/reset", "--decoder", "json")
    answer, _ = reset.communicate(timeout=COMMAND_GUARD_S)
    assert msgspec.json.decode(answer)["tick"] == 0
    running.wait(lambda: odom.pose.x == pytest.approx(-1.0, abs=1e-6))
    # without --duration: until the robot stands, however slow the machine is
    drive = Command(*tools(running.scenario.bus), "pub", "cmd_vel", TWIST, "--rate", "20")
    running.wait(lambda: guard.message.state == "stop" and odom.pose.x > -0.95)
    drive.end()
    assert guard.message.reason.endswith("m ahead")


CONVOY = SCENARIOS / "convoy.toml"


def test_in_real_time_each_robot_follows_its_own_person_and_obeys_its_own_commands(stack):
    running = stack(CONVOY, "sim.speed=2", "target.path.start_after_s=0.5")
    robots, persons = (
        {name: Newest(running.bus, keys.of_robot(topic, name)) for name in running.scenario.names}
        for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM)
    )
    running.start()
    running.wait(lambda: all(of.message and of.pose.x > 1.0 for of in persons.values()))
    # 0.1 m is twice the noise of a single observation; a robot left behind is 1 m off for good, and
    # one on a busy machine for a moment
    running.wait(
        lambda: all(
            abs(robots[name].pose.distance(person.pose) - 1.0) < 0.1
            for name, person in persons.items()
        )
    )
    assert running.call(keys.SIM_RESET, ResetRequest(seed=9)).seed == 9
    running.wait(lambda: all(of.stamp.seed == 9 for of in (*robots.values(), *persons.values())))
    with closing(ZenohBus(running.scenario.bus, "client")) as tool:
        diagnostics = Diagnostics(tool)
        diagnostics.status()
        wait(tool, lambda: {"two/follower", "physics"} <= diagnostics.reports.keys())
        status = diagnostics.status()
    assert {"physics", "one/follower", "two/follower"} <= status.services.keys()
    assert {of.state for name, of in status.services.items() if name != "test"} >= {"ready"}
    assert "two/joint_command" in status.services["physics"].inputs
    drive = ("pub", join_key("cmd_vel", "one"), '{"linear":{"x":-0.3}}', "--rate", 50)
    hand = Command(*tools(running.scenario.bus), *drive)
    running.wait(lambda: robots["one"].message.twist.twist.linear.x < -0.1)
    assert robots["two"].message.twist.twist.linear.x > -0.05  # it drives that one alone
    hand.end()
    live = here(*tools(running.scenario.bus), "topics", "--live").stdout
    # the row of odom has the rate of each robot, in lines of its own
    row = live[live.index("│ odom") :][: 2 * len(live.splitlines()[0]) + 2]
    assert re.search(r"│ one [1-9]\d* *│.*│ two [1-9]\d* *│", row, re.DOTALL)
