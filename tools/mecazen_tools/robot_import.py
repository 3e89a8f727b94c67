"""A robot file from a description: what the description has, and what is assumed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import msgspec.inspect as mi
import numpy as np
import tomli_w
from mecazen.errors import ConfigError
from mecazen.explain import show
from mecazen.files import read_bytes, read_text
from mecazen.loading import convert, override
from mecazen.portable import Floats, product
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import lateral_gain
from mecazen.text import printable

from mecazen_tools.description import SENSORS, Description, Part

MAX_WHEELBASE_M = 5.0
"""Longest plausible distance of the axles; beyond it a file is in millimetres [m]."""
ALONG = 0.999
"""Least cosine between two directions that count as the same: 2.5°."""
SAME_PLACE_M = 1e-4
"""Distance of base_link from the wheels' centre that counts as rounding [m]."""
UNEVEN_M = 0.005
"""Largest distance of a wheel from the rectangle of all four [m]."""
DISAGREE = 0.002
"""Relative difference from which geometry and controller disagree."""
ROLLER_STOPS_HZ = 8.0
"""Rate at which the friction of its bearing slows a roller down: that of configs/robots [1/s]."""


class Wheel(NamedTuple):
    """A mecanum wheel as sold; the mass of a roller is assumed."""

    diameter_m: float
    rollers: int
    roller_radius_m: float
    roller_mass_kg: float
    width_m: float


WHEELS_SOLD = (
    Wheel(0.060, 9, 0.0065, 0.006, 0.0306),
    Wheel(0.080, 9, 0.0080, 0.008, 0.035),
    Wheel(0.100, 9, 0.0095, 0.020, 0.040),
    Wheel(0.152, 12, 0.0120, 0.040, 0.050),
    Wheel(0.203, 12, 0.0159, 0.070, 0.076),
)
"""Typical wheels by diameter.

From data sheets: 60 mm, count and width (SunFounder, Zeus Car, "Mecanum Wheel"); 203 mm, count and
radius (AndyMark, "8in Mecanum Wheels": 12 rollers, 1.25 in thick in the middle). Assumed: the rest,
as in the robot files omni4 (60 mm), rosmaster_x3 (of 65 mm), nexus and artbul.
"""
HOUSINGS = {
    "camera": {"size_m": [0.025, 0.09, 0.025], "mass_kg": 0.1},
    "lidar": {"size_m": [0.038, 0.04], "mass_kg": 0.19},
}
"""Sensors without a shape or a mass."""
ASSUMED = "assumed: "
"""Begin of a comment on a value that the description does not have."""


class Controller(NamedTuple):
    """A controller's numbers; None or empty: not in its file."""

    joints: tuple[str, ...] = ()
    """In the order of `WHEELS`."""
    radius: float | None = None
    lever: float | None = None
    """Sum of half the wheelbase and half the track [m]."""
    centre: tuple[float, float] | None = None
    """Centre of the wheels in base_link [m]."""
    settings: Mapping[str, Any] = {}
    """Settings of mecazen's controller with the same meaning."""


class Draft:
    """The values of a robot file by key, and what is known about them."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.values = dict(settings)
        self.comments: dict[str, str] = {}
        self.missing: dict[str, str] = {}

    def put(self, key: str, value: Any, comment: str = "") -> Any:
        """Add a value unless the user has set it; return the one that holds.

        Raises:
            ConfigError: The user has set a value of another type.
        """
        if key not in self.values:
            self.values[key], self.comments[key] = _rounded(value), comment
        elif isinstance(value, (int, float)) and not isinstance(self.values[key], (int, float)):
            raise ConfigError(f"--set {key}: got {show(self.values[key])}; must be a number")
        return self.values[key]

    def need(self, key: str, value: Any, reason: str) -> None:
        """Add a value that can't be assumed; None or 0: it is missing."""
        if value or key in self.values:
            self.put(key, value or 0.0)
        else:
            self.missing[key] = reason


def _rounded(value: Any) -> Any:
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_rounded(part) for part in value]
    return float(f"{value:.5g}") + 0.0 if isinstance(value, float) else value


def read_controller(path: Path) -> Controller:
    """Return the numbers of a controller: parameters of ros2_controllers, or SDF with a plugin.

    Raises:
        ConfigError: One line with the file and what is wrong with it.
    """
    if path.suffix not in (".yaml", ".yml"):
        tags = re.findall(r"<(\w+)>\s*([^<>]+?)\s*</\1>", read_text(path))
        return controller_of(dict(tags), path)
    try:
        tables = msgspec.yaml.decode(read_bytes(path))
    except ImportError:
        raise ConfigError("YAML needs pyyaml: pip install 'mecazen[robots]'") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(printable(f"{path}: {' '.join(str(error).split())}")) from None
    return controller_of(_flat(tables), path)


