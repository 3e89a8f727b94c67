"""Physics as a world: what commands and people do to robots, and the state that comes of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import pytest
from harness import Rig, Sample, assert_sendable, load_robot
from hostile import FORGED, FUZZ, NO_STAMP, puts
from hypothesis import given, settings
from mecazen import keys
from mecazen import messages as m
from mecazen.config import (
    PhysicsConfig,
    RobotConfig,
    Scenario,
    SensorConfig,
    SensorsConfig,
    SimConfig,
    StartConfig,
)
from mecazen.config.sensors import EncodersConfig, ImuConfig
from mecazen.errors import ConfigError, MecazenError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.node import Inputs, Tick
from mecazen.robot import WHEEL_JOINTS, WHEELS, roller_joint
from mecazen.skeleton import JOINTS
from mecazen.urdf import build_meshes
from mecazen.wire import encode
from mecazen_physics.node import PhysicsNode
from mecazen_physics.world import GRAVITY

TICK_NS = 10_000_000
FAST = PhysicsConfig(dt_s=0.002)
WATCHFUL = PhysicsConfig(dt_s=0.002, watchdog_s=0.1)
FAR = Pose2D(x=50.0)
START = StartConfig(x_m=1.0, y_m=2.0, yaw_deg=90.0)


def scenario(config: PhysicsConfig = FAST, **changes: Any) -> Scenario:
    sim = SimConfig(mode="lockstep", answer_timeout_s=1e-3)
    return Scenario(**{"robot": load_robot(), "seed": 3, "sim": sim, "physics": config} | changes)


def joints(velocity: Sequence[float] = (), effort: Sequence[float] = ()) -> m.JointState:
    return m.JointState(name=WHEEL_JOINTS, velocity=tuple(velocity), effort=tuple(effort))


def person(pose: Pose2D = FAR, twist: Twist2D = Twist2D()) -> m.Odometry:  # noqa: B008
    return m.planar_odometry(m.Time(), "world", "person", pose, twist)


class Driven:
    """Robots that get commands and people in every tick, by the names of the robots."""

    def __init__(self, config: PhysicsConfig = FAST, **changes: Any) -> None:
        self.world = PhysicsNode(scenario(config, **changes))
        self.begin()

    def begin(self) -> None:
        self.world.reset(3)
        self.number = 0
        self.used: dict[Any, int] = {}
        """The last tick with a good sample, by topic."""
        self._step(Inputs({}))

    def tick(self, name: str = "", **messages: Any) -> Inputs:
        """Step with a `command` and a `person`, where given; return what was refused."""
        return self.tick_all({name: messages})

    def tick_all(self, messages: Mapping[str, Mapping[str, Any]]) -> Inputs:
        topics = {
            "command": keys.JOINT_COMMAND,
            "person": keys.TARGET_ODOM,
            "people": keys.PEOPLE,
            "skeleton": keys.TARGET_SKELETON,
        }
        samples = {
            keys.of_robot(topics[kind], name): message
            for name, by_kind in messages.items()
            for kind, message in by_kind.items()
        }
        # as in the runtime: since the last tick before this one that had a good sample
        known_ns = {topic: tick * TICK_NS for topic, tick in self.used.items()}
        self.number += 1
        inputs = Inputs(samples, known_ns, self.number * TICK_NS)
        self._step(inputs)
        self.used |= dict.fromkeys(inputs.samples, self.number)
        return inputs

    def _step(self, inputs: Inputs) -> None:
        outputs = self.world.step(Tick(self.number, self.number * TICK_NS, 0.01), inputs)
        self.states = {
            name: {
                topic: outputs[keys.of_robot(topic, name)]
                for topic in keys.TOPICS
                if keys.of_robot(topic, name) in outputs
            }
            for name in self.world.scenario.names
        }

    def drive(self, ticks: int, velocity: Sequence[float] = (), effort: Sequence[float] = ()):
        for _ in range(ticks):
            self.tick(command=joints(velocity, effort))

    def joints(self, name: str = "") -> m.JointState:
        return self.states[name][keys.JOINT_STATES]

    @property
    def wheels(self) -> tuple[float, ...]:
        """The wheels' speeds [rad/s]."""
        return self.joints().velocity[:4]

    def pose(self, name: str = "") -> Pose2D:
        return self.states[name][keys.GROUND_TRUTH].pose.pose.to_planar()


