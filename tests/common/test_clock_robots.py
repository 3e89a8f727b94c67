"""Simulated time of several robots: each is told of and answers in its own namespace."""

import pytest
from carts import Rig, x_of
from harness import Listener
from mecazen import keys
from mecazen.errors import BusError, StepTimeoutError
from mecazen.messages import Empty, ResetRequest
from mecazen.keys import call_of_robot
from mecazen.wire import Stamp

TICK_NS = 10_000_000
TWO = (("physics", "controller", "target"), "one", "two")


def test_each_robot_moves_in_its_namespace_and_all_samples_of_a_tick_have_one_stamp():
    rig = Rig(*TWO)
    shared = Listener(rig.bus, keys.CLOCK)
    for name in ("one", "two"):
        for part, speed in (("controller", 1.0 if name == "one" else 0.5), ("target", 0.0)):
            rig.answer(part, name=name, speed=speed)
    rig.clock.step()
    for name, x in (("one", 0.01), ("two", 0.005)):
        heard = rig.take(name)[-3:]
        assert {sample.stamp for sample in heard} == {Stamp(TICK_NS, rig.clock.stamp.run, 3)}
        assert x_of(heard) == x
    assert [sample.stamp for sample in shared.take()][-1] == rig.clock.stamp


@pytest.mark.parametrize(
    ("answers", "missing"),
    [
        ((), "one/controller, one/target, two/controller, two/target"),
        (("one",), "two/controller, two/target"),
    ],
)
def test_in_lockstep_all_robots_services_are_waited_for_and_named(answers, missing):
    rig = Rig(*TWO)
    for name in answers:
        rig.answer(name=name)
    with pytest.raises(StepTimeoutError, match=f"^{missing} did not answer tick 0"):
        rig.clock.step()
    rig.bus.presence.update("two/controller", alive=False)
    with pytest.raises(StepTimeoutError, match=r"^two/controller did not answer tick 0"):
        rig.clock.step()


def test_a_reset_puts_all_robots_back_with_the_new_seed():
    rig = Rig(*TWO)
    rig.tick()
    rig.ask(keys.SIM_RESET, ResetRequest(seed=8))
    for name, heard in (("one", rig.tick()), ("two", rig.take("two"))):
        last = heard[-1]
        assert last.message.pose.pose.position.x == 0.0
        assert (last.stamp.time_ns, last.stamp.seed) == (0, 8)


def test_time_is_asked_for_in_no_ones_namespace_and_the_robot_in_each():
    rig = Rig(*TWO)
    assert rig.bus.call(keys.SIM_STATE, Empty()).seed == 3
    assert rig.bus.call(call_of_robot(keys.ROBOT_DESCRIPTION, "one"), Empty()).data == "<robot one>"
    with pytest.raises(BusError, match=r"^two/robot_description: shy"):
        rig.bus.call(call_of_robot(keys.ROBOT_DESCRIPTION, "two"), Empty())
    assert list(rig.bus.fetch_files("two/robot_description/*").values()) == [b"two"]


def test_its_health_tells_robots_apart():
    rig = Rig(*TWO)
    rig.bus.put_bytes("one/joint_command", b"{")
    for alive in (False, True):
        rig.bus.presence.update("two/target", alive=alive)
    for _ in range(100):
        rig.tick()
    report = rig.health.take()[-1].message
    said = {value.key: value.value for value in report.status[0].values}
    assert said["hz/one/joint_command"] == said["hz/two/target/odom"] == "100.0"
    assert said["refused/one/joint_command"] == said["restarts/two/target"] == "1"
