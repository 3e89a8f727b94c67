"""Every setting of the configuration with another value: a run shows it, or refuses it."""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mecazen import keys
from mecazen.config import Scenario
from mecazen.description import ask_description
from mecazen.errors import MecazenError
from mecazen.loading import effective, from_tables
from mecazen.programs import graph_of
from mecazen.schema import Section
from mecazen_tools.simulate import InProcess
from mecazen_tools.simulation import load
from msgspec import inspect as types

TICKS = 31
"""Length of a run: 0.3 s."""

ABSENT = {
    "sim.mode": "a run of this test is in lockstep",
    "sim.speed": "needs real time",
    "sim.duration_s": "the length of a run, not its content",
    "sim.answer_timeout_s": "needs other processes: test_clock",
    "physics.watchdog_s": "needs a controller that is silent: test_watchdog",
    "controller.limits.x.max_deceleration_m_s2": "needs a longer run: test_drive",
    "bus.": "needs other processes: test_session",
    "processes": "needs other processes: test_two_hosts",
    "hardware.": "needs a robot: tests/hardware",
    "viewer.": "needs a viewer: tests/viewer",
    "recorder.": "needs a recorder: tests/recorder",
    "programs": "names code: test_extend",
    "services": "removes nodes: test_programs",
    "robots[].": "has the sections of a single robot: test_robots",
    "changes[].": "changes other settings: test_parameters",
    "sensor.also": "adds nodes: test_graph",
    "follower.view": "replaced by the bearing of the context: test_config",
    "follower.estimator_params": "a table without defaults: test_config",
    "follower.planner.": "needs obstacles: tests/follower",
    "guard.": "needs an obstacle ahead: tests/guard",
    "crowd.": "needs a longer walk: tests/crowd",
    "target.path<recorded>": "needs a file: tests/people",
    "target.path<driven>": "needs a command: tests/target",
    "target.path<goal>.back_and_forth": "acts at the goal: tests/people",
    "target.path<goal>.keeps_m": "needs other pedestrians: tests/people",
    "target.path<goal>.via_m": "has no default: tests/people",
    "target.path<goal>.within_m": "acts at a way-point: tests/people",
    "target.path<script>.yaw_acceleration_deg_s2": "needs a turn of the body: tests/people",
    "target.body": "needs sensors of bodies: tests/people",
    "sensors.": "needs lidar and cameras, 1 min: tests/sensors",
    "world.": "needs contacts or a lidar: tests/physics and tests/sensors",
}
"""Beginnings of the keys of settings that no context covers, with the reason or their tests."""


def schema(kind: types.Type, prefix: str = "") -> Iterator[str]:
    """Yield the key of each setting; `[]` marks a list of tables, and `<kind>` one of several."""
    if isinstance(kind, types.Metadata):
        yield from schema(kind.type, prefix)
    elif isinstance(kind, types.StructType):
        tag = f"<{kind.tag}>" if kind.tag else ""
        for field in kind.fields:
            yield from schema(field.type, f"{prefix}{tag}.{field.encode_name}".lstrip("."))
    elif isinstance(kind, types.UnionType):
        structs = [part for part in kind.types if isinstance(part, types.StructType)]
        for part in structs or [types.AnyType()]:
            yield from schema(part, prefix)
    elif isinstance(kind, types.VarTupleType) and _is_table(kind.item_type):
        yield from schema(kind.item_type, f"{prefix}[]")
    else:
        yield prefix


def _is_table(kind: types.Type) -> bool:
    kinds = kind.types if isinstance(kind, types.UnionType) else (kind,)
    return all(isinstance(part, types.StructType) for part in kinds)


EVERY = set(schema(types.type_info(Scenario))) - {"robot_name", "others"}
"""The keys of all settings."""

Place = tuple[str | int, ...]
"""Names and indices that lead to a setting in the tables of a scenario."""


def leaves(section: Section, key: str = "", place: Place = ()) -> Iterator[tuple[str, Place, Any]]:
    """Yield key, place and type of each setting of a section and of the sections within."""
    info = types.type_info(type(section))
    tag = f"<{info.tag}>" if info.tag else ""
    for field in info.fields:
        value, name = getattr(section, field.name), f"{key}{tag}.{field.name}".lstrip(".")
        if isinstance(value, Section):
            yield from leaves(value, name, (*place, field.name))
        elif isinstance(value, tuple) and value and isinstance(value[0], Section):
            yield from leaves(value[0], f"{name}[]", (*place, field.name, 0))
        else:
            yield name, (*place, field.name), field.type


def others(kind: types.Type, value: Any) -> Iterator[Any]:
    """Yield other values of a setting."""
    if isinstance(kind, types.Metadata):
        yield from others(kind.type, value)
    elif isinstance(kind, types.UnionType):
        for part in kind.types:
            yield from others(part, value)
    elif isinstance(kind, types.BoolType):
        yield not value
    elif isinstance(kind, types.LiteralType):
        yield from (each for each in kind.values if each != value)
    elif isinstance(kind, types.IntType | types.FloatType):
        number = value if isinstance(value, int | float) and math.isfinite(value) else 1.0
        for each in (
            2 * number,
            number / 2,
            1.25 * number,
            number + 2,
            0.1,
            20 * number,
            0.9,
            0.01,
        ):
            changed = int(each) if isinstance(kind, types.IntType) else float(each)
            if changed != value:
                yield changed
    elif isinstance(kind, types.StrType):
        yield f"{value or ''}x"
    elif isinstance(kind, types.TupleType | types.VarTupleType) and value:
        inner = kind.item_type if isinstance(kind, types.VarTupleType) else kind.item_types[0]
        for each in others(inner, value[0]):
            yield [each, *value[1:]]
        if isinstance(inner, types.TupleType | types.VarTupleType):
            yield value[:-1]