def test_the_state_has_the_wheels_then_every_roller_and_the_true_pose():
    driven = Driven(start=START)
    rollers = [roller_joint(wheel, index) for wheel in WHEELS for index in range(9)]
    state = driven.joints()
    assert state.name == (*WHEEL_JOINTS, *rollers)
    assert len(state.position) == len(state.velocity) == len(state.effort) == 40
    for _ in range(3):
        driven.drive(1, [0.0] * 4)
    truth = driven.states[""][keys.GROUND_TRUTH]
    assert truth.header == msgspec.structs.replace(truth.header, stamp=m.Time(nanosec=3 * TICK_NS))
    assert (truth.header.frame_id, truth.child_frame_id) == ("world", "base_link")
    # it sinks a little onto its rollers
    assert driven.pose() == pytest.approx((1.0, 2.0, math.pi / 2), abs=1e-4)
    driven.drive(20, [5.0] * 4)
    assert driven.wheels == pytest.approx([5.0] * 4, rel=0.01)
    assert any(abs(speed) > 0.1 for speed in driven.joints().velocity[4:])


def test_wheel_speeds_and_efforts_are_taken_by_name_in_any_order():
    driven = Driven()
    names = tuple(reversed(WHEEL_JOINTS))
    command = m.JointState(name=("arm", *names), velocity=(9.0, 4.0, 3.0, 2.0, 1.0))
    for _ in range(10):
        driven.tick(command=command)
    assert driven.wheels == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=0.02)  # the servo's rest
    driven.begin()
    for _ in range(5):
        driven.tick(command=m.JointState(name=names, effort=(0.4, 0.3, 0.2, 0.1)))
    assert driven.joints().effort[:4] == (0.1, 0.2, 0.3, 0.4)
    assert driven.pose().x > 0.0


@pytest.mark.parametrize(
    "command",
    [
        m.JointState(),
        m.JointState(velocity=(1.0, 2.0, 3.0, 4.0)),
        m.JointState(name=WHEEL_JOINTS[:1], velocity=(1.0,)),
        m.JointState(name=WHEEL_JOINTS, velocity=(1.0,) * 3),
        m.JointState(name=WHEEL_JOINTS, position=(1.0,) * 4),
    ],
)
def test_a_command_that_lacks_a_wheel_is_refused_and_the_last_good_one_stays(command):
    driven = Driven()
    driven.drive(20, [2.0] * 4)
    inputs = driven.tick(command=command)
    assert [topic for topic, _ in inputs.refused] == [keys.JOINT_COMMAND]
    assert driven.wheels == pytest.approx([2.0] * 4, abs=0.05)


def test_the_watchdog_brakes_as_the_controller_does_and_the_next_command_moves_the_wheels():
    driven = Driven(WATCHFUL)
    driven.drive(30, [4.0] * 4)
    speeds = []
    for _ in range(30):
        driven.tick(person=person())
        speeds.append(driven.wheels[0])
    # the controller's limit is 2.5 m/s², which are 0.5 rad/s in a tick with a radius of 0.05 m
    braking = [4.0 - 0.5 * n for n in range(1, 9)]
    # the servo holds the commands to within what a roller's bump takes
    assert speeds == pytest.approx([4.0] * 10 + braking + [0.0] * 12, abs=0.1)
    driven.drive(30, [4.0] * 4)
    assert driven.wheels == pytest.approx([4.0] * 4, abs=0.1)


def people(*walkers: m.Person) -> m.People:
    """Everybody: the robot's own person, far away, and walkers."""
    return m.People(persons=(m.Person("target", m.Pose.planar(FAR)), *walkers))


def test_a_walker_stops_the_robot_as_its_person_does():
    driven = Driven()
    walker = m.Person("walker_1", m.Pose.planar(Pose2D(x=0.8)))
    for _ in range(100):
        driven.tick(command=joints([10.0] * 4), person=person(), people=people(walker))
    assert driven.pose().x < 0.45  # 0.2 m of the walker, 0.2 m of the robot


