"""Who drives: the choice among commands of the follower, of programs and of locks."""

from harness import Steps, forward, load_robot
from mecazen import messages as m
from mecazen.config import ControllerConfig, Scenario
from mecazen.config.services import Command
from mecazen.keys import CMD_VEL, HAND_CMD_VEL, JOINT_STATES, command_topic, lock_topic
from mecazen.robot import WHEEL_JOINTS
from mecazen_controller.node import ControllerNode

JOY, PAUSE = Command("joy", 200, 0.1), Command("pause", 50, lock=True)
NODE, HAND, TOPIC = CMD_VEL, HAND_CMD_VEL, command_topic("joy")
LOCK = lock_topic("pause")
JOINTS = m.JointState(name=WHEEL_JOINTS, velocity=(0.0,) * 4)


def drivers(commands, *samples, ticks=(0,)):
    """Return who drives at each of the ticks; the samples come with the ticks before their own."""
    robot = load_robot()
    controller = ControllerConfig(commands=commands)
    node = Steps(ControllerNode, Scenario(robot=robot, controller=controller))
    drives = []
    for tick in range(max(ticks) + 1):
        came = {topic: message for at, topic, message in samples if at == tick}
        node.step(tick, {JOINT_STATES: JOINTS, **came})
        drives.append(node.node.diagnostics()["drives"])
    return [drives[tick] for tick in ticks]


def test_a_program_takes_over_until_it_is_silent():
    samples = (0, NODE, forward(1.0)), (5, HAND, forward(0.2))
    assert drivers((), samples[0], ticks=(0, 50, 51)) == ["follower", "follower", ""]
    commands = (Command("cmd_vel", timeout_s=0.2),)
    expected = ["follower", "cmd_vel", "cmd_vel", "follower"]
    assert drivers(commands, *samples, ticks=(4, 5, 25, 26)) == expected
    assert drivers((JOY,), *samples, ticks=(5,)) == ["follower"]  # a key that is left out


def test_the_highest_priority_drives():
    samples = (0, HAND, forward(0.2)), (0, TOPIC, forward(0.1))
    drives = drivers((Command("cmd_vel"), JOY), *samples, ticks=(0, 10, 11))
    assert drives == ["joy", "joy", "cmd_vel"]


def test_a_lock_holds_its_priority_until_released():
    samples = (
        (0, NODE, forward(1.0)),
        (2, LOCK, m.Bool(data=True)),
        (4, HAND, forward(0.2)),
        (60, LOCK, m.Bool(data=False)),
        (60, NODE, forward(1.0)),
    )
    drives = drivers((Command("cmd_vel"), PAUSE), *samples, ticks=(1, 2, 4, 55, 60))
    assert drives == ["follower", "locked by pause", "cmd_vel", "locked by pause", "follower"]


def test_a_lock_with_a_timeout_must_be_refreshed():
    samples = (0, NODE, forward(1.0)), (1, LOCK, m.Bool())
    drives = drivers((Command("pause", 50, 0.1, lock=True),), *samples, ticks=(0, 1, 11, 12))
    assert drives == ["locked by pause", "follower", "follower", "locked by pause"]
