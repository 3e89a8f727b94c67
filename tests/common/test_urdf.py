"""Contents of a URDF; an invalid one is refused with the reason."""

from itertools import pairwise

import pytest
from mecazen import urdf
from mecazen.errors import RefusedError
from viewer.toy import URDF

TENFOLD = [f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghi")]
BOMB = f'<!DOCTYPE r [<!ENTITY a "{"x" * 1000}">{"".join(TENFOLD)}]><robot name="&i;"/>'
"""XML of 2 kB whose name would have 100 GB."""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no element"),
        (BOMB, "amplification"),
        ("<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><r>&x;</r>", "undefined entity"),
        ("<robot><link name='a'><visual/></link></robot>", "visual  without geometry"),
        ("<robot><link name='a'><visual><geometry/></visual></link></robot>", "empty geometry"),
        (URDF.replace("box size", "ball size").replace("</box>", "</ball>"), "ball"),
        (URDF.replace('xyz="0 1 0"', 'xyz="0 1"'), "'0 1' must be 3 numbers"),
        (URDF.replace('<child link="mast"/>', ""), "mast_joint without child"),
    ],
)
def test_what_is_no_urdf_is_refused_with_what_is_wrong(text, words):
    with pytest.raises(RefusedError, match=words) as caught:
        urdf.read(text)
    assert "not a URDF" in str(caught.value)


def test_a_urdf_of_too_many_joints_is_refused():
    joint = "<joint><parent link='a'/><child link='b'/></joint>"
    with pytest.raises(RefusedError, match="1001 joints; at most 1000"):
        urdf.read(f"<robot>{joint * 1001}</robot>")