def sample(kind: str, x: float, tick: int, joints: int = len(JOINTS)) -> dict[str, m.Message]:
    """A person at x who walks towards -x at 1 m/s: upright, or with joints above each other."""
    if kind == "pose":
        return {"person": person(Pose2D(x, 0.0, math.pi), Twist2D(x=1.0))}
    body = tuple(m.Point(x=x, z=1.7 * index / len(JOINTS)) for index in range(joints))
    header = m.Header(stamp=m.Time.from_ns(tick * TICK_NS))
    return {"skeleton": m.Skeleton(header=header, height=1.75, joints=body)}


@pytest.mark.parametrize(("kind", "radius"), [("pose", 0.2), ("fused", 0.03)])
def test_a_person_without_good_samples_stands_where_they_have_come_to(kind, radius):
    driven = Driven(WATCHFUL, sensor=SensorConfig(kind=kind))
    for tick in range(2):
        assert not driven.tick(**sample(kind, 0.92 - 0.01 * tick, tick)).refused
    for tick in range(2, 40):  # a skeleton that lacks a joint is refused
        bad = {} if kind == "pose" else sample(kind, 0.9, tick, joints=19)
        assert len(driven.tick(command=joints([0.0] * 4), **bad).refused) == len(bad)
    assert driven.pose().x == pytest.approx(0.0, abs=1e-3)
    driven.drive(120, [10.0] * 4)
    # after 0.11 s without a sample; the base's front is at 0.19 m, that of the rims at 0.2 m
    assert driven.pose().x == pytest.approx(0.91 - 0.11 - radius - 0.195, abs=0.02)


@pytest.mark.parametrize("kind", ["pose", "fused"])
@pytest.mark.parametrize("stop", [True, False])
def test_a_walker_who_leaves_pushes_nobody(kind, stop):
    driven = Driven(WATCHFUL, sensor=SensorConfig(kind=kind))
    for tick in range(10):  # at 1 m/s towards the robot, whose front is at 0.2 m
        x = 0.8 - 0.01 * tick
        body = tuple(m.Point(x=x, z=1.7 * index / len(JOINTS)) for index in range(len(JOINTS)))
        pose, twist = m.Pose.planar(Pose2D(x, 0.0, math.pi)), m.Twist.planar(Twist2D(x=1.0))
        walker = m.Person("walker_1", pose, twist, 1.75, body)
        header = m.Header(stamp=m.Time.from_ns(tick * TICK_NS))
        assert not driven.tick(people=m.People(header, (walker,))).refused
    driven.drive(20 if stop else 2, [0.0] * 4)  # they stand after 0.1 s without a sample
    driven.tick(people=m.People())
    driven.drive(100)
    assert driven.pose() == pytest.approx(Pose2D(), abs=1e-3)
    driven.drive(300, [10.0] * 4)  # at 0.5 m/s through the place where they stood
    assert driven.pose().x > 1.0


def test_an_absurdly_fast_person_does_no_harm():
    driven = Driven()
    driven.tick()  # no person starts inside the robot
    for _ in range(20):
        driven.tick(person=person(Pose2D(), Twist2D(1.797e308, 1.797e308)))
    for topic, message in driven.states[""].items():
        assert_sendable(Sample(topic.key, message, None))


def test_a_start_inside_the_person_is_refused_and_one_beside_them_is_not():
    # the robot's front is at 0.2 m, the person's radius 0.2 m
    Driven().tick(person=person(Pose2D(x=0.45)))
    with pytest.raises(ConfigError, match=r"inside the person, who is at \[0.35, 0\]"):
        Driven().tick(person=person(Pose2D(x=0.35)))


def test_robots_are_moved_each_by_its_own_commands_and_stopped_by_its_own_watchdog():
    robots = (RobotConfig(name="one"), RobotConfig(name="two", start=StartConfig(y_m=2.0)))
    driven = Driven(robots=robots)
    assert driven.pose("two").y == 2.0
    for tick in range(250):
        told = {"one": {"command": joints([5.0] * 4)}, "two": {"command": joints([5.0] * 4)}}
        driven.tick_all(told if tick < 30 else {"one": told["one"]})
    one, two = (
        driven.states[name][keys.GROUND_TRUTH].twist.twist.linear.x for name in ("one", "two")
    )
    # nexus at 5 rad/s; 2.2 s after the last word: the watchdog and the time to slow down
    assert one == pytest.approx(0.25, rel=0.05)
    assert two == pytest.approx(0.0, abs=0.01)
    assert driven.pose("one").x > driven.pose("two").x > 0.02
    assert set(driven.world.diagnostics()) == {"one/x_m", "one/y_m", "two/x_m", "two/y_m"}


