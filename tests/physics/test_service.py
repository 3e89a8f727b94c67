"""Physics on the bus: ticks, answers, commands, and what holds, steps and resets time."""

from __future__ import annotations

import math
import struct
import tomllib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from harness import (
    FORGED,
    FUZZ,
    NO_STAMP,
    Answer,
    Listener,
    Put,
    Sample,
    assert_sendable,
    load_robot,
    put_all,
    puts,
)
from hypothesis import given, settings
from mecazen import keys
from mecazen.bus import LocalBus, StoppedError
from mecazen.config import Scenario, SimConfig, StartConfig
from mecazen.errors import BusError, ConfigError, MecazenError, StepTimeoutError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import from_tables, to_toml
from mecazen.messages import (
    Clock,
    Empty,
    JointState,
    ResetRequest,
    SpeedRequest,
    StepRequest,
    Time,
    Twist,
    planar_odometry,
)
from mecazen.robot import WHEEL_JOINTS, WHEELS, roller_joint
from mecazen.wire import Stamp, encode
from mecazen.world import WorldConfig
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.schedule import Schedule
from mecazen_physics.service import PhysicsService

TICK_NS = 10_000_000
NEXUS = load_robot()
ALL = ("physics", "controller", "target", "follower")
ALONE = ("physics",)
FAST = PhysicsConfig(roller_spheres=3, dt_s=0.002)
"""Coarse: what these tests are about does not depend on the rollers' exact shape."""


class FakeTime:
    """A wall clock that goes on by itself, a little with each look at it."""

    def __init__(self, step_s: float = 1e-4) -> None:
        self.now, self.step_s = 100.0, step_s

    def monotonic(self) -> float:
        self.now += self.step_s
        return self.now


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    """A wall clock for the schedule; it waits no real time."""
    wall = FakeTime()
    monkeypatch.setattr("mecazen_physics.schedule.time", SimpleNamespace(monotonic=wall.monotonic))
    return wall


class Rig:
    """Physics, and the controller and the target that answer it."""

    def __init__(
        self,
        config: PhysicsConfig = FAST,
        *,
        services: Sequence[str] = ALL,
        start: StartConfig | None = None,
        world: WorldConfig = WorldConfig(),  # noqa: B008
        **sim: Any,
    ) -> None:
        sim.setdefault("mode", "lockstep")
        sim.setdefault("answer_timeout_s", 1e-3)
        self.bus = LocalBus()
        self.service = PhysicsService(
            self.bus,
            Scenario(
                robot=NEXUS,
                services=tuple(services),
                seed=3,
                sim=SimConfig(**sim),
                start=start or StartConfig(),
                world=world,
                sections={"physics": config},
            ),
        )
        self.member = self.service.members[0]
        for name in services:
            self.bus.declare_alive(name)
        self.joint_command = self.bus.publisher(keys.JOINT_COMMAND)
        self.person = self.bus.publisher(keys.TARGET_ODOM)
        self.heard = Listener(
            self.bus,
            keys.CLOCK,
            keys.JOINT_STATES,
            keys.GROUND_TRUTH,
            keys.diagnostics("physics"),
        )

    def begin(self) -> list[Sample]:
        self.service.begin()
        return self.listen()

    def listen(self) -> list[Sample]:
        self.bus.spin()
        return self.heard.take()

    def command(self, velocity: Sequence[float]) -> None:
        """Answer the tick for the controller."""
        self.joint_command.put(
            JointState(name=WHEEL_JOINTS, velocity=tuple(velocity)), self.service.stamp
        )

    def place(self, pose: Pose2D = Pose2D(x=50.0), twist: Twist2D = Twist2D()) -> None:  # noqa: B008
        """Answer the tick for the target."""
        self.person.put(planar_odometry(Time(), "world", "person", pose, twist), self.service.stamp)

    def tick(self, velocity: Sequence[float] | None = None) -> list[Sample]:
        """Answer the tick, with wheel speeds if any are given; return the next one."""
        if velocity is not None:
            self.command(velocity)
        if "target" in self.member.answers:
            self.place()
        self.service.step()
        return self.listen()

    def drive(self, ticks: int, velocity: Sequence[float] | None) -> list[Sample]:
        """Return the last of some ticks."""
        for _ in range(ticks):
            heard = self.tick(velocity)
        return heard


