"""Sections of user nodes, and what is wrong with a scenario."""

from pathlib import Path
from typing import Literal

import msgspec
from harness import error_of, load_robot
from mecazen.config import scenario as config
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario, parse_settings
from mecazen.schema import AngleDeg, Live, Positive, Section

TOY = """
from typing import Annotated

import msgspec
from mecazen.keys import ODOM
from mecazen.node import Node, Row, every
from mecazen.schema import Section


class Slow(Section, tag="slow", tag_field="kind"):
    speed_m_s: float = 0.1


class Fast(Section, tag="fast", tag_field="kind"):
    speed_m_s: Annotated[float, msgspec.Meta(gt=0.0)]


class Toy(Section):
    walk: Slow | Fast = Slow()
    weights: dict[str, float] = msgspec.field(default_factory=dict)
    limit: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    mixed: float | str = 0.0


class ToyNode(Node):
    ROW = Row("toy", inputs=(every(ODOM),))
    SECTION = Toy
"""
"""A user node whose section has one of everything."""


def problem(path: Path, *overrides: str) -> str:
    """Return the error of a scenario, as one line without the test's folder."""
    text = error_of(ConfigError, lambda: load_scenario(path, parse_settings(overrides)))
    return text.replace(f"{path.parents[1]}/", "")


class Gains(Section):
    kp: Live[Positive] = 2.0
    fixed: int = 3


class Mine(Section):
    """A section with a parameter of each kind."""

    reach_m: Live[Positive] = 0.5
    bearing_deg: Live[AngleDeg | None] = None
    heading_deg: Live[AngleDeg | None] = None
    side: Live[Literal["left", "right"]] = "left"
    order: Live[tuple[str, ...]] = ("a", "b")
    turns: Live[bool] = True
    gains: Gains = Gains()
    file: str = "x"

    def __post_init__(self):
        if (self.bearing_deg is None) != (self.heading_deg is None):
            raise ValueError("bearing_deg and heading_deg must be given together")


def scenario_with(*robots, services=("physics", "mine"), **more):
    """Return a scenario with such a section, and with robots by their names and tables."""
    starts = {name: {"y_m": 2.0 * n} for n, (name, _) in enumerate(robots)}
    robot_tables = [{"name": name, "start": starts[name], **tables} for name, tables in robots]
    tables = {"robot": load_robot(), "services": services, "robots": robot_tables, **more}
    return msgspec.convert(msgspec.to_builtins(tables), config.scenario_with(mine=Mine))
