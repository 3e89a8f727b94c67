"""The robot's description on the bus: its URDF, and its meshes by their names."""

import pytest
from mecazen import keys
from mecazen.description import RobotDescription, ask_description, serve_description
from mecazen.errors import BusError
from mecazen.messages import Empty


def test_each_robots_description_is_what_was_served_of_it(bus):
    served = {
        robot: RobotDescription(f"<robot {robot}>", {"meshes/wheel.stl": robot.encode()})
        for robot in ("one", "two")
    }
    for robot, description in served.items():
        serve_description(bus, robot, description)
    assert {robot: ask_description(bus, robot, 1.0) for robot in served} == served
    with pytest.raises(BusError, match=r"^robot_description: nobody answers"):
        ask_description(bus, "", 1.0)
    assert bus.call(keys.call_of_robot(keys.ROBOT_DESCRIPTION, "two"), Empty()).data == (
        "<robot two>"
    )