def wheels_of(heard: Sequence[Sample]) -> list[float]:
    """The wheels' speeds as last measured [rad/s]."""
    joints = [sample.message for sample in heard if sample.key == "joint_states"][-1]
    return list(joints.velocity[:4])


def pose_of(heard: Sequence[Sample]) -> Pose2D:
    """Where the robot was last."""
    truth = [sample.message for sample in heard if sample.key == "ground_truth/odom"][-1]
    return truth.pose.pose.to_planar()


def bytes_of(samples: Sequence[Sample]) -> bytes:
    return b"".join(
        encode(sample.message, "json") for sample in samples if not sample.key.startswith("diag")
    )


def test_each_tick_is_published_with_its_stamp_by_clock_joint_states_and_ground_truth():
    rig = Rig(start=StartConfig(x_m=1.0, y_m=2.0, yaw_deg=90.0))
    heard = rig.begin()
    for tick in range(3):
        clock, joints, truth = heard[:3]
        assert [clock.key, joints.key, truth.key] == ["clock", "joint_states", "ground_truth/odom"]
        assert len({sample.stamp for sample in heard}) == 1
        assert clock.stamp == Stamp(tick * TICK_NS, clock.stamp.run, 3)
        assert clock.message == Clock(clock=Time(nanosec=tick * TICK_NS))
        assert joints.message.header.stamp == truth.message.header.stamp == clock.message.clock
        assert truth.message.header.frame_id == "world"
        assert truth.message.child_frame_id == "base_link"
        heard = rig.tick([0.0] * 4)
    assert pose_of(heard) == pytest.approx((1.0, 2.0, math.pi / 2), abs=1e-4)


def test_joint_states_hold_the_wheels_then_every_roller():
    rig = Rig()
    joints = rig.begin()[1].message
    rollers = [roller_joint(wheel, index) for wheel in WHEELS for index in range(9)]
    assert joints.name == (*WHEEL_JOINTS, *rollers)
    assert len(joints.position) == len(joints.velocity) == len(joints.effort) == 40
    joints = rig.drive(20, [5.0] * 4)[1].message
    assert joints.velocity[:4] == pytest.approx([5.0] * 4, rel=0.01)
    assert any(abs(speed) > 0.1 for speed in joints.velocity[4:])


def test_lockstep_goes_on_when_controller_and_target_have_answered():
    rig = Rig()
    run = rig.begin()[0].stamp.run
    rig.command([1.0] * 4)
    rig.place()
    rig.service.step()
    assert rig.listen()[0].stamp == Stamp(TICK_NS, run, 3)
    assert rig.service.missed_deadlines == 0


@pytest.mark.parametrize(
    ("silent", "answers"), [("controller", ["place"]), ("target", ["command"])]
)
def test_in_lockstep_a_silent_service_is_an_error_that_names_it(silent: str, answers: list[str]):
    rig = Rig()
    rig.begin()
    rig.tick([0.0] * 4)
    if "place" in answers:
        rig.place()
    else:
        rig.command([0.0] * 4)
    with pytest.raises(StepTimeoutError, match=rf"^{silent} did not answer tick 1 \(t = 0.01 s\)$"):
        rig.service.step()


def test_a_service_that_has_gone_is_named_before_the_time_out():
    rig = Rig(answer_timeout_s=1e6)
    rig.begin()
    rig.command([0.0] * 4)
    rig.bus.presence.update("target", alive=False)
    with pytest.raises(StepTimeoutError, match=r"^target did not answer tick 0"):
        rig.service.step()


