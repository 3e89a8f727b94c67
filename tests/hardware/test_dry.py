"""A dry run: the wheels turn as commanded, and frames are printed once each."""

import pytest
from hardware.stand import ROBOT
from mecazen.config import HardwareConfig
from mecazen.wheels import WheelSpeeds
from mecazen_hardware.board import MeasuredSpeeds
from mecazen_hardware.boards import open_link


def test_frames_are_printed_and_wheels_turn_as_commanded(capsys):
    link = open_link(HardwareConfig(port="/dev/none", dry_run=True), ROBOT)
    for _ in range(3):
        link.drive(WheelSpeeds(10.0, 10.0, 10.0, 10.0))
    (report, _), _ = link.read()
    assert isinstance(report, MeasuredSpeeds)
    assert report.speeds.front_left == pytest.approx(10.0, abs=0.02)
    link.close()
    printed = capsys.readouterr().out
    assert printed.count("motion +0.325 m/s") == 1
    assert printed.endswith("reset state\n")
