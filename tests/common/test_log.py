"""Logs: one line an event, with simulated time."""

import logging

import pytest
from mecazen.log import set_up


@pytest.fixture(autouse=True)
def root(monkeypatch):
    """Keep the test's logging as it was."""
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    level = root.level
    yield root
    root.setLevel(level)


def test_a_line_has_simulated_time_level_and_service(capsys):
    set_up("physics", lambda: 12.34, logging.WARNING)
    logging.getLogger("any").info("msg=started")
    logging.getLogger("any").warning("msg=%s count=%d", "late", 3)
    assert capsys.readouterr().err == "t=12.340 level=warning service=physics msg=late count=3\n"


def test_an_exception_follows_its_line(capsys):
    set_up("physics", lambda: 0.0)
    logging.getLogger("any").error("msg=failed", exc_info=ZeroDivisionError("here"))
    first, *_, last = capsys.readouterr().err.splitlines()
    assert (first, last) == (
        "t=0.000 level=error service=physics msg=failed",
        "ZeroDivisionError: here",
    )
