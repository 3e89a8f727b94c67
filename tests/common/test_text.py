"""Text that others have sent, and fields that a message does not have."""

from mecazen.text import printable


def test_text_keeps_its_letters_and_loses_what_moves_the_cursor():
    assert printable("[/oops] né |") == "[/oops] né |"
    assert printable("a\x1b[2Jb\n\x9bc\u202e") == "a\\u001b[2Jb\\n\\u009bc\\u202e"