def shown(scenario: Scenario) -> str:
    """Return a hash of all that a run publishes and describes."""
    digest = hashlib.sha256()
    with closing(InProcess(scenario)) as run:
        topics = [topic for topic in graph_of(scenario).topics if "*" not in topic.key]
        topics += [keys.diagnostics(part) for part in scenario.services]
        for robot in scenario.names:
            for topic in topics:

                def take(message: Any, _: object, key: str = run.bus.key_of(topic)) -> None:
                    digest.update(key.encode() + msgspec.json.encode(message))

                run.bus.subscribe(keys.of_robot(topic, robot), take)
        run.begin()
        for _ in range(1, TICKS):
            run.step()
        digest.update(ask_description(run.bus, scenario.names[0], 1.0).urdf.encode())
    return digest.hexdigest()


def effect(tables: dict[str, Any], place: Place, kind: types.Type, plain: str) -> str:
    """Return whether a run shows another value of a setting, or why it does not."""
    changed = copy.deepcopy(tables)
    table: Any = changed
    for name in place[:-1]:
        table = table[name]
    told = "no other value"
    for other in others(kind, table.get(place[-1])):
        table[place[-1]] = other
        try:
            if shown(from_tables(copy.deepcopy(changed), Path("scenario"), ())) != plain:
                return ""
            told = "nothing"
        except MecazenError as error:
            told = told if told == "nothing" else f"refused: {error}"
    return told


PATHS = {
    "straight": {"length_m": 0.1},
    "circle": {},
    "figure_of_eight": {},
    "waypoints": {"points_m": [[0.0, 0.0], [0.1, 0.0], [1.0, 1.0]]},
    "standing": {},
    "script": {"steps": [{"duration_s": 0.1, "speed_m_s": 1.0}]},
    "goal": {"goal_m": [3.0, 2.0]},
}
CONTEXTS: dict[str, tuple[str, dict[str, Any], tuple[str, ...]]] = {
    "robot": (
        "back",
        {
            "robot.motors": {"time_constant_s": 0.05, "delay_s": 0.02, "dead_band_rad_s": 0.1},
            "robot.payload": {"mass_kg": 2.0, "position_m": [0.0, 0.0, 0.4]},
            "target.gait": {},
            "target.path": {"kind": "u_track", "speed_m_s": 1.0, "length_m": 0.1},
            "physics.drive": "effort",
            "world.slope_deg": 3.0,
            "sensor.occlusions_s": [[0.1, 0.2]],
            "sensor.faults": {
                "outlier_probability": 0.5,
                "other_m": 1.0,
                "stand_ins_s": [[0.0, 0.1]],
            },
            "controller.update_rate_hz": 10.0,
        },
        (
            *("robot.", "physics.", "controller.", "start.", "sensor.", "target.path<u"),
            *("target.gait", "seed", "sim.tick_s", "world.slope", "world.ground"),
        ),
    ),
    "polar": (
        "back",
        {"sensor.occlusions_s": [[0.1, 9.0]], "follower.lost_after_s": 0.15}
        | {"follower.bearing_deg": 170.0, "follower.heading_deg": 10.0, "start.y_m": 0.3},
        ("follower.",),
    ),
    "pid": ("back", {"follower.control.kind": "pid", "start.y_m": 0.3}, ("follower.control<pid",)),
    **{
        kind: ("back", {"target.path": {"kind": kind, **own}}, (f"target.path<{kind}",))
        for kind, own in PATHS.items()
    },
}


@pytest.mark.parametrize("context", CONTEXTS)
def test_another_value_of_each_setting_shows_in_a_run_or_is_refused(context):
    name, settings, beginnings = CONTEXTS[context]
    tables = effective(load(name, settings))
    scenario = from_tables(copy.deepcopy(tables), Path("scenario"), ())
    plain = shown(scenario)
    assert shown(scenario) == plain  # a difference is one of the setting
    silent = {
        key: told
        for key, place, kind in leaves(scenario)
        if key in EVERY and key.startswith(beginnings) and not key.startswith(tuple(ABSENT))
        if (told := effect(tables, place, kind, plain)) in ("nothing", "no other value")
    }
    assert silent == {}


def test_a_context_or_a_reason_covers_every_setting():
    covered = {
        key
        for name, settings, beginnings in CONTEXTS.values()
        for key, _, _ in leaves(from_tables(effective(load(name, settings)), Path("s"), ()))
        if key.startswith(beginnings)
    }
    assert [key for key in EVERY - covered if not key.startswith(tuple(ABSENT))] == []
    stale = [begin for begin in ABSENT if not any(key.startswith(begin) for key in EVERY)]
    assert stale == []
