"""A gamepad that is found, drives, and is pulled out."""

import sys
from types import SimpleNamespace

import pytest
from mecazen_tools import gamepad


class Pad:
    """A gamepad as pygame has it."""

    name = "pad"
    is_there = True

    def get_axis(self, axis):
        return (0, -32768, 32767)[axis]

    def attached(self):
        return self.is_there


@pytest.fixture
def plug(monkeypatch):
    """Put a pygame in place that knows of some gamepads."""

    def install(*pads):
        controller = SimpleNamespace(
            init=lambda: None,
            get_count=lambda: len(pads),
            is_controller=lambda number: isinstance(pads[number], Pad),
            Controller=lambda number: pads[number],
        )
        game = SimpleNamespace(
            display=SimpleNamespace(init=lambda: None),
            event=SimpleNamespace(pump=lambda: None),
            error=RuntimeError,
            CONTROLLER_AXIS_LEFTX=0,
            CONTROLLER_AXIS_LEFTY=1,
            CONTROLLER_AXIS_RIGHTX=2,
        )
        monkeypatch.setitem(sys.modules, "pygame", game)
        monkeypatch.setitem(sys.modules, "pygame._sdl2", SimpleNamespace(controller=controller))

    for name in gamepad.SDL:
        monkeypatch.setenv(name, "")
    return install


def test_the_first_gamepad_drives_until_it_is_pulled_out(plug):
    known = Pad()
    plug("a wheel", known)
    twist, told = gamepad.find()
    assert told == "gamepad pad: the left stick moves, the right one turns"
    assert twist() == pytest.approx((1.0, 0.0, -1.0), abs=1e-4)  # 32767 of 32768
    known.is_there = False
    assert twist() == (0.0, 0.0, 0.0)


def test_without_a_gamepad_or_its_library_it_is_said_in_one_line(plug, monkeypatch):
    plug()
    assert gamepad.find() == (None, "keyboard only: no gamepad is plugged in")
    monkeypatch.setitem(sys.modules, "pygame", None)
    pad, told = gamepad.find()
    assert pad is None
    assert told == "keyboard only: a gamepad needs pip install 'mecazen[gamepad]'"
