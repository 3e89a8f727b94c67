"""Tracks of people: who walks, how fast, and for how long a track lasts."""

import pytest
from mecazen_guard.tracks import FORGET_S, GATE_M, LOOKED_S, Tracks


def walk(tracks, scans, *, speed=0.8, is_leg=True, begin=0):
    """Show a person who walks along x, 10 times a second; return their last track."""
    for k in range(begin, begin + scans):
        (track,) = tracks.update(0.1 * k, [((speed * 0.1 * k, 2.0), is_leg)])
    return track


def test_a_walker_has_the_velocity_of_the_line_through_the_last_places():
    track = walk(Tracks(), 8)
    assert (track.speed, *track.direction) == pytest.approx((0.8, 1.0, 0.0))
    assert track.newest == pytest.approx(0.8)
    assert track.at(1.7) == pytest.approx((0.8 * 1.7, 2.0))


@pytest.mark.parametrize(
    ("scans", "speed", "is_leg"), [(2, 0.8, True), (8, 0.2, True), (8, 0.8, False)]
)
def test_without_enough_places_speed_or_looks_nobody_is_known_to_walk(scans, speed, is_leg):
    assert walk(Tracks(), scans, speed=speed, is_leg=is_leg).speed == 0.0


def test_a_person_remains_one_for_a_while_without_looking_like_a_leg():
    tracks = Tracks()
    walk(tracks, 5)
    assert walk(tracks, 10, is_leg=False, begin=5).is_person
    assert not walk(tracks, round(LOOKED_S / 0.1), is_leg=False, begin=15).is_person


def test_legs_that_part_are_both_as_fast_as_their_person():
    tracks = Tracks()
    walk(tracks, 6)
    parted = tracks.update(0.6, [((0.4, 2.0), True), ((0.56, 2.0), True)])
    assert [track.speed > 0.5 for track in parted] == [True, True]


def test_a_place_beyond_the_gate_begins_another_track():
    tracks = Tracks()
    walk(tracks, 6)
    (other,) = tracks.update(0.6, [((0.48 + 1.1 * GATE_M, 2.0), True)])
    assert len(other.places) == 1
    assert len(tracks.known) == 2


def test_who_is_not_seen_is_expected_to_walk_on_and_then_forgotten():
    tracks = Tracks()
    walk(tracks, 6)
    assert tracks.update(0.5 + FORGET_S, []) == []
    (unseen,) = tracks.known
    assert unseen.at(1.0) == pytest.approx((0.8, 2.0))
    tracks.update(0.6 + FORGET_S, [])
    assert tracks.known == []
