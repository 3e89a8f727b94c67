"""Every setting is read by code; other values of sensors and follower show in a run."""

from __future__ import annotations

import ast
import copy
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import msgspec.inspect as mi
import pytest
from harness import ROOT
from mecazen.config import Scenario
from mecazen.config.services import AngularLimits, LinearLimits
from mecazen.errors import MecazenError
from mecazen.loading import effective, from_tables
from mecazen.programs import graph_of
from mecazen.schema import fields, members
from mecazen_tools.simulation import Simulation, load

CODE = ("common", "people", "services", "tools", "ros2")


def settings_of(node: mi.Type) -> Iterator[str]:
    """Yield the name of each setting of a table and of the tables within."""
    for kind in members(node):
        if isinstance(kind, mi.VarTupleType):
            yield from settings_of(kind.item_type)
        for name, inner in fields(kind).items():
            if name != "kind":
                yield name
            yield from settings_of(inner)


def test_code_reads_every_setting():
    # the limits are read as a tuple
    read = {*LinearLimits.__struct_fields__, *AngularLimits.__struct_fields__}
    for file in (path for part in CODE for path in (ROOT / part).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute):
                read.add(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                read |= {*node.value.split(".")}  # the key of a rate, a name for getattr
    assert {*settings_of(mi.type_info(Scenario))} - read == set()


def others(kind: mi.Type, value: Any) -> Iterator[Any]:
    """Yield other values of a setting."""
    for node in members(kind):
        if isinstance(node, mi.BoolType):
            yield not value
        elif isinstance(node, mi.LiteralType):
            yield from (choice for choice in node.values if choice != value)
        elif isinstance(node, mi.IntType):
            yield 2 * (value or 1)
        elif isinstance(node, mi.FloatType):
            yield from (factor * value for factor in (2.0, 0.5, 0.05)) if value else (0.9, 30.0)


def leaves(node: mi.Type, table: Any, key: str) -> Iterator[tuple[str, list[Any]]]:
    """Yield key and other values of each setting of a table and of the tables within."""
    for name, kind in fields(node).items():
        value = table.get(name)
        if isinstance(value, dict):
            yield from leaves(kind, value, f"{key}.{name}")
        elif value is not None and (values := [*others(kind, value)]):
            yield f"{key}.{name}", values


def shows(scenario: Scenario, key: str, values: list[Any], plain: str) -> bool:
    """Return whether a run with one of the values differs, or the value is refused."""
    try:
        return any(shown(load(scenario, {key: value})) != plain for value in values)
    except MecazenError:
        return True


def shown(scenario: Scenario) -> str:
    """Return a hash of all that a run publishes."""
    digest = hashlib.sha256()

    def take(message: Any, stamp: Any) -> None:
        del stamp
        digest.update(msgspec.json.encode(message))

    with Simulation(scenario) as sim:
        for topic in graph_of(scenario).topics:
            if "*" not in topic.key:
                sim.bus.subscribe(topic, take)
        sim.reset()  # with the samples of the first tick
        sim.run()
    return digest.hexdigest()


ROOM = {"points_m": [[-3.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-3.0, 2.0], [-3.0, -2.0]]}
LIDAR = {"sensor.also": ["lidar"], "sensors.lidar.beams": 90, "guard.enabled": False}
SEEN = {"target.path": {"kind": "straight", "yaw_deg": 60.0, "speed_m_s": 1.0}, "start.x_m": -2.0}
CONTEXTS: dict[str, dict[str, Any]] = {
    "sensor": {
        "sensor.faults": {"outlier_probability": 0.5, "other_m": 1.0, "stand_ins_s": [[0.0, 0.1]]},
    },
    "follower": {"sensor.occlusions_s": [[0.05, 9.0]], "follower.lost_after_s": 0.12},
    "sensors.lidar": LIDAR | {"world.walls": [ROOM]},
    "sensors.tracker": SEEN
    | {
        "sensor.also": ["tracker"],
        "sim.duration_s": 0.5,
        "sensors.tracker": {"swap_probability": 0.4, "flip_rate_hz": 10.0, "swap_time_s": 0.05}
        | {"min_range_m": 1.0, "identity_memory_s": 0.3, "occlusions_s": [[0.2, 0.3]]},
    },
    "sensors.depth": {"sensor.also": ["depth"], "world.walls": [ROOM]}
    | {"sensors.depth": {"width": 40, "height": 30}},
    "sensors.imu": {"sensor.also": ["imu"]},
}
"""Settings of a scenario that let other values of the settings in a section show, by section."""

NEED_MORE = {"follower.search_s"}
"""A search needs a lidar, a camera and seconds: see `tests/follower/test_node.py`."""


@pytest.mark.parametrize("section", CONTEXTS)
def test_another_value_shows_in_a_run_or_is_refused(section):
    tables = effective(load("back", {"sim.duration_s": 0.2} | CONTEXTS[section]))
    scenario = from_tables(copy.deepcopy(tables), Path("scenario"))
    plain = shown(scenario)
    assert shown(scenario) == plain  # a difference is one of the setting
    node, table = mi.type_info(type(scenario)), tables
    for name in section.split("."):
        node, table = fields(node)[name], table[name]
    each = leaves(node, table, section)
    silent = [key for key, values in each if not shows(scenario, key, values, plain)]
    assert {*silent} - NEED_MORE == set()
