"""Fields that a message does not have: each is named, with those that it could have meant."""

import pytest
from mecazen.messages import Twist
from mecazen.suggest import unknown_fields


@pytest.mark.parametrize(
    ("given", "lines"),
    [
        ({"linear": {"x": 1}}, []),
        (3, []),
        ({"linaer": {}}, ["linaer is ignored; did you mean linear? allowed: linear, angular"]),
        (
            {"linear": {"w": 1, "x": 1}, "other": 1},
            [
                "linear.w is ignored; allowed: x, y, z",
                "other is ignored; allowed: linear, angular",
            ],
        ),
    ],
)
def test_each_unknown_field_is_a_line(given, lines):
    assert list(unknown_fields(given, Twist())) == lines
