"""The physics node: commands and people in, the state of the robots out."""

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import pytest
from harness import Rig, Steps, assert_sendable, load_robot
from hostile import forged
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
    WorldConfig,
)
from mecazen.config.people import Passerby, Standing
from mecazen.config.sensors import EncodersConfig
from mecazen.config.world import Box
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS, WHEELS, roller_joint
from mecazen.skeleton import JOINTS
from mecazen.urdf import build_meshes
from mecazen.wire import encode
from mecazen_physics.node import PhysicsNode
from mecazen_physics.world import UnsupportedError
from physics_rig import simulation_of

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


class Driven(Steps):
    """Robots that get commands and people in every tick; `outputs` are those of the newest."""

    def __init__(self, config: PhysicsConfig = FAST, **changes: Any) -> None:
        super().__init__(PhysicsNode, scenario(config, **changes))

    def reset(self, seed: int = 3) -> None:
        super().reset(seed)
        self.number = -1
        self.tick({})

    def tick(self, samples: Mapping[Any, m.Message]) -> list[tuple[Any, str]]:
        """Step; return the topics of the samples that were refused, with the reasons."""
        self.number += 1
        self.outputs = self.step(self.number, samples)
        return self.inputs.refused

    def drive(self, ticks: int, velocity: Sequence[float] = (), effort: Sequence[float] = ()):
        for _ in range(ticks):
            self.tick({keys.JOINT_COMMAND: joints(velocity, effort)})

    @property
    def joints(self) -> m.JointState:
        return self.outputs[keys.JOINT_STATES]

    @property
    def wheels(self) -> tuple[float, ...]:
        """The wheels' speeds [rad/s]."""
        return self.joints.velocity[:4]

    @property
    def pose(self) -> Pose2D:
        return self.outputs[keys.GROUND_TRUTH].pose.pose.to_planar()


def test_state_has_wheels_rollers_and_true_pose():
    driven = Driven(start=START)
    rollers = [roller_joint(wheel, index) for wheel in WHEELS for index in range(9)]
    state = driven.joints
    assert state.name == (*WHEEL_JOINTS, *rollers)
    assert len(state.position) == len(state.velocity) == len(state.effort) == 40
    driven.drive(3, [0.0] * 4)
    truth = driven.outputs[keys.GROUND_TRUTH]
    assert truth.header == msgspec.structs.replace(truth.header, stamp=m.Time(nanosec=3 * TICK_NS))
    assert (truth.header.frame_id, truth.child_frame_id) == ("world", "base_link")
    # it sinks a little onto its rollers
    assert driven.pose == pytest.approx((1.0, 2.0, math.pi / 2), abs=1e-4)
    driven.drive(20, [5.0] * 4)
    assert driven.wheels == pytest.approx([5.0] * 4, rel=0.01)
    assert any(abs(speed) > 0.1 for speed in driven.joints.velocity[4:])


def test_commands_are_assigned_by_joint_name():
    driven = Driven()
    names = tuple(reversed(WHEEL_JOINTS))
    command = m.JointState(name=("arm", *names), velocity=(9.0, 4.0, 3.0, 2.0, 1.0))
    for _ in range(10):
        driven.tick({keys.JOINT_COMMAND: command})
    assert driven.wheels == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=0.02)  # the servo's rest
    driven.reset()
    command = m.JointState(name=names, effort=(0.4, 0.3, 0.2, 0.1))
    for _ in range(5):
        driven.tick({keys.JOINT_COMMAND: command})
    assert driven.joints.effort[:4] == (0.1, 0.2, 0.3, 0.4)
    assert driven.pose.x > 0.0


def test_incomplete_command_is_refused():
    driven = Driven()
    driven.drive(20, [2.0] * 4)
    for command in (
        m.JointState(velocity=(1.0, 2.0, 3.0, 4.0)),
        m.JointState(name=WHEEL_JOINTS, velocity=(1.0,) * 3),
        m.JointState(name=WHEEL_JOINTS, position=(1.0,) * 4),
    ):
        refused = driven.tick({keys.JOINT_COMMAND: command})
        assert [topic for topic, _ in refused] == [keys.JOINT_COMMAND]
        assert driven.wheels == pytest.approx([2.0] * 4, abs=0.05)


