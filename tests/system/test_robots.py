"""Several robots in one world, each for itself."""

import re
from contextlib import closing

import pytest
from harness import SCENARIOS, Command, Newest, here, tools, wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.messages import ResetRequest
from mecazen.robots import join_key
from mecazen_tools.cli.status import Diagnostics

CONVOY = SCENARIOS / "convoy.toml"


def test_in_real_time_each_robot_follows_its_own_person_and_obeys_its_own_commands(stack):
    running = stack(CONVOY, "sim.speed=2", "target.path.start_after_s=0.5")
    robots, persons = (
        {name: Newest(running.bus, keys.of_robot(topic, name)) for name in running.scenario.names}
        for topic in (keys.GROUND_TRUTH, keys.TARGET_ODOM)
    )
    running.start()
    running.wait(lambda: all(of.message and of.pose.x > 1.0 for of in persons.values()))
    for name, person in persons.items():
        # 0.1 m is twice the noise of a single observation; a robot left behind is 1 m off
        assert robots[name].pose.distance(person.pose) == pytest.approx(1.0, abs=0.1)
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
