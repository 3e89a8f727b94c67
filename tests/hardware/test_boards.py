"""The installed boards."""

import pytest
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.errors import ConfigError
from mecazen_hardware.boards import make_board
from mecazen_hardware.robomaster_ep import RobomasterEp


def test_a_board_is_found_by_its_name():
    assert isinstance(make_board(HardwareConfig(board="robomaster_ep"), ROBOT), RobomasterEp)


def test_an_unknown_board_is_one_line_with_those_that_are_installed():
    with pytest.raises(ConfigError, match=r"no board 'none'; installed: robomaster_ep, rosmaster"):
        make_board(HardwareConfig(board="none"), ROBOT)
