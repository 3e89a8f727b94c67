"""Faults on request."""

import pytest
from mecazen.errors import ConfigError
from mecazen_hardware.emulator.faults import Faults, parse_faults

FRAME = bytes(range(12))


def passed(name, chance=1.0, count=1):
    faults = Faults({name: chance})
    return [faults.pass_on(FRAME) for _ in range(count)], faults


def test_without_faults_a_frame_gets_through():
    assert Faults({}).pass_on(FRAME) == FRAME


def test_each_kind_of_damage_does_what_its_name_says():
    assert passed("drop")[0] == [b""]
    (corrupt,), _ = passed("corrupt")
    assert sum(a != b for a, b in zip(corrupt, FRAME, strict=True)) == 1
    (cut,), _ = passed("cut")
    assert FRAME.startswith(cut)
    assert len(cut) < len(FRAME)


def test_merged_frames_come_together():
    got, faults = passed("merge", 0.5, 100)
    assert b"".join(got) + faults._held == FRAME * 100
    assert FRAME * 2 in got


def test_a_chance_is_a_share_of_the_frames():
    got, faults = passed("drop", 0.1, 2000)
    assert got.count(b"") == faults.damaged
    assert 140 < faults.damaged < 260  # 4.5 standard deviations


def test_the_command_line_names_faults():
    found = parse_faults(["drop=0.1", "delay=0.02", "unplug@10"])
    assert (found.chances, found.events, found.delay_s) == ({"drop": 0.1}, {"unplug": 10.0}, 0.02)


@pytest.mark.parametrize("wrong", ["drop", "drop=2", "drop@1", "unplug=1", "rust=1", "jump@-1"])
def test_a_fault_that_can_not_be_is_one_line_with_what_is_allowed(wrong):
    with pytest.raises(ConfigError, match=rf"^--fault {wrong}: allowed are drop=CHANCE"):
        parse_faults([wrong])
