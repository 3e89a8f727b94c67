"""Keys and sticks to a velocity, worked out by hand."""

import pytest
from mecazen.geometry import Twist2D
from mecazen_tools.driving import DIRECTIONS, HELP, Hand, stick_twist


def hand(*, tells_release=False):
    return Hand(0.5, 1.0, tells_release=tells_release)


@pytest.mark.parametrize(
    ("key", "twist"),
    [
        ("w", (0.5, 0.0, 0.0)),
        ("up", (0.5, 0.0, 0.0)),
        ("s", (-0.5, 0.0, 0.0)),
        ("a", (0.0, 0.5, 0.0)),
        ("d", (0.0, -0.5, 0.0)),
        ("left", (0.0, 0.0, 1.0)),
        ("l", (0.0, 0.0, -1.0)),
        ("u", (0.5, 0.0, 1.0)),
        ("o", (0.5, 0.0, -1.0)),
        ("x", (0.0, 0.0, 0.0)),
    ],
)
def test_a_key_moves_as_it_says(key, twist):
    keys = hand()
    keys.press(key, 10.0)
    assert keys.command(10.0) == twist


def test_where_no_release_is_told_a_key_is_held_until_its_repeats_stop():
    keys = hand()
    keys.press("w", 0.0)
    assert keys.command(0.69).x == 0.5  # the first repeat may take 0.7 s
    assert keys.command(0.70).x == 0.0
    keys.press("w", 1.0)
    for repeat_s in (1.5, 1.54, 1.58):
        keys.press("w", repeat_s)
    assert keys.command(1.82).x == 0.5  # each next one 0.25 s
    assert keys.command(1.84).x == 0.0
    keys.press("w", 1.9)
    assert keys.command(2.5).x == 0.5  # a new press holds for the long time


def test_where_no_release_is_told_the_newest_key_takes_the_place_of_the_one_before():
    keys = hand()
    keys.press("w", 0.0)
    keys.press("a", 0.1)
    assert keys.command(0.1) == (0.0, 0.5, 0.0)


def test_where_releases_are_told_keys_add_up_and_end_at_once():
    keys = hand(tells_release=True)
    keys.press("w", 0.0)
    keys.press("left", 0.5)
    assert keys.command(0.5) == (0.5, 0.0, 1.0)
    keys.release("w")
    assert keys.command(0.5) == (0.0, 0.0, 1.0)
    keys.press("up", 0.6)
    keys.press("down", 0.6)
    assert keys.command(0.6) == (0.0, 0.0, 1.0)
    keys.release("nothing that is held")


def test_where_releases_are_told_one_key_that_repeats_vouches_for_all_and_silence_for_none():
    keys = hand(tells_release=True)
    keys.press("w", 0.0)
    keys.press("a", 0.0)
    keys.press("a", 1.5, repeated=True)
    assert keys.command(3.4).x > 0.0
    assert keys.command(3.5) == (0.0, 0.0, 0.0)  # 2 s later: the line may be cut
    keys.press("w", 4.0, repeated=True)  # a late repeat of what has been stopped
    assert keys.command(4.0) == (0.0, 0.0, 0.0)


def test_at_a_slant_it_is_no_faster_than_straight_on():
    keys = hand(tells_release=True)
    keys.press("w", 0.0)
    keys.press("a", 0.0)
    assert keys.command(0.0) == pytest.approx((0.5 / 2**0.5, 0.5 / 2**0.5, 0.0))
    assert keys.command(0.0, Twist2D(x=1.0, y=1.0)) == keys.command(0.0)


def test_speed_keys_scale_all_speeds_within_limits_and_space_stops():
    keys = hand()
    for _ in range(3):
        keys.press("+", 0.0)
    assert keys.percent == 130
    keys.press("u", 0.0)
    assert keys.command(0.0) == pytest.approx((0.65, 0.0, 1.3))
    keys.press("space", 0.1)
    assert keys.command(0.1) == (0.0, 0.0, 0.0)
    for _ in range(50):
        keys.press("-", 0.0)
    assert keys.percent == 10
    for _ in range(50):
        keys.press("=", 0.0)
    assert keys.percent == 300


def test_every_key_of_a_letter_is_in_the_line_of_help():
    assert {key for key in DIRECTIONS if len(key) == 1} <= set(HELP.split())


def test_sticks_have_a_dead_zone_and_reach_all_the_way():
    assert stick_twist(0.15, -0.15, 0.1) == (0.0, 0.0, 0.0)
    assert stick_twist(0.0, -1.0, 0.0) == (1.0, 0.0, 0.0)  # away from the hand is ahead
    assert stick_twist(-1.0, 0.0, 1.0) == (0.0, 1.0, -1.0)  # to the left, to the right
    assert stick_twist(0.0, 0.575, 0.0).x == pytest.approx(-0.5)  # half of 0.15 … 1