def test_an_answer_to_another_tick_is_none_to_this():
    rig = Rig()
    rig.begin()
    rig.tick([0.0] * 4)
    late = rig.service.stamp._replace(time_ns=0)
    rig.joint_command.put(JointState(name=WHEEL_JOINTS, velocity=(0.0,) * 4), late)
    rig.place()
    with pytest.raises(StepTimeoutError, match=r"^controller did not answer tick 1"):
        rig.service.step()


def test_who_does_not_take_part_is_not_waited_for():
    rig = Rig(services=ALONE)
    rig.begin()
    rig.service.step()
    assert rig.listen()[0].message == Clock(clock=Time(nanosec=TICK_NS))


def test_to_begin_with_all_services_must_be_there():
    rig = Rig()
    with pytest.raises(StepTimeoutError, match=r"^not there to start with: .*"):
        rig.service.run()
    for name in ("controller", "follower"):
        rig.bus.declare_alive(f"{name}/ready")
    with pytest.raises(StepTimeoutError, match=r"^not there to start with: target$"):
        rig.service.run()


def test_a_run_goes_on_until_the_bus_is_stopped(wall: FakeTime):
    rig = Rig(services=("physics", "controller"), mode="real_time")
    ticks = []

    def count(clock: Clock, stamp: Stamp | None) -> None:
        ticks.append(stamp)
        if len(ticks) == 5:
            rig.bus.stop()

    rig.bus.subscribe(keys.CLOCK, count)
    with pytest.raises(StoppedError):  # real time goes on without the controller
        rig.service.run()
    assert len(ticks) == 5


def test_a_lockstep_run_ends_with_its_last_tick():
    rig = Rig(services=ALONE, duration_s=0.05)
    rig.begin()
    assert [len(rig.tick()) for _ in range(6)] == [3, 3, 3, 3, 0, 0]


def test_steps_past_the_end_of_a_run_are_answered_at_its_end_and_then_refused():
    rig = Rig(services=ALONE, duration_s=0.03)
    rig.begin()
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping, late = Answer(), Answer()
    rig.service.on_step(StepRequest(ticks=100), stepping)
    assert [len(rig.tick()) for _ in range(3)] == [3, 3, 0]
    assert stepping.message.tick == 2
    rig.service.on_step(StepRequest(), late)
    assert late.error == "the run has ended: `sim/reset` begins it anew"


def test_in_lockstep_an_outsider_can_not_speak_for_a_service_that_takes_part():
    rig = Rig()
    rig.begin()
    rig.tick([1.0] * 4)
    spoken = rig.member.command
    names = ",".join(f'"{name}"' for name in WHEEL_JOINTS)
    intruder = f'{{"name":[{names}],"velocity":[9,9,9,9]}}'
    rig.bus.put_bytes("joint_command", intruder.encode())
    rig.bus.put_bytes("target/odom", b'{"pose":{"pose":{"position":{"x":0.1}}}}')
    rig.listen()
    assert rig.member.command == spoken
    assert rig.service.awaited == ["controller", "target"]


def test_wheel_speeds_are_taken_by_name_in_any_order():
    rig = Rig()
    rig.begin()
    speeds = {"front_left": 1.0, "front_right": 2.0, "rear_left": 3.0, "rear_right": 4.0}
    name = tuple(f"{wheel}_wheel_joint" for wheel in reversed(WHEELS))
    velocity = tuple(speeds[wheel] for wheel in reversed(WHEELS))
    for _ in range(10):
        message = JointState(name=("arm", *name), velocity=(9.0, *velocity))
        rig.joint_command.put(message, rig.service.stamp)
        heard = rig.tick()
    assert wheels_of(heard) == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=0.02)


def test_efforts_drive_the_wheels_as_torques():
    rig = Rig()
    rig.begin()
    for _ in range(5):
        message = JointState(name=WHEEL_JOINTS[::-1], effort=(0.4, 0.3, 0.2, 0.1))
        rig.joint_command.put(message, rig.service.stamp)
        heard = rig.tick()
    assert heard[1].message.effort[:4] == (0.1, 0.2, 0.3, 0.4)
    assert pose_of(heard).x > 0.0