def test_watchdog_brakes_until_the_next_command():
    driven = Driven(WATCHFUL)
    driven.drive(30, [4.0] * 4)
    speeds = []
    for _ in range(30):
        driven.tick({keys.TARGET_ODOM: person()})
        speeds.append(driven.wheels[0])
    # the controller's limit is 2.5 m/s², which are 0.5 rad/s in a tick with a radius of 0.05 m
    braking = [4.0 - 0.5 * n for n in range(1, 9)]
    # the servo holds the commands to within what a roller's bump takes
    assert speeds == pytest.approx([4.0] * 10 + braking + [0.0] * 12, abs=0.1)
    driven.drive(30, [4.0] * 4)
    assert driven.wheels == pytest.approx([4.0] * 4, abs=0.1)


def sample(kind: str, x: float, tick: int, joints: int = len(JOINTS)) -> dict[Any, m.Message]:
    """A person at x who walks towards -x at 1 m/s: upright, or with joints above each other."""
    if kind == "pose":
        return {keys.TARGET_ODOM: person(Pose2D(x, 0.0, math.pi), Twist2D(x=1.0))}
    body = tuple(m.Point(x=x, z=1.7 * index / len(JOINTS)) for index in range(joints))
    header = m.Header(stamp=m.Time.from_ns(tick * TICK_NS))
    return {keys.TARGET_SKELETON: m.Skeleton(header=header, height=1.75, joints=body)}


@pytest.mark.parametrize(("kind", "radius"), [("pose", 0.2), ("fused", 0.03)])
def test_person_without_samples_stands_still(kind, radius):
    driven = Driven(WATCHFUL, sensor=SensorConfig(kind=kind))
    for tick in range(2):
        assert not driven.tick(sample(kind, 0.92 - 0.01 * tick, tick))
    for tick in range(2, 40):  # a skeleton that lacks a joint is refused
        bad = {} if kind == "pose" else sample(kind, 0.9, tick, joints=19)
        assert len(driven.tick({keys.JOINT_COMMAND: joints([0.0] * 4)} | bad)) == len(bad)
    assert driven.pose.x == pytest.approx(0.0, abs=1e-3)
    driven.drive(120, [10.0] * 4)
    # after 0.11 s without a sample; the base's front is at 0.19 m, that of the rims at 0.2 m
    assert driven.pose.x == pytest.approx(0.91 - 0.11 - radius - 0.195, abs=0.02)


@pytest.mark.parametrize(("kind", "ticks"), [("pose", 20), ("fused", 2)])
def test_a_walker_who_leaves_pushes_nobody(kind, ticks):
    driven = Driven(WATCHFUL, sensor=SensorConfig(kind=kind))
    for tick in range(10):  # at 1 m/s towards the robot, whose front is at 0.2 m
        x = 0.8 - 0.01 * tick
        body = tuple(m.Point(x=x, z=1.7 * index / len(JOINTS)) for index in range(len(JOINTS)))
        pose, twist = m.Pose.planar(Pose2D(x, 0.0, math.pi)), m.Twist.planar(Twist2D(x=1.0))
        walker = m.Person("walker_1", pose, twist, 1.75, body)
        header = m.Header(stamp=m.Time.from_ns(tick * TICK_NS))
        assert not driven.tick({keys.PEOPLE: m.People(header, (walker,))})
    driven.drive(ticks, [0.0] * 4)  # they stand after 0.1 s without a sample
    driven.tick({keys.PEOPLE: m.People()})
    driven.drive(50)
    assert driven.pose == pytest.approx(Pose2D(), abs=1e-3)
    driven.drive(100, [20.0] * 4)  # at 1 m/s through the place where they stood
    assert driven.pose.x > 0.9


def added(driven: Driven, **things: Box | Passerby) -> Scenario:
    """Return the scenario with things in its world, once they have been checked."""
    world = msgspec.structs.replace(driven.node.scenario.world, added=things)
    changed = msgspec.structs.replace(driven.node.scenario, world=world)
    driven.node.check_world(changed)
    return changed


