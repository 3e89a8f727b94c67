"""`[[robots]]`: several robots in one world."""

from __future__ import annotations

from typing import Annotated

import msgspec

from mecazen.config.controller import ControllerConfig
from mecazen.config.follower import FollowerConfig
from mecazen.config.sensor import SensorConfig
from mecazen.config.start import StartConfig
from mecazen.config.target import TargetConfig
from mecazen.keys import CALLS, TOPICS
from mecazen.robot import Robot
from mecazen.schema import Section

LIVELINESS = "mecazen"
"""The tokens of services that are alive are `mecazen/<name>`."""


class RobotConfig(Section):
    """One of several robots; a setting that is left out is that of the scenario."""

    name: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+$")]
    """Name of the robot, and its namespace within that of the run."""
    robot: Robot | None = None
    """Robot file, or its content as a table."""
    start: StartConfig | None = None
    sensor: SensorConfig | None = None
    """This section and those of the robot's services override the scenario's, key by key."""
    controller: ControllerConfig | None = None
    target: TargetConfig | None = None
    follower: FollowerConfig | None = None

    def __post_init__(self) -> None:
        taken = [*(topic.key for topic in TOPICS), *(call.key for call in CALLS), LIVELINESS]
        if self.name in {key.partition("/")[0] for key in taken}:
            raise ValueError(f"name = {self.name!r} begins a key of mecazen's own: take another")

    @property
    def own(self) -> dict[str, Section]:
        """The sections that differ from the scenario, by name."""
        values = {name: getattr(self, name) for name in self.__struct_fields__}
        return {name: value for name, value in values.items() if isinstance(value, Section)}
