"""Text that others have sent, and fields that a message does not have."""

import pytest
from mecazen.messages import Twist
from mecazen.text import printable, unknown_fields


def test_text_keeps_its_letters_and_loses_what_moves_the_cursor():
    assert printable("[/oops] né |") == "[/oops] né |"
    assert printable("a\x1b[2Jb\n\x9bc\u202e") == "a\\u001b[2Jb\\n\\u009bc\\u202e"


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