def test_commands_beyond_the_motor_are_taken_as_its_limit():
    rig = Rig(world=WorldConfig(ground_friction=0.0))
    rig.begin()
    heard = rig.drive(100, [1e308] * 4)
    assert max(wheels_of(heard)) <= 40.0 + 1e-6
    message = JointState(name=WHEEL_JOINTS, effort=(-1e308,) * 4)
    rig.joint_command.put(message, rig.service.stamp)
    heard = rig.tick()
    assert heard[1].message.effort[:4] == (-3.0,) * 4


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{}",
        b'{"velocity":[1,2,3,4]}',
        b'{"name":["front_left_wheel_joint"],"velocity":[1]}',
        encode(JointState(name=WHEEL_JOINTS, velocity=(1.0,) * 3), "json"),
        encode(JointState(name=WHEEL_JOINTS, position=(1.0,) * 4), "msgpack"),
        encode(JointState(name=WHEEL_JOINTS, velocity=(math.nan,) * 4), "msgpack"),
    ],
)
def test_a_malformed_command_is_refused_and_the_last_good_one_stays(payload: bytes):
    rig = Rig(services=("physics", "target"))
    rig.begin()
    rig.drive(20, [2.0] * 4)
    rig.bus.put_bytes("joint_command", payload, "", rig.service.stamp.pack())
    heard = rig.tick()
    assert rig.bus.refused == {"joint_command": 1}
    assert wheels_of(heard) == pytest.approx([2.0] * 4, abs=0.05)


def test_the_watchdog_brings_the_wheels_to_rest_and_the_next_command_moves_them():
    config = PhysicsConfig(roller_spheres=3, dt_s=0.002, watchdog_s=0.1)
    rig = Rig(config, services=("physics", "target"))
    rig.begin()
    rig.drive(30, [4.0] * 4)
    front_left = [wheels_of(rig.tick())[0] for _ in range(130)]
    assert front_left[:9] == pytest.approx([4.0] * 9, abs=0.1)
    assert front_left[60] == pytest.approx(2.0, abs=0.2)
    assert front_left[-10:] == pytest.approx([0.0] * 10, abs=0.02)
    assert all(abs(after - before) < 0.15 for before, after in pairwise(front_left))
    assert wheels_of(rig.drive(30, [4.0] * 4)) == pytest.approx([4.0] * 4, abs=0.1)


def test_the_watchdog_slows_down_from_the_speed_that_an_effort_had_made():
    config = PhysicsConfig(roller_spheres=3, dt_s=0.002, watchdog_s=0.1)
    rig = Rig(config, services=("physics", "target"))
    rig.begin()
    rig.joint_command.put(JointState(name=WHEEL_JOINTS, effort=(0.3,) * 4), rig.service.stamp)
    speeds = [wheels_of(rig.tick())[0] for _ in range(130)]
    assert max(speeds) > 1.0
    assert speeds.index(max(speeds)) <= 12
    assert speeds[-1] == pytest.approx(0.0, abs=0.02)


def test_a_person_of_whom_nobody_speaks_any_more_stands_and_pushes_nobody():
    config = PhysicsConfig(roller_spheres=3, dt_s=0.002, watchdog_s=0.1)
    rig = Rig(config, services=("physics", "controller"))
    rig.begin()
    # 1 m before the robot, on the way to it; in 3 s they would have been through it
    rig.place(Pose2D(x=1.0, yaw=math.pi), Twist2D(x=0.5))
    rig.drive(300, [0.0] * 4)
    assert rig.member.robot.state().position[0] == pytest.approx(0.0, abs=1e-3)