def weave(driven: Driven) -> bytes:
    """Drive about, touch the person, and return all states."""
    said = []
    for tick in range(60):
        command = joints([4.0, 3.0, math.sin(0.3 * tick), 2.0])
        walking = person(Pose2D(0.5 - 0.004 * tick, 0.05), Twist2D(x=-0.4))
        driven.tick(command=command, person=walking)
        said += [encode(message) for message in driven.states[""].values()]
    return b"".join(said)


def test_a_reset_is_as_good_as_a_fresh_start_to_the_last_bit():
    driven = Driven()
    expected = weave(driven)
    driven.drive(30, [10.0, -10.0, 5.0, 2.0])
    driven.begin()
    assert driven.pose() == Pose2D()
    assert weave(driven) == expected == weave(Driven())


def test_the_robot_description_is_a_urdf_and_its_meshes_are_served():
    driven = Driven(start=START)
    root = ET.fromstring(driven.world.answer(keys.ROBOT_DESCRIPTION, m.Empty()).data)  # noqa: S314
    assert (root.tag, root.get("name")) == ("robot", "nexus")
    assert {j.get("name") for j in root.findall("joint")} >= set(driven.joints().name)
    files = driven.world.files()["robot_description"]
    assert {mesh.get("filename") for mesh in root.iter("mesh")} == set(files)
    assert files == build_meshes(load_robot())
    assert driven.world.diagnostics() == {"x_m": 1.0, "y_m": 2.0}


def test_a_diverged_state_is_one_clear_error():
    wheels = msgspec.structs.replace(load_robot().wheels, max_torque_nm=1e9)
    driven = Driven(robot=msgspec.structs.replace(load_robot(), wheels=wheels))
    driven.drive(1, [0.0] * 4)
    with pytest.raises(
        MecazenError, match=r"^physics diverged .* last good state at 0.0"
    ) as caught:
        driven.drive(10, effort=[1e9] * 4)
    assert "\n" not in str(caught.value)


GOOD = {
    "joint_command": [joints([1.0, 2.0, 3.0, 4.0]), joints(effort=[0.1, 0.2, 0.3, 0.4])],
    "target/odom": [
        person(Pose2D(1.0, 2.0, 0.5), Twist2D(0.1)),
        person(Pose2D(0.2, 0.0, 0.5), Twist2D(0.1)),
    ],
}


@pytest.fixture(scope="module")
def long_lived() -> Rig:
    rig = Rig("physics", scenario(), keys.CLOCK, keys.JOINT_STATES, keys.GROUND_TRUTH)
    rig.driver.begin()
    rig.take()
    return rig


def assert_goes_on(rig: Rig) -> None:
    tick = rig.driver.tick
    rig.put(keys.JOINT_COMMAND, joints([0.0] * 4), rig.driver.stamp)
    rig.put(keys.TARGET_ODOM, person(), rig.driver.stamp)
    rig.driver.step()
    heard = rig.take()
    assert (rig.driver.tick, len(heard)) == (tick + 1, 3)
    for sample in heard:
        assert_sendable(sample)


@settings(FUZZ, max_examples=80)
@given(wrong=puts(GOOD, FORGED | NO_STAMP))
def test_whatever_comes_on_its_keys_time_goes_on_in_finite_numbers(long_lived, wrong):
    for put in wrong:
        long_lived.bus.put_bytes(*put)
    assert_goes_on(long_lived)


def joints_at(x: float) -> tuple[m.Point, ...]:
    """Joints 0.3 m above the ground: of the legs 0.4 m aside, to the left and to the right."""
    apart = {"left": 0.4, "right": -0.4}
    return tuple(m.Point(x=x, y=apart.get(j.partition("_")[0], 0.0), z=0.3) for j in JOINTS)