def _flat(tables: Any) -> dict[str, Any]:
    """Return all settings by their last name, and with the names of their tables."""
    flat: dict[str, Any] = {}
    for key, value in tables.items() if isinstance(tables, dict) else ():
        inner = _flat(value)
        flat |= inner | {f"{key}.{name}": part for name, part in inner.items()}
        if not isinstance(value, dict):
            flat[str(key)] = value
    return flat


def controller_of(settings: Mapping[str, Any], path: Path) -> Controller:
    """Return a controller's numbers from its settings by name.

    Raises:
        ConfigError: A value is not a number, or nothing is a setting of a mecanum controller.
    """

    def setting(pattern: str) -> Any:
        return next((settings[key] for key in settings if re.fullmatch(pattern, key)), None)

    def number(pattern: str) -> float | None:
        value = setting(pattern)
        try:
            return None if value is None else float(value)
        except (TypeError, ValueError):
            problem = f"{path}: {pattern}: got {value!r}; must be a number"
            raise ConfigError(printable(problem)) from None

    ends = [name.replace("rear", "(rear|back)") for name in WHEELS]
    names = [setting(f"{end}_(wheel_)?(command_)?(joint|joint_name|name)") for end in ends]
    joints = tuple(str(name) for name in names if name is not None)
    radius = number("wheels?_radius")
    lever = number("sum_of_robot_center_projection_on_X_Y_axis")
    base, track = number("wheel_?base|wheel_separation_x"), number("wheel_separation(_y)?")
    if lever is None and base is not None and track is not None:
        lever = (base + track) / 2
    x, y = number(r"base_frame_offset\.x"), number(r"base_frame_offset\.y")
    if not joints and radius is None and lever is None:
        raise ConfigError(f"{path}: has no settings of a mecanum controller")
    same: dict[str, Any] = {
        "reference_timeout_s": number("reference_timeout|cmd_vel_timeout"),
        "update_rate_hz": number("odom_publish_frequency|publish_rate"),
        "base_frame_id": setting("base_frame_id"),
        "odom_frame_id": setting("odom_frame_id"),
        "pose_covariance_diagonal": setting("pose_covariance_diagonal"),
        "twist_covariance_diagonal": setting("twist_covariance_diagonal"),
    }
    same = {name: value for name, value in same.items() if value not in (None, "base_link", "odom")}
    # the offset is that of base_link from the wheels' centre
    centre = None if x is None or y is None else (0.0 - x, 0.0 - y)
    return Controller(joints if len(joints) == len(WHEELS) else (), radius, lever, centre, same)