def test_pause_holds_time_and_resume_lets_it_go_on():
    rig = Rig()
    rig.begin()
    rig.tick([1.0] * 4)
    state = rig.bus.call(keys.SIM_PAUSE, Empty())
    assert (state.paused, state.tick, state.clock) == (True, 1, Time(nanosec=TICK_NS))
    assert rig.tick([1.0] * 4) == []
    assert rig.tick() == []  # nobody can end the pause: it does not wait for ever
    assert rig.bus.call(keys.SIM_STATE, Empty()) == state
    assert not rig.bus.call(keys.SIM_RESUME, Empty()).paused
    assert rig.tick()[0].message.clock == Time(nanosec=2 * TICK_NS)


def test_a_queued_resume_ends_the_pause_within_the_step():
    rig = Rig(services=ALONE)
    rig.begin()
    rig.bus.call(keys.SIM_PAUSE, Empty())
    rig.bus.subscribe(keys.CMD_VEL, lambda *_: rig.bus.call(keys.SIM_RESUME, Empty()) and None)
    rig.bus.publisher(keys.CMD_VEL).put(Twist(), rig.service.stamp)
    rig.service.step()
    assert rig.service.tick == 1


def test_step_simulates_so_many_ticks_and_answers_when_they_are_done():
    rig = Rig()
    rig.begin()
    with pytest.raises(BusError, match="not paused: `sim/pause` first"):
        rig.bus.call(keys.SIM_STEP, StepRequest())
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping, impatient = Answer(), Answer()
    rig.service.on_step(StepRequest(ticks=3), stepping)
    rig.service.on_step(StepRequest(), impatient)
    assert impatient.error == "still stepping"
    assert [len(rig.tick([1.0] * 4)) for _ in range(2)] == [3, 3]
    assert stepping.message is None
    assert len(rig.tick([1.0] * 4)) == 3
    assert (stepping.message.tick, stepping.message.paused) == (3, True)
    assert rig.tick([1.0] * 4) == []


@pytest.mark.parametrize("call", [keys.SIM_PAUSE, keys.SIM_RESUME])
def test_pause_or_resume_ends_the_stepping(call: Any):
    rig = Rig(services=ALONE)
    rig.begin()
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping = Answer()
    rig.service.on_step(StepRequest(ticks=1000), stepping)
    rig.tick()
    rig.bus.call(call, Empty())
    assert stepping.error in ("paused meanwhile", "resumed meanwhile")
    rig.bus.call(keys.SIM_PAUSE, Empty())
    assert rig.tick() == []


@pytest.mark.parametrize(
    ("call", "payload"),
    [
        (keys.SIM_STEP, b'{"ticks":0}'),
        (keys.SIM_STEP, b'{"ticks":1.5}'),
        (keys.SIM_SPEED, b'{"speed":0}'),
        (keys.SIM_SPEED, b'{"speed":1e9}'),
        (keys.SIM_RESET, b'{"seed":-1}'),
        (keys.SIM_PAUSE, b"now"),
    ],
)
def test_a_malformed_request_is_answered_by_an_error(call: Any, payload: bytes):
    rig = Rig(services=ALONE, mode="real_time")
    rig.begin()
    with pytest.raises(BusError, match=f"^{call.key}: .+"):
        rig.bus.call_bytes(call, payload)
    assert rig.bus.refused == {call.key: 1}
    assert not rig.service.paused


def test_speed_is_for_real_time_only():
    rig = Rig(services=ALONE, mode="real_time")
    rig.begin()
    assert rig.bus.call(keys.SIM_SPEED, SpeedRequest(speed=4.0)).speed == 4.0
    state = rig.bus.call(keys.SIM_STATE, Empty())
    assert (state.speed, state.mode, state.seed) == (4.0, "real_time", 3)
    with pytest.raises(BusError, match="as fast as it can"):
        Rig().bus.call(keys.SIM_SPEED, SpeedRequest(speed=4.0))


def weave(rig: Rig, seed_of: int = 3) -> bytes:
    """Drive about, touch the person, and return all that physics says of it."""
    said = []
    for tick in range(60):
        rig.place(Pose2D(0.5 - 0.004 * tick, 0.05), Twist2D(x=-0.4))
        rig.command([4.0, 3.0, math.sin(0.3 * tick), 2.0])
        rig.service.step()
        said.append(rig.listen())
    assert rig.service.stamp.seed == seed_of
    return b"".join(map(bytes_of, said))


