"""Errors of user code in one line with the place in the user's files, and lines of logs."""

import logging
import re

import pytest
from mecazen.errors import BusError, ConfigError, explained, set_up_log
from mecazen.keys import CLOCK
from mecazen.messages import Clock


def fail(*_):
    raise ValueError("two\n  lines")


def test_an_error_is_explained_by_the_frames_outside_of_mecazen(bus):
    bus.subscribe(CLOCK, fail)
    with pytest.raises(ValueError, match="two") as caught:
        bus.publisher(CLOCK).put(Clock(), None)  # through a frame of bus/local.py
    place = r"test_errors.py:\d+"
    line = rf"ValueError: two lines \({place} test_an_error\w+ > {place} fail\)"
    assert re.fullmatch(line, explained(caught.value))


def test_a_wrong_configuration_ends_with_its_own_exit_code():
    assert (ConfigError.exit_code, BusError.exit_code) == (2, 1)


def test_a_log_line_has_simulated_time_level_and_service(monkeypatch, capsys):
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    monkeypatch.setattr(root, "level", root.level)
    set_up_log("physics", lambda: 12.34, logging.WARNING)
    log = logging.getLogger("any")
    log.info("msg=started")
    log.warning("msg=%s count=%d", "late", 3)
    log.error("msg=failed", exc_info=ZeroDivisionError("here"))
    first, second, *_, last = capsys.readouterr().err.splitlines()
    assert first == "t=12.340 level=warning service=physics msg=late count=3"
    assert second == "t=12.340 level=error service=physics msg=failed"
    assert last == "ZeroDivisionError: here"
