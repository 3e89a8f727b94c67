"""The person's section of a scenario."""

import msgspec
from mecazen.config import TargetConfig
from mecazen.config.people import Body, Driven, Gait, UTrack


def test_a_person_of_whom_nothing_is_said_walks_the_u_track_as_healthy_people_do():
    assert TargetConfig() == TargetConfig(path=UTrack(), gait=None, body=Body())


def test_path_gait_and_body_are_taken():
    table = {"path": {"kind": "driven"}, "gait": {}, "body": {"height_m": 1.1}}
    wanted = TargetConfig(path=Driven(), gait=Gait(), body=Body(height_m=1.1))
    assert msgspec.convert(table, TargetConfig) == wanted
