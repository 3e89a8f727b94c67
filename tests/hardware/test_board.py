"""The protocol that all boards share."""

import pytest
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.boards import make_board


@pytest.fixture(params=["rosmaster_x3", "robomaster_ep"])
def board(request):
    return make_board(HardwareConfig(board=request.param), ROBOT)


def test_a_board_sends_its_reports_by_itself_or_is_asked_for_them(board):
    asks = board.config.board == "robomaster_ep"
    assert bool(board.poll()) == asks


def test_every_frame_can_be_explained_and_still_wheels_stop(board):
    still, made = board.drive(WheelSpeeds())
    frames = (*board.hello(), *board.stop(), still, *(board.turn_one(n, 0.1) for n in range(4)))
    assert all(board.explain(frame) for frame in frames)
    assert still in board.stop()
    assert not any(made)


def test_a_wheel_turns_alone(board):
    assert len({board.turn_one(wheel, 0.5) for wheel in range(4)}) == 4
