"""Physics of several robots on the bus: each speaks and is answered in its own namespace."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from harness import Listener, load_robot
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import RobotConfig, Scenario, SimConfig, StartConfig, seed_of
from mecazen.errors import StepTimeoutError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import Empty, JointState, ResetRequest, Time, planar_odometry
from mecazen.robot import WHEEL_JOINTS
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.service import PhysicsService

TICK_NS = 10_000_000
NAMES = ("one", "two")
STATES = (keys.CLOCK, keys.JOINT_STATES, keys.GROUND_TRUTH)


class Rig:
    """Physics of two robots, and what answers it."""

    def __init__(self, **sim: Any) -> None:
        sim.setdefault("mode", "lockstep")
        sim.setdefault("answer_timeout_s", 1e-3)
        self.bus = LocalBus()
        self.service = PhysicsService(
            self.bus,
            Scenario(
                robot=load_robot(),
                services=("physics", "controller", "target"),
                seed=3,
                sim=SimConfig(**sim),
                robots=(
                    RobotConfig(name="one"),
                    RobotConfig(name="two", start=StartConfig(y_m=2.0)),
                ),
                sections={"physics": PhysicsConfig(roller_spheres=3, dt_s=0.002)},
            ),
        )
        self.buses = {name: self.bus.namespaced(name) for name in NAMES}
        for bus in self.buses.values():
            for part in ("physics", "controller", "target"):
                bus.declare_alive(part)
        self.heard = {name: Listener(bus, *STATES) for name, bus in self.buses.items()}
        self.shared = Listener(self.bus, keys.CLOCK, keys.diagnostics("physics"))

    def command(self, name: str, speed: float) -> None:
        """Answer the tick for a robot's controller."""
        joints = JointState(name=WHEEL_JOINTS, velocity=(speed,) * 4)
        self.buses[name].publisher(keys.JOINT_COMMAND).put(joints, self.service.stamp)

    def place(self, name: str) -> None:
        """Answer the tick for a robot's target."""
        person = planar_odometry(Time(), "world", "person", Pose2D(x=50.0), Twist2D())
        self.buses[name].publisher(keys.TARGET_ODOM).put(person, self.service.stamp)

    def tick(self, **speeds: float) -> None:
        for name, speed in speeds.items():
            self.command(name, speed)
            self.place(name)
        self.service.step()
        self.bus.spin()


def test_each_robot_is_told_of_in_its_namespace_with_a_seed_of_its_own() -> None:
    rig = Rig()
    rig.service.begin()
    rig.bus.spin()
    run = rig.service.stamp.run
    for name, y in (("one", 0.0), ("two", 2.0)):
        heard = rig.heard[name].take()
        assert [sample.key for sample in heard] == [topic.key for topic in STATES]
        assert {sample.stamp for sample in heard} == {(0, run, seed_of(3, name))}
        assert heard[2].message.pose.pose.position.y == y
    clock, report = rig.shared.take()
    assert clock.stamp == (0, run, 3)
    assert report.key == "diagnostics/physics"


def test_a_command_moves_the_robot_in_whose_namespace_it_is() -> None:
    rig = Rig()
    rig.service.begin()
    for _ in range(30):
        rig.tick(one=5.0, two=0.0)
    one, two = (rig.heard[name].take()[-1].message.pose.pose.position.x for name in NAMES)
    assert one > 0.02
    assert two == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("answers", "missing"),
    [
        ((), "one/controller, one/target, two/controller, two/target"),
        (("one",), "two/controller, two/target"),
        (("two",), "one/controller, one/target"),
    ],
)
def test_in_lockstep_all_robots_services_are_waited_for_and_named(
    answers: tuple[str, ...], missing: str
) -> None:
    rig = Rig()
    rig.service.begin()
    for name in answers:
        rig.command(name, 0.0)
        rig.place(name)
    with pytest.raises(StepTimeoutError, match=f"^{missing} did not answer tick 0"):
        rig.service.step()


def test_a_robots_service_that_has_gone_is_named_before_the_time_out() -> None:
    rig = Rig(answer_timeout_s=1e6)
    rig.service.begin()
    rig.buses["two"].presence.update("controller", alive=False)
    with pytest.raises(StepTimeoutError, match=r"^two/controller did not answer tick 0"):
        rig.service.step()


def test_a_reset_puts_all_robots_back_with_seeds_from_the_new_one() -> None:
    rig = Rig()
    rig.service.begin()
    for _ in range(20):
        rig.tick(one=5.0, two=5.0)
    rig.service.on_reset(ResetRequest(seed=8), _Reply())
    rig.tick(one=0.0, two=0.0)
    for name in NAMES:
        last = rig.heard[name].take()[-1]
        assert last.message.pose.pose.position.x == 0.0
        assert (last.stamp.time_ns, last.stamp.seed) == (0, seed_of(8, name))


class _Reply:
    def answer(self, message: Any) -> None:
        assert message.tick == 0

    def refuse(self, reason: str) -> None:
        raise AssertionError(reason)


def test_time_is_asked_for_in_no_ones_namespace_and_the_robot_in_each() -> None:
    rig = Rig()
    assert rig.bus.call(keys.SIM_STATE, Empty()).seed == 3
    tables = tomllib.loads(rig.bus.call(keys.SIM_SCENARIO, Empty()).data)
    assert [robot["name"] for robot in tables["robots"]] == list(NAMES)
    for bus in rig.buses.values():
        assert "<robot" in bus.call(keys.ROBOT_DESCRIPTION, Empty()).data


def test_its_health_tells_robots_apart() -> None:
    rig = Rig()
    rig.service.begin()
    rig.buses["one"].put_bytes("joint_command", b"{")
    rig.buses["two"].presence.update("target", alive=False)
    rig.buses["two"].presence.update("target", alive=True)
    rig.bus.spin()
    rig.shared.take()
    for _ in range(100):
        rig.tick(one=0.0, two=0.0)
    (report,) = (s.message for s in rig.shared.take() if s.key == "diagnostics/physics")
    said = {pair.key: pair.value for pair in report.status[0].values}
    assert said["hz/one/joint_command"] == said["hz/two/target/odom"] == "100.0"
    assert said["refused/one/joint_command"] == "1"
    assert said["restarts/two/target"] == "1"


def test_the_wheels_of_a_robot_whose_controller_is_silent_stop_while_the_other_drives() -> None:
    rig = Rig(mode="real_time", speed=1000.0)
    rig.service.begin()
    for tick in range(250):
        rig.command("one", 5.0)
        if tick < 30:
            rig.command("two", 5.0)
        rig.service.step()
        rig.bus.spin()
    one, two = (rig.heard[name].take()[-1].message.twist.twist.linear.x for name in NAMES)
    # nexus at 5 rad/s; 1.5 s after the last word: the watchdog and the time to slow down
    assert one == pytest.approx(0.25, rel=0.05)
    assert two == pytest.approx(0.0, abs=0.01)
