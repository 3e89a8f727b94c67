"""The package `mecazen_msgs`: complete, and with what its messages depend on."""

from pathlib import Path

import pytest
from mecazen_ros.package import files

FOLDER = Path("somewhere")


@pytest.fixture(scope="module")
def package():
    return {path.relative_to(FOLDER).as_posix(): text for path, text in files(FOLDER)}


def test_it_has_a_file_for_each_own_message_and_none_of_ros(package):
    names = {name.removeprefix("msg/") for name in package if name.startswith("msg/")}
    assert {"Skeleton.msg", "Observation.msg", "GuardState.msg", "NamedPose.msg"} <= names
    assert not names & {"Odometry.msg", "Point.msg", "Header.msg"}
    assert package.keys() - {f"msg/{name}" for name in names} == {"CMakeLists.txt", "package.xml"}
    for name in names:
        assert f'  "msg/{name}"\n' in package["CMakeLists.txt"]


def test_a_message_begins_with_its_docstring_and_has_its_own_fields_only(package):
    lines = package["msg/NamedPose.msg"].splitlines()
    assert lines[0] == "# Name and true pose of a robot."
    assert [line for line in lines if line and line[0] != "#"] == [
        "string name",
        "geometry_msgs/Pose pose",
    ]