def test_a_reset_in_place_is_a_new_run_that_is_a_fresh_one_to_the_last_bit():
    fresh, rig = Rig(), Rig()
    fresh.begin()
    expected = weave(fresh)
    rig.begin()
    rig.drive(30, [10.0, -10.0, 5.0, 2.0])
    old = rig.service.stamp
    reset = Answer()
    rig.service.on_reset(ResetRequest(seed=8), reset)
    again = Answer()
    rig.service.on_reset(ResetRequest(), again)
    assert again.error == "already resetting"
    rig.service.step()
    assert (reset.message.tick, reset.message.seed, reset.message.clock) == (0, 8, Time())
    heard = rig.listen()
    assert heard[0].stamp == rig.service.stamp == Stamp(0, rig.service.stamp.run, 8)
    assert rig.service.stamp.run != old.run
    assert pose_of(heard) == Pose2D()
    # what is still on its way from before is not heard
    rig.joint_command.put(JointState(name=WHEEL_JOINTS, velocity=(9.0,) * 4), old)
    rig.listen()
    assert weave(rig, 8) == expected


def test_a_reset_keeps_the_seed_unless_told_and_the_pause_and_ends_the_stepping():
    rig = Rig(services=ALONE)
    rig.begin()
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping, reset = Answer(), Answer()
    rig.service.on_step(StepRequest(ticks=9), stepping)
    rig.tick()
    rig.service.on_reset(ResetRequest(), reset)
    rig.service.step()
    assert stepping.error == "reset meanwhile"
    assert (reset.message.seed, reset.message.tick, reset.message.paused) == (3, 0, True)
    rig.listen()
    assert rig.tick() == []


def test_a_reset_is_possible_while_an_answer_is_missing():
    rig = Rig()
    rig.begin()
    reset = Answer()
    rig.service.on_reset(ResetRequest(), reset)
    rig.service.step()
    assert reset.message is not None


def test_the_person_stops_the_robot_and_pushes_it():
    rig = Rig(PhysicsConfig(roller_spheres=3))
    rig.begin()
    for _ in range(150):  # 0.75 m, if nobody stood there
        rig.place(Pose2D(x=0.8))
        rig.command([10.0] * 4)
        rig.service.step()
    assert pose_of(rig.listen()).x < 0.45
    pushed = Rig(PhysicsConfig(roller_spheres=3))
    pushed.begin()
    for tick in range(100):
        pushed.place(Pose2D(0.6 - 0.01 * tick), Twist2D(x=-1.0))
        pushed.joint_command.put(
            JointState(name=WHEEL_JOINTS, effort=(0.0,) * 4), pushed.service.stamp
        )
        pushed.service.step()
    assert pose_of(pushed.listen()).x < -0.5


def test_a_person_beyond_all_numbers_is_refused_and_an_absurdly_fast_one_does_no_harm():
    rig = Rig(services=("physics", "controller"))
    rig.begin()
    rig.place(Pose2D(x=1e308, y=-1e308))
    rig.tick([0.0] * 4)
    assert rig.bus.refused == {"target/odom": 1}
    for _ in range(20):
        rig.place(Pose2D(), Twist2D(1.797e308, 1.797e308))
        heard = rig.tick([0.0] * 4)
    for sample in heard:
        assert_sendable(sample)


def test_the_whole_configuration_is_there_to_be_asked_for():
    rig = Rig()
    text = rig.bus.call(keys.SIM_SCENARIO, Empty()).data
    assert text == to_toml(rig.service.scenario)
    assert from_tables(tomllib.loads(text), Path("asked")).robot == NEXUS