def import_robot(
    path: Path, description: Description, controller: Controller, settings: Mapping[str, Any]
) -> tuple[Robot, str, list[str]]:
    """Return the robot of a description, its file, and what to know about it.

    `settings` replace values by key, or add those that are missing.

    Raises:
        ConfigError: One line: the description is no robot with four mecanum wheels, or values are
            missing that can't be assumed.
    """
    draft = Draft(settings)
    wheels = find_wheels(path, description, controller)
    places = np.array([wheel.place for wheel in wheels])
    centre = places.mean(axis=0)
    wheelbase = float(places[:2, 0].mean() - places[2:, 0].mean())
    track = float(places[::2, 1].mean() - places[1::2, 1].mean())
    if max(wheelbase, track) > MAX_WHEELBASE_M:
        raise ConfigError(
            f"{path}: the axles are {wheelbase:g} m apart: is the file in millimetres? "
            "Descriptions are in metres"
        )
    corners = np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    uneven = abs(places - centre - corners * (wheelbase / 2, track / 2, 0.0)).max()
    if uneven > UNEVEN_M:
        raise ConfigError(
            f"{path}: the wheels' centres are no level rectangle: a wheel is {uneven:.3g} m off"
        )
    name = re.sub(r"[^a-z0-9]+", "_", description.name.lower()).strip("_")
    draft.put("name", name if re.match("[a-z]", name) else f"robot_{name}")
    draft.put("wheels.wheelbase_m", wheelbase)
    draft.put("wheels.track_m", track)
    base = description.base
    if np.hypot(*(centre - base.place)[:2]) > SAME_PLACE_M:
        draft.put("wheels.centre_m", (centre - base.place)[:2])
    if all(wheel.joint for wheel in wheels):
        draft.put("wheels.joints", [wheel.joint for wheel in wheels])
    rollers = description.rollers(wheels[0], ALONG)
    draft.need(
        "wheels.radius_m", _radius(wheels[0], rollers, controller), "the wheels are only meshes"
    )
    if "wheels.radius_m" in draft.values:
        radius = max(draft.values["wheels.radius_m"], 1e-6)  # `convert` refuses what is below
        _put_wheels(draft, wheels, rollers, radius)
        offset = draft.values.get("wheels.centre_m", (0.0, 0.0))
        _put_base(draft, description, wheels, centre - (*offset, radius))
    if draft.missing:
        reasons = ", ".join(f"{key} ({reason})" for key, reason in draft.missing.items())
        options = " ".join(f"--set {key}=…" for key in draft.missing)
        raise ConfigError(f"{path}: missing: {reasons}; give what you know by {options}")
    tables: dict[str, Any] = {}
    for key, value in [*draft.values.items(), *settings.items()]:
        override(tables, mi.type_info(Robot), key, value)
    robot = convert(tables, Robot, path, settings)

    notes, same = _disagreements(robot, controller)
    if re.fullmatch(r"(?!base_link$|__)[\w-]+", base.name):
        same.setdefault("controller.base_frame_id", base.name)
    if absent := [kind for kind in SENSORS if getattr(robot, kind) is None]:
        notes.append(
            f"no {' and no '.join(absent)}: scenarios that sense with one refuse the robot"
        )
    if backward := [w.joint for w in wheels if w.axis is not None and w.axis[1] < 0.0]:
        names = ", ".join(backward)
        notes.append(f"{names}: positive speeds drive backward; in mecazen they drive forward")
    toml = _to_toml(path, tables, draft.comments, notes, same)
    assumed = [
        f"{comment.replace(ASSUMED, f'{ASSUMED}{key} = {draft.values[key]}: ')}"
        for key, comment in draft.comments.items()
        if comment.startswith(ASSUMED)
    ]
    return robot, toml, [*assumed, *notes]


def find_wheels(path: Path, description: Description, controller: Controller) -> list[Part]:
    """Return the four wheels in the order of `WHEELS`.

    Raises:
        ConfigError: There are not four, or their axles are not along y.
    """
    if controller.joints:
        by_joint = {part.joint: part for part in description.parts.values()}
        if absent := [joint for joint in controller.joints if joint not in by_joint]:
            raise ConfigError(f"{path}: has no joint {', '.join(absent)} of the controller")
        wheels = [by_joint[joint] for joint in controller.joints]
    else:
        wheels = description.wheels()
    if len(wheels) != len(WHEELS):
        names = ", ".join(wheel.name for wheel in wheels) or "none"
        raise ConfigError(
            f"{path}: {len(wheels)} wheels: {names}; a mecanum robot has four: their links or "
            "joints have 'wheel' in their names, or --controller names the joints"
        )
    for wheel in wheels:
        if wheel.axle is not None and abs(wheel.axle[1]) < ALONG:
            axle = np.round(wheel.axle, 3).tolist()
            raise ConfigError(
                f"{path}: {wheel.joint or wheel.name}: its axis is {axle} in the robot's frame; an "
                "axle is along y, as x is forward: check axis and rpy"
            )
    wheels.sort(key=lambda wheel: -wheel.place[0])
    pairs = [sorted(pair, key=lambda wheel: -wheel.place[1]) for pair in (wheels[:2], wheels[2:])]
    wheels = [wheel for pair in pairs for wheel in pair]
    names = ", ".join(wheel.joint for wheel in wheels)
    if controller.joints and names != ", ".join(controller.joints):
        raise ConfigError(
            f"{path}: front left, front right, rear left and rear right are {names} by their "
            f"places, but {', '.join(controller.joints)} in the controller"
        )
    return wheels


def _radius(wheel: Part, rollers: Sequence[Part], controller: Controller) -> float | None:
    """Return the radius of a wheel: of its rollers, of its shapes, or the controller's [m]."""
    radii = [shape.size[0] for shape in wheel.shapes if shape.kind != "box"]
    if any(roller.thickness for roller in rollers):
        arms = [(roller.middle - wheel.place)[[0, 2]] for roller in rollers]  # axles are along y
        radii = [
            math.hypot(*arm) + roller.thickness for arm, roller in zip(arms, rollers, strict=True)
        ]
    return float(max(radii)) if radii else controller.radius


