"""Every setting of the configuration with another value: a run shows it, or refuses it."""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.geometry import Twist2D
from mecazen.loading import effective, from_tables
from mecazen.programs import graph_of
from mecazen.schema import Section
from mecazen.urdf import ask_description
from mecazen_tools.simulation import Simulation, load
from msgspec import inspect as types

ABSENT = {
    "sim.mode": "a run of this test is in lockstep",
    "sim.speed": "needs real time",
    "sim.answer_timeout_s": "needs other processes: test_clock",
    "bus.": "needs other processes: test_session",
    "processes": "needs other processes: test_two_hosts",
    "hardware.": "needs a robot: tests/hardware",
    "viewer.": "needs a viewer: tests/viewer",
    "recorder.": "needs a recorder: tests/recorder",
}
"""Beginnings of the keys of settings that no run in one process can show, with the reason."""

ALIKE = {"robots[].": "", "crowd.walkers[].": "target.", "crowd.reactive.body": "target.body"}
"""Places that repeat sections of another place; a context shows some of their settings there."""

REFUSED = {
    "robot.rollers.arrangement": "'O': such a robot can hardly turn",
    "guard.enabled": "guard takes no part with guard.enabled = false",
    "programs": "missing.py: can't be imported",
    "target.path<recorded>.file": "no such file",
    "target.body.motion_file": "missing.bvh: no such file",
    "target.body.factors_file": "missing.toml: no such file",
}
"""Settings whose other value of this test is refused, with words of the error."""

VALUES: dict[str, Any] = {
    "follower.estimator": "ekf_ctrv",
    "follower.estimator_params": {"sway_m_sqrt_m": 1.0},
    "follower.planner.priorities": ["heading", "bearing", "visibility", "distance"],
    "programs": {"follower": "missing.py:Follower"},
    "sensor.also": ["imu"],
    "sensors.tracker.identity_memory_s": 0.9,
    "sensors.tracker.max_range_m": 1.0,
    "sensors.tracker.min_range_m": 2.0,
    "sensors.tracker.swap_probability": 0.0,
    "services": ["physics", "controller", "target"],
    "target.body.factors_file": "missing.toml",
    "target.body.motion_file": "missing.bvh",
    "target.path<goal>.via_m": [[0.0, 1.0]],
    "target.path<recorded>.file": "missing.csv",
}
"""Other values of settings whose type gives none that soon shows."""


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
REPEATED = {
    key
    for key in EVERY
    for place, original in ALIKE.items()
    if key.startswith(place) and original + key.removeprefix(place) in EVERY
}
"""The keys of those that another place has as well."""

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
            for number, each in enumerate(value):
                yield from leaves(each, f"{name}[]", (*place, field.name, number))
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
        scaled = (factor * number for factor in (2, 0.5, 1.25, 20))
        for each in (*scaled, number + 2, 0.1, 0.9, 0.01):
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
    """Return a hash of all that a run publishes and describes.

    It begins with a single sample of each command that no node of the scenario gives.
    """
    digest = hashlib.sha256()
    with Simulation(scenario) as sim:
        graph = graph_of(scenario)
        topics = [topic for topic in graph.topics if "*" not in topic.key]
        topics += [keys.diagnostics(part) for part in scenario.services]
        stamps = []
        for robot in scenario.names:
            for topic in topics:

                def take(message: Any, stamp: Any, key: str = sim.bus.key_of(topic)) -> None:
                    digest.update(key.encode() + msgspec.json.encode(message))
                    stamps.append(stamp)

                sim.bus.subscribe(keys.of_robot(topic, robot), take)
        sim.reset()  # with the samples of the first tick
        twist = m.Twist.planar(Twist2D(1.0, 0.5, 0.5))
        wheels = m.JointState(name=scenario.robot.wheels.joints, velocity=(5.0,) * 4)
        commands = {keys.CMD_VEL: twist, keys.TARGET_CMD_VEL: twist, keys.JOINT_COMMAND: wheels}
        for topic, command in commands.items():
            if graph.giver(topic.key) is None and not scenario.robots:
                sim.bus.publisher(topic).put(command, stamps[-1])
        sim.run()
        digest.update(ask_description(sim.bus, scenario.names[0], 1.0).urdf.encode())
    return digest.hexdigest()


def effect(tables: dict[str, Any], key: str, place: Place, kind: types.Type, plain: str) -> str:
    """Return why a run does not show another value of a setting; empty if it does."""
    changed = copy.deepcopy(tables)
    table: Any = changed
    for name in place[:-1]:
        table = table[name]
    told = "no other value"
    for other in [VALUES[key]] if key in VALUES else others(kind, table.get(place[-1])):
        table[place[-1]] = other
        try:
            if shown(from_tables(copy.deepcopy(changed), Path("scenario"))) != plain:
                return ""
            told = "nothing"
        except MecazenError as error:
            told = told if told == "nothing" else f"refused: {error}"
    return told