def test_the_robot_description_is_a_urdf_and_its_meshes_are_served():
    rig = Rig()
    urdf = rig.bus.call_bytes(keys.ROBOT_DESCRIPTION, b"").data
    root = ET.fromstring(urdf)  # noqa: S314
    assert (root.tag, root.get("name")) == ("robot", "nexus")
    joints = {joint.get("name") for joint in root.findall("joint")}
    assert joints >= set(rig.begin()[1].message.name)
    meshes = {mesh.get("filename") for mesh in root.iter("mesh")}
    assert meshes
    for name in meshes:
        data = rig.bus.fetch_files(f"robot_description/{name}")[f"robot_description/{name}"]
        (triangles,) = struct.unpack_from("<I", data, 80)
        assert triangles > 5000
        assert len(data) == 84 + 50 * triangles


def test_a_diverged_state_is_one_clear_error_that_ends_the_run():
    rig = Rig(services=ALONE)
    rig.begin()
    rig.tick()
    rig.member.robot.body.skeleton.setPosition(5, -0.2)
    with pytest.raises(MecazenError, match=r"^physics diverged .* last good state at 0.010 s") as e:
        rig.service.step()
    assert "\n" not in str(e.value)
    assert rig.listen() == []


def test_a_step_that_does_not_divide_the_tick_is_a_configuration_error():
    with pytest.raises(ConfigError, match=r"^sim.tick_s: 0.01 s is not a whole number of ticks"):
        Rig(PhysicsConfig(dt_s=0.003))


def test_diagnostics_come_once_a_second():
    rig = Rig(services=ALONE)
    heard = rig.begin()
    for _ in range(200):
        heard += rig.tick()
    health = [sample.message for sample in heard if sample.key == "diagnostics/physics"]
    assert [message.header.stamp for message in health] == [Time(sec) for sec in range(3)]
    values = {value.key: value.value for value in health[0].status[0].values}
    assert values == {
        "mode": "lockstep",
        "rtf": "0.0",
        "missed_deadlines": "0",
        "paused": "False",
        "x_m": "0.0",
        "y_m": "0.0",
        "refused_payloads": "0",
    }


def test_in_real_time_a_tick_ends_when_it_is_due_and_counts_what_was_missed(wall: FakeTime):
    rig = Rig(services=("physics", "controller"), mode="real_time")
    rig.begin()
    begin = wall.now
    for _ in range(20):
        rig.tick([2.0] * 4)
    assert wall.now - begin == pytest.approx(0.2, abs=0.005)
    assert rig.service.missed_deadlines == 0
    moving = wheels_of([*rig.tick(), *rig.tick()])
    assert moving == pytest.approx([2.0] * 4, abs=0.05)  # the last command holds
    assert rig.service.missed_deadlines == 2
    assert rig.bus.call(keys.SIM_STATE, Empty()).missed_deadlines == 2


def test_at_twice_the_speed_a_tick_takes_half_the_time(wall: FakeTime):
    rig = Rig(services=ALONE, mode="real_time", speed=2.0)
    rig.begin()
    begin = wall.now
    for _ in range(20):
        rig.tick()
    assert wall.now - begin == pytest.approx(0.1, abs=0.005)
    rig.bus.call(keys.SIM_SPEED, SpeedRequest(speed=0.5))
    begin = wall.now
    for _ in range(20):
        rig.tick()
    assert wall.now - begin == pytest.approx(0.4, abs=0.005)
    assert rig.service.missed_deadlines == 0


@pytest.fixture
def schedule(wall: FakeTime) -> Iterator[Schedule]:
    """10 ms a tick at double speed, at wall time 100 s, which stands still."""
    wall.step_s = 0.0
    return Schedule(0.01, 2.0)


def test_due_dates_count_from_the_beginning_so_waiting_too_long_never_adds_up(
    schedule: Schedule, wall: FakeTime
):
    for tick in range(100):
        schedule.published(tick)
        wall.now += schedule.wait_s(tick, answered=True) + 0.001  # 1 ms late, each time
    assert wall.now == pytest.approx(100.0 + 100 * 0.005 + 0.001)