def _put_wheels(
    draft: Draft, wheels: Sequence[Part], rollers: Sequence[Part], radius: float
) -> None:
    """Add the wheels' width, mass and limits, and their rollers: described, or else as sold."""
    wheel = wheels[0]
    sold = min(WHEELS_SOLD, key=lambda sold: abs(math.log(sold.diameter_m / (2 * radius))))
    scale = 2 * radius / sold.diameter_m
    like = f"{ASSUMED}as on wheels of {1000 * sold.diameter_m:.0f} mm"
    widths = [2 * float(shape.size[1]) for shape in wheel.shapes if shape.kind == "cylinder"]
    draft.put(
        "wheels.hub_width_m", max(widths, default=sold.width_m * scale), "" if widths else like
    )
    speeds, torques = ([getattr(w, name) for w in wheels] for name in ("speed", "effort"))
    draft.need("wheels.max_torque_nm", min(filter(None, torques), default=None), "no effort limit")
    draft.need("wheels.max_speed_rad_s", min(filter(None, speeds), default=None), "no speed limit")

    count = max(1, draft.put("rollers.count", len(rollers) or sold.rollers))
    less = f"N = {count}: strafes {100 * (1 - lateral_gain(count)):.1f} % less than commanded"
    if "rollers.count" in draft.comments:
        draft.comments["rollers.count"] = less if rollers else f"{like}; {less}"
    mass = rollers[0].mass if rollers else 0.0
    if mass:
        draft.put("rollers.mass_kg", mass)
        draft.need("wheels.hub_mass_kg", wheel.mass, "the wheels have no mass")
    else:
        mass = sold.roller_mass_kg * scale**3
        mass = min(mass, 0.5 * wheel.mass / count) if wheel.mass else mass
        heavy = f"{ASSUMED}heavier ones turn a little slower"
        hub = wheel.mass - count * draft.put("rollers.mass_kg", mass, heavy)
        draft.need("wheels.hub_mass_kg", wheel.mass and max(hub, 0.0), "the wheels have no mass")
    if rollers:
        roller, axle = rollers[0], wheel.axle
        assert roller.axis is not None
        assert axle is not None
        x, _, z = roller.middle - wheel.place
        bottom = math.atan2(x, -z)  # angle about y to the ground, on which it points …
        forward = math.cos(bottom) * roller.axis[0] + math.sin(bottom) * roller.axis[2]
        angle = math.degrees(math.acos(min(1.0, abs(float(roller.axis @ axle)))))
        draft.need("rollers.max_radius_m", roller.thickness, "the rollers are only meshes")
        draft.put("rollers.bearing_friction_nms", roller.damping)
        draft.put("rollers.angle_deg", angle)
        # … forward and right, if those of the front left wheel are part of an X
        draft.put("rollers.arrangement", "X" if forward * roller.axis[1] < 0.0 else "O")
    else:
        thick = draft.put("rollers.max_radius_m", sold.roller_radius_m * scale, like)
        friction = ROLLER_STOPS_HZ * mass * thick**2 / 2
        draft.put("rollers.bearing_friction_nms", friction, f"{ASSUMED}coasts farther with less")
        draft.put("rollers.angle_deg", 45.0, f"{ASSUMED}usual; strafes as fast as forward")
        draft.put("rollers.arrangement", "X", f"{ASSUMED}usual; with O it hardly turns")
    draft.put("rollers.contact_friction", 1.0, f"{ASSUMED}rubber on a clean floor; slips above")


