"""Samples of a tick, recordings of them, a follower to record, and the commands as processes."""

import secrets
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from harness import Command, here, wait
from mecazen import messages as m
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.keys import topic_of
from mecazen.wire import Stamp
from mecazen_recorder.writer import RecordingWriter

TICK_NS = 10_000_000
PROGRAM = """
from mecazen.geometry import Twist2D
from mecazen.row import Row, due, every
from mecazen.keys import CMD_VEL, OBSERVATION, ODOM
from mecazen.messages import Twist
from mecazen.node import Node

class Mine(Node):
    ROW = Row("follower", inputs=(every(ODOM), due(OBSERVATION)), outputs=(CMD_VEL,))
    def reset(self, seed):
        self.sum = 0.0
    def step(self, tick, inputs):
        self.sum += inputs[ODOM].pose.pose.position.x / 3
        if inputs.get(OBSERVATION) is not None:
            self.sum += len(inputs[OBSERVATION].poses)
        return {{CMD_VEL: Twist.planar({answer})}}

class Other(Mine):
    ROW = Row("other", inputs=Mine.ROW.inputs, outputs=(CMD_VEL,))
"""


def odometry(number: float) -> m.Odometry:
    pose = m.Pose(position=m.Point(number, -0.0, 0.1))
    return m.Odometry(pose=m.PoseWithCovariance(pose=pose, covariance=(1 / 3,) * 36))


def tick(number: int) -> dict[str, Any]:
    """Return the samples of a tick, by key."""
    return {
        "clock": m.Clock(),
        "joint_states": m.JointState(name=("a", "b"), position=(number / 3, 5e-324)),
        "odom": odometry(number / 7),
        "target/observation": m.Observation(poses=(odometry(number).pose,) * (number % 2)),
        "follower/state": m.FollowerState(header=m.Header(frame_id="odom"), tracking="waiting"),
        "cmd_vel": m.Twist(linear=m.Vector3(x=number / 10)),
    }


def stamp_of(number: int, run: int = 7, seed: int = 3) -> Stamp:
    return Stamp(number * TICK_NS, run, seed)


@pytest.fixture
def program(tmp_path):
    """Write a follower; return how it is named."""

    def write(answer="Twist2D(x=self.sum)", kind="Mine"):
        path = tmp_path / f"follower{len(list(tmp_path.iterdir()))}.py"
        path.write_text(PROGRAM.format(answer=answer))
        return f"{path}:{kind}"

    return write


@pytest.fixture
def make_recording(tmp_path):
    """Write a recording of some ticks; return its path."""

    def make(ticks=range(20), name="made.mcap"):
        path = tmp_path / name
        writer = RecordingWriter(path)
        for number in ticks:
            stamp = stamp_of(number)
            for key, message in tick(number).items():
                writer.write(key, message, stamp, stamp.time_ns)
        writer.close()
        return path

    return make


class Net:
    """A namespace on the router: a bus in it, and the commands of the recorder."""

    def __init__(self, endpoint: str) -> None:
        self.tools = ("--connect", endpoint, "--namespace", f"test{secrets.token_hex(6)}")
        config = BusConfig(connect=(endpoint,), namespace=self.tools[3])
        self.bus = ZenohBus(config)
        self.commands: list[Command] = []

    def start(self, *arguments: object) -> Command:
        """Start a command that keeps running."""
        self.commands.append(Command(*self.tools, *arguments))
        return self.commands[-1]

    def run(self, *arguments: object) -> Any:
        return here(*self.tools, *arguments)

    def publish(self, ticks: Sequence[int], **run: int) -> None:
        """Publish some ticks, with a stamp each."""
        publishers = {key: self.bus.publisher(topic_of(key)) for key in tick(0)}
        for number in ticks:
            for key, message in tick(number).items():
                publishers[key].put(message, stamp_of(number, **run))

    def wait(self, condition: Callable[[], bool]) -> None:
        """Deliver what arrives until `condition` holds."""
        wait(self.bus, condition)

    def close(self) -> None:
        self.bus.close()
        for command in self.commands:
            command.process.kill()
            command.process.communicate()


@pytest.fixture
def net(router):
    net = Net(router)
    yield net
    net.close()
