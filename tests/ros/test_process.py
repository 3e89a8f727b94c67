"""A ROS node's view of its process: its robot's topics, queries and files."""

from collections import defaultdict
from types import SimpleNamespace

import pytest
from harness import Answer, forward
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.keys import call_of_robot, of_robot
from mecazen.messages import SimState, StepRequest
from mecazen_ros.process import Process


@pytest.fixture
def bus():
    """A bus within the process, with what the Zenoh bus has besides: listeners and a queue."""
    bus = LocalBus()
    by_topic = defaultdict(list)
    bus.listeners, bus.queue = by_topic.__getitem__, SimpleNamespace()
    return bus


@pytest.mark.parametrize(("own", "robot", "whose"), [("", "", ""), ("one", "", "one")])
def test_a_topic_is_that_of_the_nodes_robot_unless_another_is_named(bus, own, robot, whose):
    put = []
    process = Process(bus, own, lambda *sample: put.append(sample))
    for _ in range(2):
        process.listen(keys.ODOM, robot, print)
    process.listen(keys.ODOM, "two", print)
    topic = of_robot(keys.ODOM, whose)
    assert bus.listeners(topic) == bus.listeners(of_robot(keys.ODOM, "two")) == [print]
    for _ in range(2):
        process.unlisten(keys.ODOM, robot, print)
    assert bus.listeners(topic) == []
    process.publish(keys.CMD_VEL, robot, forward(0.5))
    assert put == [(of_robot(keys.CMD_VEL, whose), forward(0.5))]
    process.refuse("ros/cmd_vel", robot, "no twist", 3)
    assert bus.refused == {f"{whose}/ros/cmd_vel".removeprefix("/"): 3}


def test_queries_and_files_are_those_of_the_robot(bus):
    step = call_of_robot(keys.SIM_STEP, "one")
    bus.serve(step, lambda request, reply: reply.answer(SimState(tick=request.ticks)))
    bus.serve_files("one/robot_description", {"meshes/a.stl": b"a"})
    process = Process(bus, "one", print)
    assert process.call(keys.SIM_STEP, "", StepRequest(ticks=4)).tick == 4
    answer = Answer()
    process.ask(keys.SIM_STEP, StepRequest(ticks=5), answer)
    assert answer.message.tick == 5
    assert process.files("robot_description", "") == {"meshes/a.stl": b"a"}