def _put_base(
    draft: Draft, description: Description, wheels: Sequence[Part], origin: Floats
) -> None:
    """Add the box between the wheels, its mass, and the sensors; `origin` is base_link's."""
    radius = float(wheels[0].place[2] - origin[2])
    length, width = draft.values["wheels.wheelbase_m"], draft.values["wheels.track_m"]
    sensors = {kind: description.sensor(kind, wheels) for kind in SENSORS}
    links = [part.name for part in sensors.values() if part and part.name != description.base.name]
    body = [part for part in description.body(wheels) if part.name not in links]
    axle = wheels[0].place[2]
    shapes = [shape for part in body for shape in part.shapes]
    boxes = [shape for shape in shapes if shape.centre[2] + shape.reach[2] > axle]
    low, high, comment = 0.5 * radius, 2.0 * radius, f"{ASSUMED}the base has no shape"
    if boxes:
        largest = max(boxes, key=lambda shape: float(np.prod(shape.reach)))
        length, comment = 2 * float(largest.reach[0]), ""
        width = min(width, 2 * float(largest.reach[1]))
        middle, half = float(largest.centre[2] - origin[2]), float(largest.reach[2])
        low, high = middle - half, middle + half
    low = min(max(low, 0.1 * radius), 0.95 * radius)
    for key, size in (("length", length), ("width", width), ("height", high - low)):
        draft.put(f"base.{key}_m", size, comment)
    draft.put("base.clearance_m", low, comment)
    draft.need("base.mass_kg", math.fsum(part.mass for part in body), "no link has a mass")
    for kind, part in sensors.items():
        if part is not None:
            _, place = description.sensors.get(part.name, ("", np.zeros(3)))
            place = part.place + product(part.rotation, place)
            draft.put(f"{kind}.position_m", place - origin, part.name)
        if part is not None and part.name in links:
            draft.put(f"{kind}.frame", part.name)
            if part.shapes:
                x, y, z = (2 * float(half) for half in part.shapes[0].reach)
                draft.put(f"{kind}.size_m", [x, y, z] if kind == "camera" else [max(x, y) / 2, z])
            draft.put(f"{kind}.mass_kg", part.mass or HOUSINGS[kind]["mass_kg"])
        if f"{kind}.position_m" in draft.values:
            for key, value in HOUSINGS[kind].items():
                draft.put(f"{kind}.{key}", value)
    if (camera := sensors["camera"]) is not None:
        x, y, z = camera.rotation[:, 0]
        draft.put("camera.pitch_deg", math.degrees(math.asin(z)))
        draft.put("camera.yaw_deg", math.degrees(math.atan2(y, x)))
        frames = [
            p.name for p in body if camera.name in description.above(p) if "optical" in p.name
        ]
        if frames:
            draft.put("camera.optical_frame", min(frames, key=lambda name: "depth" not in name))


def _disagreements(robot: Robot, controller: Controller) -> tuple[list[str], dict[str, Any]]:
    """Return what geometry and controller disagree on, with its effect.

    The other value are the settings with which mecazen's controller has the numbers of this one.
    """
    notes, same = [], dict(controller.settings)
    radius, lever, width = robot.wheels.radius_m, abs(robot.lever), robot.wheels.hub_width_m
    if controller.radius is not None and abs(radius / controller.radius - 1.0) > DISAGREE:
        same["wheel_radius_m"] = controller.radius
        notes.append(
            f"the controller's wheel radius is {controller.radius:g} m, the wheels' {radius:g} m: "
            f"the robot moves {_percent(radius / controller.radius)} than commanded"
        )
    if controller.lever is not None and abs(controller.lever / lever - 1.0) > DISAGREE:
        same["half_wheelbase_m"] = robot.half_wheelbase
        same["half_track_m"] = controller.lever - robot.half_wheelbase
        leaves_out = abs(lever - controller.lever - width / 2) < 0.1 * width
        why = ", which leaves out half of the wheel's width" if leaves_out else ""
        notes.append(
            f"the controller's sum of half lengths is {controller.lever:g} m, the wheels' "
            f"{lever:.5g} m{why}: the robot turns {_percent(controller.lever / lever)} than "
            "commanded"
        )
    if controller.centre and math.dist(controller.centre, robot.wheels.centre_m) > UNEVEN_M:
        notes.append(
            f"the controller's base_frame_offset puts the wheels' centre at {controller.centre} m "
            f"in base_link, the description at {robot.wheels.centre_m} m"
        )
    return notes, {f"controller.{key}": _rounded(value) for key, value in same.items()}


def _percent(ratio: float) -> str:
    return f"{100 * abs(ratio - 1):.1f} % {'more' if ratio > 1 else 'less'}"


def _to_toml(
    path: Path,
    tables: Mapping[str, Any],
    comments: Mapping[str, str],
    notes: Sequence[str],
    scenario: Mapping[str, Any],
) -> str:
    lines = [f"# From {printable(path.name)}. Values marked 'assumed' are not in it."]
    lines += [f"# {note}" for note in notes]
    if scenario:
        lines.append("# Settings of a scenario, so that its controller has the same numbers:")
        lines += [f"#   {_pair(key, value)}" for key, value in scenario.items()]
    lines.append(_pair("name", tables["name"]))
    for section in sorted(tables.keys() - {"name"}):
        lines += ["", f"[{section}]"]
        for key, value in tables[section].items():
            comment = comments.get(f"{section}.{key}")
            pair = _pair(key, value)
            lines.append(f"{pair:<28}  # {comment}" if comment else pair)
    return "\n".join([*lines, ""])


def _pair(key: str, value: Any) -> str:
    """Return a key and its value in a line of TOML."""
    line = " ".join(tomli_w.dumps({"key": value}).split())
    return line.replace("key =", f"{key} =", 1).replace("[ ", "[").replace(", ]", "]")
