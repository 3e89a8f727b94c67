"""The first-run checklist: which wheel turned, and what is wrong if another did."""

from hardware.stand import ROBOT, config, emulated
from mecazen.robot import WHEELS
from mecazen_hardware.boards import open_link
from mecazen_hardware.checklist import Found, rates, turn_each
from mecazen_hardware.emulator.firmware import Firmware


def test_on_blocks_each_wheel_turns_alone_and_forward():
    told = []
    with emulated() as emulator:
        link = open_link(config(emulator), ROBOT)
        try:
            found = turn_each(link, ROBOT.wheels.max_speed_rad_s, told.append)
        finally:
            link.close()
    assert told == [f"{name} turns forward" for name in WHEELS]
    assert [one.problem for one in found] == [""] * 4
    assert min(one.turned[number] for number, one in enumerate(found)) > 1.0


def test_each_thing_that_can_be_wrong_has_its_words():
    def problem(*turned):
        return Found("front_left", turned).problem

    assert problem(3.0, 0.0, 0.0, 0.1) == ""
    assert problem(0.0, 0.1, 0.0, 0.0).startswith("no wheel turned")
    assert problem(0.0, 0.0, 3.0, 0.0).startswith("rear_left turned instead")
    assert problem(-3.0, 0.0, 0.0, 0.0).startswith("it counts backwards")
    assert problem(3.0, 2.0, 0.0, 0.0).startswith("front_right turned as well")


def test_rates_are_those_of_each_kind_of_report():
    reports = [(Firmware(), 0.0), (Firmware(), 0.5), (Firmware(), 1.0)]
    assert rates(reports) == {"Firmware": 2.0}
