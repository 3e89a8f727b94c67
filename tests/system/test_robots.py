"""Several robots in one world, each for itself."""

import re
from contextlib import closing

import pytest
from harness import SCENARIOS, Newest, mecazen, tools, wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, ResetRequest
from mecazen.robots import join_key
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.simulate import simulate

CONVOY = SCENARIOS / "convoy.toml"


def test_a_robot_far_from_others_moves_as_it_would_alone():
    settings = ("sim.duration_s=4.0", "robots.two.start={y_m=-5.0}")
    scenario = load_scenario(CONVOY, parse_settings(settings))
    together = simulate(scenario, "convoy")[1]
    wide = len(together.columns) // 2 + 1
    alone = simulate(scenario.of("one"), "one")[1]
    assert [row[:wide] for row in together.rows()] == alone.rows()


def of_each(running, topic) -> dict[str, Newest]:
    """The newest sample of a topic of each robot."""
    names = running.scenario.names
    return {name: Newest(running.bus, keys.of_robot(topic, name)) for name in names}


def test_in_real_time_each_robot_follows_its_own_person(stack):
    running = stack(CONVOY, "sim.speed=2", "target.path.start_after_s=0.5")
    robots, persons = of_each(running, keys.GROUND_TRUTH), of_each(running, keys.TARGET_ODOM)
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


def test_a_command_in_a_robots_namespace_drives_that_one_alone(stack):
    running = stack(CONVOY, "services=['physics', 'controller']")
    odom = of_each(running, keys.ODOM)
    running.start()
    running.wait(lambda: all(of.message for of in odom.values()))
    drive = '{"linear":{"x":0.3}}'
    done = mecazen(*tools(running.scenario.bus), "pub", join_key("cmd_vel", "one"), drive)
    assert done.returncode == 0, done.stderr
    running.wait(lambda: odom["one"].pose.x > -0.95)
    assert odom["two"].pose.x == pytest.approx(-1.0, abs=1e-3)
    assert running.call(keys.SIM_STATE, Empty()).tick > 0
    live = mecazen(*tools(running.scenario.bus), "topics", "--live").stdout
    # the row of odom has the rate of each robot, in lines of its own
    row = live[live.index("│ odom") :][: 2 * len(live.splitlines()[0]) + 2]
    assert re.search(r"│ one [1-9]\d* *│.*│ two [1-9]\d* *│", row, re.DOTALL)