def box(x: float, height: float = 0.5, bottom: float = 0.0) -> Box:
    return Box(size_m=(0.4, 0.4, height), position_m=(x, 0.0), bottom_m=bottom)


def test_added_box_stops_the_robot_until_removal():
    driven = Driven()
    driven.drive(20, [5.0] * 4)
    for _ in range(2):  # the second time where the first box was
        begin = driven.pose.x
        driven.node.configure(added(driven, crate=box(begin + 0.5), shelf=box(begin, bottom=1.0)))
        driven.drive(120, [10.0] * 4)
        # its front is 0.2 m ahead of the robot's middle, and the box's face 0.3 m
        assert driven.pose.x - begin == pytest.approx(0.1, abs=0.01)
        driven.node.configure(added(driven))
        driven.drive(60, [10.0] * 4)
        assert driven.pose.x - begin > 0.2


NEXUS = load_robot()
SLIPPERY = msgspec.structs.replace(NEXUS.rollers, contact_friction=0.5)
OTHER = msgspec.structs.replace(NEXUS, rollers=SLIPPERY)


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda: added(Driven(), crate=box(0.3)), "crate: would be inside the robot, which is at"),
        (
            lambda: added(Driven(), crate=box(9.0, height=0.04)),
            "an obstacle 0.04 m high is lower than the wheels' axles",
        ),
        (
            lambda: added(Driven(), crate=Passerby(Standing(x_m=0.3))),
            "crate: would be inside the robot",
        ),
        (
            lambda: simulation_of([(NEXUS, Pose2D()), (OTHER, Pose2D(2.0))]),
            r"same rollers\.contact_friction",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(refused, words):
    with pytest.raises((ConfigError, UnsupportedError), match=words):
        refused()


def test_a_robot_may_start_below_a_shelf():
    world = WorldConfig(obstacles=(box(-0.3, bottom=0.8),))
    assert Driven(world=world).pose == Pose2D()


def test_each_robot_has_its_commands_and_watchdog():
    robots = (RobotConfig(name="fast"), RobotConfig(name="slow", start=StartConfig(y_m=2.0)))
    driven, topic = Driven(WATCHFUL, robots=robots), keys.JOINT_COMMAND
    for tick in range(60):
        names = ("fast", "slow") if tick < 30 else ("fast",)
        driven.tick({keys.of_robot(topic, name): joints([5.0] * 4) for name in names})
    fast, slow = (driven.outputs[keys.of_robot(keys.GROUND_TRUTH, r.name)] for r in robots)
    # nexus at 5 rad/s; 0.3 s after the last command: the watchdog and the time to slow down
    assert fast.twist.twist.linear.x == pytest.approx(0.25, rel=0.05)
    assert slow.twist.twist.linear.x == pytest.approx(0.0, abs=0.01)
    assert slow.pose.pose.position.y == pytest.approx(2.0, abs=0.01)
    assert set(driven.node.diagnostics()) == {"fast/x_m", "fast/y_m", "slow/x_m", "slow/y_m"}


def weave(driven: Driven) -> bytes:
    """Drive about, touch the person, and return all states."""
    states = []
    for tick in range(25):
        command = joints([4.0, 3.0, math.sin(0.3 * tick), 2.0])
        walking = person(Pose2D(0.45 - 0.004 * tick, 0.05), Twist2D(x=-0.4))
        driven.tick({keys.JOINT_COMMAND: command, keys.TARGET_ODOM: walking})
        states += [encode(message) for message in driven.outputs.values()]
    return b"".join(states)


def test_reset_equals_a_fresh_start_bit_for_bit():
    driven = Driven()
    expected = weave(driven)
    driven.drive(10, [10.0, -10.0, 5.0, 2.0])
    driven.reset()
    assert driven.pose == Pose2D()
    assert weave(driven) == expected == weave(Driven())


def test_robot_description_and_meshes_are_served():
    driven = Driven(start=START)
    root = ET.fromstring(driven.node.answer(keys.ROBOT_DESCRIPTION, m.Empty()).data)  # noqa: S314
    assert (root.tag, root.get("name")) == ("robot", "nexus")
    assert {j.get("name") for j in root.findall("joint")} >= set(driven.joints.name)
    files = driven.node.files()["robot_description"]
    assert {mesh.get("filename") for mesh in root.iter("mesh")} == set(files)
    assert files == build_meshes(load_robot())
    assert driven.node.diagnostics() == {"x_m": 1.0, "y_m": 2.0}


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


@forged(GOOD)
def test_physics_survives_hostile_samples(long_lived, wrong):
    rig, tick = long_lived, long_lived.driver.tick
    for put in wrong:
        rig.bus.put_bytes(*put)
    rig.put(keys.JOINT_COMMAND, joints([0.0] * 4), rig.driver.stamp)
    rig.put(keys.TARGET_ODOM, person(), rig.driver.stamp)
    rig.driver.step()
    samples = rig.take()
    assert (rig.driver.tick, len(samples)) == (tick + 1, 3)
    for sample in samples:
        assert_sendable(sample)


def joints_at(x: float) -> tuple[m.Point, ...]:
    """Joints 0.3 m above the ground: of the legs 0.4 m aside, to the left and to the right."""
    apart = {"left": 0.4, "right": -0.4}
    return tuple(m.Point(x=x, y=apart.get(j.partition("_")[0], 0.0), z=0.3) for j in JOINTS)


def test_persons_with_joints_have_contact_at_legs():
    driven = Driven(sensor=SensorConfig(kind="fused"))
    for number in range(100):  # they walk over the robot at 1 m/s, a leg on each of its sides
        header = m.Header(stamp=m.Time.from_ns(number * TICK_NS), frame_id="world")
        body = joints_at(0.5 - 0.01 * number)
        skeleton = m.Skeleton(header=header, height=1.75, joints=body)
        walker = m.Person("walker_1", height=1.75, joints=body)
        people = m.People(header, (walker,))
        assert not driven.tick({keys.TARGET_SKELETON: skeleton, keys.PEOPLE: people})
    assert driven.pose == pytest.approx(Pose2D(), abs=1e-4)
    alone = m.People(persons=(m.Person("walker_1"),))
    refused = driven.tick({keys.TARGET_SKELETON: m.Skeleton(), keys.PEOPLE: alone})
    assert {topic for topic, _ in refused} == {keys.TARGET_SKELETON, keys.PEOPLE}
    assert {reason for _, reason in refused} == {"needs 20 joints"}


@pytest.mark.parametrize("kind", ["pose", "fused"])
def test_jump_of_a_person_is_refused(kind):
    driven = Driven(sensor=SensorConfig(kind=kind))
    driven.tick(sample(kind, 3.0, 0))
    for tick, x in enumerate((0.1, 0.1, 2.45)):
        # 20 m/s take a person as far as the last within the 30 ms
        assert len(driven.tick(sample(kind, x, tick))) == (x < 1.0)
    assert driven.pose == pytest.approx(Pose2D(), abs=1e-3)


def test_imu_and_battery_are_published_at_their_rates():
    assert set(Driven().outputs) == {keys.JOINT_STATES, keys.GROUND_TRUTH}
    driven = Driven(sensor=SensorConfig(also=("imu", "battery")))
    both, measured = {keys.IMU, keys.BATTERY_STATE}, []
    for _ in range(11):
        measured.append(set(driven.outputs) & both)
        driven.drive(1, [0.0] * 4)
    assert measured == [both, *[{keys.IMU}] * 9, both]


def test_encoders_quantise_wheels_but_not_rollers():
    exact, counted = (
        Driven(),
        Driven(sensors=SensorsConfig(encoders=EncodersConfig(counts_per_turn=500))),
    )
    for driven in (exact, counted):
        driven.drive(20, [3.0] * 4)
    step = 2.0 * math.pi / 500
    for true, read in zip(exact.joints.position[:4], counted.joints.position[:4], strict=True):
        assert read / step == pytest.approx(round(read / step), abs=1e-9)
        assert 0.0 <= true - read < step
    assert exact.joints.position[4:] == counted.joints.position[4:]
    assert counted.wheels[0] == pytest.approx(3.0, abs=step / 0.01)