def test_who_is_behind_catches_up_but_gives_the_others_half_a_period(
    schedule: Schedule, wall: FakeTime
):
    wall.now += 0.1
    schedule.published(3)
    assert schedule.wait_s(3, answered=True) < 0.0
    assert schedule.wait_s(3, answered=False) == pytest.approx(0.0025)
    wall.now += 0.0025
    assert schedule.wait_s(3, answered=False) == pytest.approx(0.0, abs=1e-12)


def test_who_is_behind_by_more_than_a_second_begins_anew(schedule: Schedule, wall: FakeTime):
    wall.now += 1.0
    schedule.published(0)
    assert schedule.wait_s(0, answered=True) == pytest.approx(-0.995)
    wall.now += 0.01
    schedule.published(1)
    assert schedule.wait_s(1, answered=True) == pytest.approx(0.005)


def test_the_real_time_factor_is_that_of_the_last_second(schedule: Schedule, wall: FakeTime):
    for tick in range(102):  # half of the double speed that was asked for
        wall.now = 100.0 + 0.01 * tick
        schedule.published(tick)
    assert schedule.rtf == pytest.approx(1.0)
    for tick in range(102, 202):
        wall.now += 0.02
        schedule.published(tick)
    assert schedule.rtf == pytest.approx(0.5, abs=0.02)


GOOD = {
    "joint_command": [
        JointState(name=WHEEL_JOINTS, velocity=(1.0, 2.0, 3.0, 4.0)),
        JointState(name=WHEEL_JOINTS, effort=(0.1, 0.2, 0.3, 0.4)),
    ],
    "target/odom": [
        planar_odometry(Time(1), "world", "person", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1)),
        planar_odometry(Time(1), "world", "person", Pose2D(0.2, 0.0, 0.5), Twist2D(0.1)),
    ],
}


@pytest.fixture(scope="module")
def long_lived() -> Rig:
    rig = Rig()
    rig.begin()
    return rig


@settings(FUZZ, max_examples=80)
@given(wrong=puts(GOOD, FORGED | NO_STAMP))
def test_whatever_comes_on_its_keys_time_goes_on_in_finite_numbers(
    long_lived: Rig, wrong: list[Put]
):
    rig = long_lived
    tick = rig.service.tick
    put_all(rig.bus, wrong)
    for sample in rig.tick([0.0] * 4):
        assert_sendable(sample)
    assert rig.service.tick == tick + 1


@settings(FUZZ, max_examples=60)
@given(
    wrong=puts(
        {
            "sim/step": [StepRequest(ticks=2)],
            "sim/speed": [SpeedRequest(speed=2.0)],
            "sim/reset": [ResetRequest(seed=3)],
            "sim/state": [Empty()],
        },
        NO_STAMP,
    )
)
def test_whatever_is_asked_time_goes_on(long_lived: Rig, wrong: list[Put]):
    rig = long_lived
    calls = {call.key: call for call in keys.CALLS}
    for put in wrong:
        try:
            rig.bus.call_bytes(calls[put.key], put.payload)
        except BusError as refusal:
            assert "\n" not in str(refusal)  # noqa: PT017
    if rig.service.asked_reset is not None:
        rig.service.step()
    tick = rig.service.tick
    heard = rig.tick([1.0] * 4)
    assert rig.service.tick == tick + 1
    for sample in heard:
        assert_sendable(sample)


def test_after_all_that_a_reset_is_as_good_as_a_fresh_start(long_lived: Rig):
    fresh = Rig()
    fresh.begin()
    reset = Answer()
    long_lived.service.on_reset(ResetRequest(seed=3), reset)
    long_lived.service.step()
    long_lived.listen()
    assert weave(long_lived) == weave(fresh)


def test_in_real_time_a_run_begins_without_onlookers(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr("mecazen_physics.service.OBSERVERS_S", 0.0)
    rig = Rig(services=("physics", "recorder"), mode="real_time")
    rig.bus.subscribe(keys.CLOCK, lambda *_: rig.bus.stop())
    with pytest.raises(StoppedError):
        rig.service.run()
    assert "going on without recorder" in caplog.text