PATHS: dict[str, dict[str, Any]] = {
    "straight": {"length_m": 0.1},
    "circle": {},
    "figure_of_eight": {},
    "waypoints": {"points_m": [[0.0, 0.0], [0.1, 0.0], [1.0, 1.0]]},
    "standing": {},
    "script": {"steps": [{"duration_s": 0.1, "speed_m_s": 1.0, "yaw_rate_deg_s": 90.0}]},
    "recorded": {"file": "configs/walks/synthetic.csv"},
}
YARD = {"points_m": [[-3.0, -0.8], [2.0, -0.8], [2.0, 2.0], [-3.0, 2.0]]}
LIDAR = {"sensor.also": ["lidar"], "sensors.lidar.beams": 90, "guard.enabled": False}
ROOM = {"points_m": [[-3.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-3.0, 2.0], [-3.0, -2.0]]}
AHEAD = {"position_m": [0.27, 0.0]}  # 2 cm before the rims of the front wheels, for the base
DOORWAY = {"points_m": [[0.26, -0.1], [0.26, 2.0]]} | {
    "doors": [{"at_m": 0.6, "width_m": 0.8, "sill_m": 0.01}]
}
TABLE = {"size_m": [0.6, 0.8, 0.2], "position_m": [0.52, 0.0]}
RAMP = {"length_m": 1.0, "width_m": 1.0, "rise_m": 0.05, "position_m": [1.72, 0.0]}
PATCH = {"size_m": [0.3, 0.3], "position_m": [0.1, 0.1], "friction": 0.1}
WALKER = {"path": {"kind": "goal", "x_m": 1.0, "y_m": 0.4, "goal_m": [-3.0, 0.0]}}
BODY = {"limp": {}, "stiff_knee": {"side": "left"}, "shuffle": {}, "stride_cv": 0.05}
BARE = {"services": ["physics", "controller", "target"]}
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
            *("target.gait", "seed", "sim.tick_s", "sim.duration_s", "services", "programs"),
            *("world.slope", "world.ground", "follower.view"),
        ),
    ),
    "polar": (
        "back",
        {"sensor.occlusions_s": [[0.1, 9.0]], "follower.lost_after_s": 0.15}
        | {"follower.bearing_deg": 170.0, "follower.heading_deg": 10.0, "start.y_m": 0.3},
        ("follower.",),
    ),
    "pid": ("back", {"follower.control.kind": "pid", "start.y_m": 0.3}, ("follower.control<pid",)),
    "robots": (
        "convoy",
        {},
        ("robots[].name", "robots[].start", "robots[].target.path<u_track>.y_m"),
    ),
    "commands": (
        "back",
        BARE
        | {"target.path": {"kind": "driven", "timeout_s": 0.1}}
        | {"controller.reference_timeout_s": 0.1},
        ("target.path<driven", "controller.reference", "controller.limits"),
    ),
    "wheels": ("back", {"services": ["physics"], "physics.watchdog_s": 0.1}, ("physics.watchdog",)),
    "planner": (
        "back",
        LIDAR
        | {"follower.planner": {"samples": 100}, "start.x_m": -2.0}
        | {
            "world.obstacles": [
                {"kind": "cylinder", "size_m": [0.1, 1.0], "position_m": [-1.4, 0.0]}
            ]
        },
        ("follower.planner",),
    ),
    "guard": (  # the robot drives at a person who walks away more slowly, in a yard
        "back",
        BARE
        | LIDAR
        | {"guard.enabled": True, "world.walls": [YARD], "sim.duration_s": 0.6}
        | {"sensors.lidar.beams": 360, "sensors.lidar.dropout_probability": 0.2}
        | {"target.path": {"kind": "straight", "speed_m_s": 0.6}, "start.x_m": -0.8}
        | {"controller.reference_timeout_s": 2.0},
        ("guard.",),
    ),
    "lidar": (
        "back",
        LIDAR | {"world.walls": [ROOM], "sensors.lidar.occlusions_s": [[0.0, 0.05]]},
        ("sensors.lidar", "sensors.skeleton"),
    ),
    "tracker": (
        "back",
        {
            "sensor.also": ["tracker"],
            "sim.duration_s": 0.5,
            "target.path": {"kind": "straight", "yaw_deg": 60.0, "speed_m_s": 1.0},
            "start.x_m": -2.0,
            "sensors.tracker.occlusions_s": [[0.2, 0.3]],
            "sensors.tracker.identity_memory_s": 0.05,
            "sensors.tracker.swap_probability": 0.5,
            "sensors.tracker.swap_time_s": 0.05,
            "sensors.tracker.flip_rate_hz": 10.0,
            "sensors.tracker.flip_time_s": 0.1,
        },
        ("sensors.tracker",),
    ),
    "depth": (
        "back",
        {"sensor.also": ["depth"], "sensors.depth": {"width": 40, "height": 30}}
        | {"world.walls": [ROOM]},
        ("sensors.depth",),
    ),
    "imu": (
        "back",
        {"sensor.also": ["imu", "battery"], "sensors.encoders.counts_per_turn": 4096},
        ("sensors.imu", "sensors.battery", "sensors.encoders"),
    ),
    "body": (
        "back",
        LIDAR
        | {
            "target.body": BODY,
            "target.path": {"kind": "straight", "speed_m_s": 2.0},
            "sim.duration_s": 0.6,
        },
        ("target.body",),
    ),
    "crowd": (
        "back",
        {"crowd.reactive": {"count": 4, "x_m": [-1.0, 1.0], "y_m": [-1.0, 1.0]}},
        (
            "crowd.reactive.count",
            "crowd.reactive.x_m",
            "crowd.reactive.y_m",
            "crowd.reactive.sp",
            "crowd.reactive.body.height",
            "crowd.manners",
        ),
    ),
    "goal": (
        "back",
        {
            "crowd.manners": "orca",
            "crowd.walkers": [WALKER],
            "target.path": {"kind": "goal", "goal_m": [1.5, 0.0], "via_m": [[2.0, 0.0]]},
            "world.obstacles": [
                {"kind": "box", "size_m": [0.5, 0.5, 1.0], "position_m": [0.8, 0.0]}
            ],
        },
        (
            "target.path<goal",
            "crowd.inflation",
            "crowd.walkers[].path<goal>.x",
            "crowd.walkers[].body.height",
        ),
    ),
    "turning": (
        "back",
        {"target.path": {"kind": "goal", "goal_m": [0.1, 0.0]}},
        ("target.path<goal>.back",),
    ),
    "person": (
        "back",
        BARE | {"start.x_m": -0.43, "target.path.kind": "standing", "sim.duration_s": 0.5},
        ("world.person",),
    ),
    **{
        kind: ("back", {"target.path": {"kind": kind, **own}}, (f"target.path<{kind}",))
        for kind, own in PATHS.items()
    },
    **{
        name: (
            "back",
            BARE | LIDAR | {"target.path.x_m": 3.0, "start.x_m": 0.0, f"world.{key}": [thing]},
            (f"world.{key}[]{tag}",),
        )
        for name, key, tag, thing in (
            ("box", "obstacles", "<box", {"kind": "box", "size_m": [0.1, 0.2, 0.3]} | AHEAD),
            (
                "cylinder",
                "obstacles",
                "<cylinder",
                {"kind": "cylinder", "size_m": [0.05, 0.3]} | AHEAD,
            ),
            ("wall", "walls", "", DOORWAY),
            ("sill", "walls", ".doors[].sill", DOORWAY | {"points_m": [[0.26, -0.6], [0.26, 2.0]]}),
            ("table", "tables", "", TABLE),
            ("ramp", "ramps", "", RAMP),
            ("patch", "patches", "", PATCH),
        )
    },
}