def test_a_person_and_a_walker_with_joints_are_touched_by_their_legs():
    driven = Driven(sensor=SensorConfig(kind="fused"))
    for number in range(100):  # they walk over the robot at 1 m/s, a leg on each of its sides
        header = m.Header(stamp=m.Time.from_ns(number * TICK_NS), frame_id="world")
        here = joints_at(0.5 - 0.01 * number)
        skeleton = m.Skeleton(header=header, height=1.75, joints=here)
        walker = m.Person("walker_1", height=1.75, joints=here)
        refused = driven.tick(skeleton=skeleton, people=m.People(header, (walker,))).refused
        assert not refused
    assert driven.pose() == pytest.approx(Pose2D(), abs=1e-4)
    alone = m.People(persons=(m.Person("walker_1"),))
    refused = driven.tick(skeleton=m.Skeleton(), people=alone).refused
    assert {topic for topic, _ in refused} == {keys.TARGET_SKELETON, keys.PEOPLE}
    assert {reason for _, reason in refused} == {"needs 20 joints"}


@pytest.mark.parametrize("how", ["upright", "with legs"])
def test_a_person_who_jumps_shoves_no_robot_and_is_refused(how):
    def at(x):
        if how == "upright":
            return {"person": person(Pose2D(x=x))}
        body = tuple(m.Point(x=x, z=1.7 * index / len(JOINTS)) for index in range(len(JOINTS)))
        return {"skeleton": m.Skeleton(joints=body)}

    driven = Driven(**({} if how == "upright" else {"sensor": SensorConfig(kind="fused")}))
    driven.tick(**at(3.0))
    before = driven.pose()
    for x in (0.1, 0.1, 0.1, 2.69):  # 10 m/s take one as far as the last in the 40 ms
        assert len(driven.tick(**at(x)).refused) == (x < 1.0)
    assert math.hypot(driven.pose().x - before.x, driven.pose().y - before.y) < 1e-3


def test_imu_and_battery_are_given_at_their_rates_and_only_where_asked_for():
    assert set(Driven().states[""]) == {keys.JOINT_STATES, keys.GROUND_TRUTH}
    driven = Driven(sensor=SensorConfig(also=("imu", "battery")))
    given = []
    for _ in range(11):
        given.append(set(driven.states[""]) & {keys.IMU, keys.BATTERY_STATE})
        driven.drive(1, [0.0] * 4)
    assert given == [
        {keys.IMU, keys.BATTERY_STATE},
        *[{keys.IMU}] * 9,
        {keys.IMU, keys.BATTERY_STATE},
    ]
    assert "skeleton" not in driven.world.scenario.features  # neither looks at a person


def test_a_robot_on_round_wheels_measures_gravity_alone():
    # the wheels' hulls have edges, and DART's velocity is that of an edge: up to v √(2 D/R), with
    # contacts of the depth D = 10 µm; at 1 m/s it is 20 mm/s, or 2 m/s² from tick to tick
    exact = {name: 0.0 for name in ImuConfig.__struct_fields__ if name != "rate_hz"}
    sensors = SensorsConfig(imu=ImuConfig(**exact))
    driven = Driven(sensor=SensorConfig(also=("imu",)), sensors=sensors)
    for tick in range(100):
        driven.drive(1, [min(0.4 * tick, 20.0)] * 4)
        imu = driven.states[""][keys.IMU]
        assert imu.linear_acceleration.z == pytest.approx(GRAVITY, abs=1e-9)
        assert (imu.angular_velocity.x, imu.angular_velocity.y) == (0.0, 0.0)
    assert driven.pose().x > 0.7


def test_a_rate_of_an_instrument_that_divides_no_tick_rate_is_refused():
    sensors = SensorsConfig(imu=ImuConfig(rate_hz=30.0))
    with pytest.raises(ConfigError, match=r"sensors\.imu\.rate_hz = 30"):
        Driven(sensor=SensorConfig(also=("imu",)), sensors=sensors)


def test_encoders_quantise_the_wheels_and_leave_the_rollers_exact():
    exact, counted = (
        Driven(),
        Driven(sensors=SensorsConfig(encoders=EncodersConfig(counts_per_turn=500))),
    )
    for driven in (exact, counted):
        driven.drive(20, [3.0] * 4)
    step = 2.0 * math.pi / 500
    for true, read in zip(exact.joints().position[:4], counted.joints().position[:4], strict=True):
        assert read / step == pytest.approx(round(read / step), abs=1e-9)
        assert 0.0 <= true - read < step
    assert exact.joints().position[4:] == counted.joints().position[4:]
    assert counted.wheels[0] == pytest.approx(3.0, abs=step / 0.01)
