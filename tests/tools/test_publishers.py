"""Programs that publish, named from what the router reports."""

import json
from types import SimpleNamespace

import pytest
from mecazen_tools.publishers import Programs

ROS = "geometry_msgs::msg::dds_::Twist_/RIHS01_9c45"
HOLDERS = {"token/lab/mecazen/controller": "c", "token/lab/mecazen/follower": "f",
           "subscriber/lab/cmd_vel": "c", "publisher/lab/cmd_vel": "f", "publisher/lab/odom": "c",
           f"publisher/0/lab/follower/cmd_vel/{ROS}": "ros", "subscriber/**": "recorder",
           "token/two/mecazen/controller": "t", "subscriber/two/cmd_vel": "t"}  # fmt: skip
ONLY = "no service reads this key, only lab/cmd_vel, two/cmd_vel"


@pytest.mark.parametrize(
    ("key", "warning"),
    [
        ("rt/cmd_vel", ONLY),
        ("cmd_vel", ONLY),
        ("lab/robot1/cmd_vel", ONLY),
        (f"0/cmd_vel/{ROS}", f"{ONLY}; ROS needs `mecazen up --ros2`"),
        *((key, None) for key in ("lab/cmd_vel", "two/cmd_vel", "lab/guard/cmd_vel", "rt/scan")),
    ],
)
def test_commands_that_no_service_reads_are_named(key, warning):
    holders = HOLDERS | {f"publisher/{key}": "stranger"}
    entries = {
        entry: json.dumps({"peers": [program], "clients": []}) for entry, program in holders.items()
    }
    programs = Programs(SimpleNamespace(prefix="lab/", router_entries=lambda: entries))
    lines = programs.in_vain()
    assert lines == programs.in_vain([key])
    assert [line.partition(" (")[0] for line in lines] == (
        [f"{key[:60]}{'…' * (len(key) > 60)}: {warning}"] if warning else []
    )