def context_of(key: str) -> str:
    """Return the context that shows a setting: it has the longest beginning of the key."""
    begins = {b: context for context, (*_, each) in CONTEXTS.items() for b in each}
    return begins.get(max((b for b in begins if key.startswith(b)), key=len, default=""), "")


@pytest.mark.parametrize("context", CONTEXTS)
def test_another_value_of_each_setting_shows_in_a_run_or_is_refused(context):
    name, settings, _ = CONTEXTS[context]
    tables = effective(load(name, {"sim.duration_s": 0.3} | settings))
    scenario = from_tables(copy.deepcopy(tables), Path("scenario"))
    plain = shown(scenario)
    assert shown(scenario) == plain  # a difference is one of the setting
    silent = {
        key: told
        for key, place, kind in leaves(scenario)
        if context_of(key) == context
        if (told := effect(tables, key, place, kind, plain))
        if key not in REFUSED or REFUSED[key] not in told
    }
    assert silent == {}


def test_a_context_or_a_reason_covers_every_setting():
    covered = {
        key
        for context, (name, settings, _) in CONTEXTS.items()
        for key, _, _ in leaves(from_tables(effective(load(name, settings)), Path("s")))
        if context_of(key) == context
    }
    assert {key for key in EVERY - covered - REPEATED if not key.startswith(tuple(ABSENT))} == set()
    assert {key for key in covered if key.startswith(tuple(ABSENT))} == set()
    stale = [begin for begin in ABSENT if not any(key.startswith(begin) for key in EVERY)]
    assert stale + sorted({*VALUES, *REFUSED} - EVERY) == []
