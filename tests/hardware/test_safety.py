"""The reasons to stop the motors."""

from mecazen.config import HardwareConfig
from mecazen_hardware.safety import NO_COMMAND, Safety

FRESH = 0.01


def test_fresh_commands_and_reports_let_the_motors_run():
    assert Safety(HardwareConfig()).reason(FRESH, FRESH) == ""


def test_old_commands_and_silence_of_the_board_stop_them():
    safety = Safety(HardwareConfig())
    assert safety.reason(0.41, FRESH) == NO_COMMAND
    assert safety.reason(FRESH, 0.26) == "no report of the board"


def test_a_low_battery_stops_them_for_good_but_a_moment_of_sag_does_not():
    safety = Safety(HardwareConfig(min_voltage_v=9.9))
    for time_s, volts in ((0.0, 12.0), (0.1, 9.0), (0.9, 9.0), (1.0, 11.0), (1.1, 9.0)):
        safety.measured(volts, time_s)
    assert safety.reason(FRESH, FRESH) == ""
    safety.measured(9.0, 2.15)
    safety.measured(12.0, 2.2)
    assert safety.reason(FRESH, FRESH) == "battery was at 9.0 V; 9.9 V is the least"


def test_the_emergency_stop_holds_until_it_is_released():
    safety = Safety(HardwareConfig())
    safety.is_engaged = True
    assert safety.reason(FRESH, FRESH).startswith("emergency stop")
    safety.is_engaged = False
    assert safety.reason(FRESH, FRESH) == ""
