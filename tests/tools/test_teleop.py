"""Keys and sticks to a velocity, worked out by hand."""

import sys
from types import SimpleNamespace

import pytest
from mecazen.geometry import Twist2D
from mecazen_tools.cli.teleop import SDL, Hand, find_gamepad

REST = Twist2D()


@pytest.fixture
def hand():
    return Hand(0.5, 1.0)


def test_a_key_is_held_until_its_repeats_stop(hand):
    hand.press("w", 0.0)
    assert hand.command(0.69, REST).x == 0.5  # the first repeat may take 0.7 s
    assert hand.command(0.70, REST).x == 0.0
    for time_s in (1.0, 1.5, 1.54, 1.58):
        hand.press("w", time_s)
    assert hand.command(1.82, REST).x == 0.5  # each next one 0.25 s
    assert hand.command(1.84, REST).x == 0.0
    hand.press("w", 1.9)
    assert hand.command(2.5, REST).x == 0.5  # a new press holds for the long time
    hand.press("a", 2.5)  # the newest key replaces the one before
    assert hand.command(2.5, REST) == (0.0, 0.5, 0.0)
    # a stick adds to it; diagonal motion is no faster than straight motion
    diagonal = (0.5 / 2**0.5, 0.5 / 2**0.5, 0.0)
    assert hand.command(2.5, Twist2D(x=1.0)) == pytest.approx(diagonal)


def test_speed_keys_scale_within_limits_and_space_stops(hand):
    for _ in range(50):
        hand.press("-", 0.0)
    hand.press("u", 0.0)
    assert hand.command(0.0, REST) == pytest.approx((0.05, 0.0, 0.1))
    for _ in range(50):
        hand.press("+", 0.0)
    assert hand.percent == 300
    hand.press(" ", 0.1)
    assert hand.command(0.1, REST) == (0.0, 0.0, 0.0)


class Pad:
    """A gamepad as pygame has it."""

    name = "pad"
    is_attached = True
    axes = (0, 0, 0)

    def get_axis(self, axis):
        return self.axes[axis]

    def attached(self):
        return self.is_attached


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
        pygame = SimpleNamespace(
            display=SimpleNamespace(init=lambda: None),
            event=SimpleNamespace(pump=lambda: None),
            error=RuntimeError,
            CONTROLLER_AXIS_LEFTX=0,
            CONTROLLER_AXIS_LEFTY=1,
            CONTROLLER_AXIS_RIGHTX=2,
        )
        monkeypatch.setitem(sys.modules, "pygame", pygame)
        monkeypatch.setitem(sys.modules, "pygame._sdl2", SimpleNamespace(controller=controller))

    for name in SDL:
        monkeypatch.setenv(name, "")
    return install


def test_the_first_gamepad_drives_until_it_is_unplugged(plug):
    pad = Pad()
    plug("a wheel", pad)
    twist, about = find_gamepad()
    assert about == "gamepad pad: the left stick moves, the right one turns"
    pad.axes = (-32768, -32768, 32767)  # left, away from the hand; right
    assert twist() == pytest.approx((1.0, 1.0, -1.0), abs=1e-4)  # 32767 of 32768
    pad.axes = (4915, -4915, 3000)  # below the dead zone of 0.15
    assert twist() == (0.0, 0.0, 0.0)
    pad.axes = (0, 18842, 0)  # half of 0.15 … 1
    assert twist().x == pytest.approx(-0.5, abs=1e-4)
    pad.is_attached = False
    assert twist() == (0.0, 0.0, 0.0)


def test_a_missing_gamepad_or_library_is_one_line(plug, monkeypatch):
    plug()
    stick, about = find_gamepad()
    assert (stick(), about) == (Twist2D(), "keyboard only: no gamepad is plugged in")
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert find_gamepad()[1] == "keyboard only: a gamepad needs pip install 'mecazen[gamepad]'"
