"""Robots as others describe them: URDF, xacro, SDF and MJCF, read by MuJoCo."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import read_text
from mecazen.portable import Floats
from mecazen.text import printable

SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box"}
"""Names of MuJoCo's shapes; meshes are left out."""
HINGE = 3
"""MuJoCo's number of a joint that turns."""
TINY = 1e-9
"""Mass and inertia that MuJoCo needs of links without any [kg, kg·m²]."""
NO_LIMIT = 1e9
"""Limit from which there is none."""
TURNING = ("revolute", "continuous")
"""Types of joints in SDF that turn."""
MODEL = "__model__"
"""SDF's name of the frame of a model."""
SIZES = ("size", "radii", "radius", "length")
"""Sizes of shapes in SDF, in MuJoCo's order."""
SENSORS = {"camera": "camera|realsense|depth|rgbd|oakd", "lidar": "lidar|laser|scan|ray"}
"""Parts of the names of sensors' links, and of their types in SDF."""


class Shape(NamedTuple):
    """A shape of a part, in the model's frame."""

    kind: str
    """A value of `SHAPES`."""
    size: Floats
    """MuJoCo's: half lengths of a box; radius, and half length about z [m]."""
    centre: Floats
    rotation: Floats
    """(3, 3)."""

    @property
    def reach(self) -> Floats:
        """Half lengths (3,) of the box in the model's axes that encloses the shape [m]."""
        radius, half = self.size[0], self.size[1]
        along = {"sphere": radius, "capsule": radius + half, "cylinder": half}.get(self.kind)
        halves = self.size if along is None else np.array((radius, radius, along))
        return np.asarray((abs(self.rotation) * halves).sum(axis=1))


class Part(NamedTuple):
    """A link or body, in the model's frame with all joints at zero."""

    name: str
    parent: str
    """Empty for a root."""
    place: Floats
    rotation: Floats
    mass: float
    shapes: tuple[Shape, ...]
    joint: str = ""
    effort: float | None = None
    """Limit of the joint [N·m]; None: unlimited, or not in the file."""
    speed: float | None = None
    """Limit of the joint [rad/s]."""
    axis: Floats | None = None
    """Axis of a joint that turns."""
    damping: float = 0.0

    @property
    def axle(self) -> Floats | None:
        """The axis of a wheel's joint, or else of its cylinder."""
        axes = [shape.rotation[:, 2] for shape in self.shapes if shape.kind == "cylinder"]
        return self.axis if self.axis is not None or not axes else axes[0]

    @property
    def middle(self) -> Floats:
        """Centre of a roller's first shape, or else of its frame."""
        return self.shapes[0].centre if self.shapes else self.place

    @property
    def thickness(self) -> float:
        """Largest radius of a roller [m]."""
        flat = ("ellipsoid", "box")
        radii = [min(s.size) if s.kind in flat else s.size[0] for s in self.shapes]
        return float(max(radii, default=0.0))


class Description(NamedTuple):
    """A robot, and what its file says about its drive."""

    name: str
    parts: Mapping[str, Part]
    sensors: Mapping[str, tuple[str, Floats]]
    """Types of declared sensors, and their positions in their link [m], by link."""
    plugin: Mapping[str, Any]
    """Settings of gz-sim's MecanumDrive, if it is in the file."""

    def above(self, part: Part) -> list[str]:
        """Return the names of the parts between `part` and the root, its parent first."""
        names: list[str] = []
        while part.parent in self.parts and part.parent not in names:
            names.append(part.parent)
            part = self.parts[part.parent]
        return names

    @property
    def base(self) -> Part:
        """The link base_link, or else the root: of SDF the frame of the model."""
        root = next(part for part in self.parts.values() if part.parent not in self.parts)
        return self.parts.get("base_link", root)

    def wheels(self) -> list[Part]:
        """Return parts called wheel, of these the turning ones, or else all that turn.

        Parts on such parts are left out.
        """
        turning = [part for part in self.parts.values() if part.axis is not None]
        called = [p for p in self.parts.values() if "wheel" in f"{p.name} {p.joint}".lower()]
        candidates = [part for part in called if part.axis is not None] or called or turning
        names = {part.name for part in candidates}
        return [part for part in candidates if not names.intersection(self.above(part))]

    def rollers(self, wheel: Part, along: float) -> list[Part]:
        """Return the parts on a wheel that turn about another axis; `along` is a cosine."""
        return [
            part
            for part in self.parts.values()
            if wheel.name in self.above(part) and part.axis is not None and wheel.axle is not None
            if abs(float(part.axis @ wheel.axle)) < along
        ]

    def body(self, wheels: Iterable[Part]) -> list[Part]:
        """Return all parts but the wheels and what is on them."""
        names = {wheel.name for wheel in wheels}
        return [p for p in self.parts.values() if not names & {p.name, *self.above(p)}]

    def sensor(self, kind: str, wheels: Iterable[Part]) -> Part | None:
        """Return the link of a sensor of a kind of `SENSORS`: declared, or by its name."""
        links = [
            (link not in self.sensors, not part.shapes, link)
            for part in self.body(wheels)
            for link in [part.name]
            if re.search(SENSORS[kind], self.sensors.get(link, (link,))[0].lower())
            if "optical" not in link
        ]
        return self.parts[min(links)[2]] if links else None


def read_description(path: Path, arguments: Mapping[str, str]) -> Description:
    """Return the robot of a URDF, xacro, SDF or MJCF file; `arguments` are for xacro.

    Raises:
        ConfigError: One line with the file and what is wrong with it.
        MecazenError: A library is missing.
    """
    text = read_text(path)
    if path.suffix == ".xacro":
        text = _expanded(path, arguments)
    elif "<xacro:" in text:
        raise ConfigError(f"{path}: has xacro's macros: name it {path.stem}.xacro")
    try:
        root = ET.fromstring(text)  # noqa: S314 - expat limits the expansion of entities
        if root.tag not in ("robot", "sdf", "mujoco"):
            raise ValueError(f"<{root.tag}>: allowed: <robot> (URDF), <sdf>, <mujoco> (MJCF)")  # noqa: TRY301
        # a world has others, such as the ground
        models = [*root.iter("model")] or [root]
        model = max(models, key=lambda model: len(model.findall("joint")))
        parts = _parts(path, root, model)
        sensors = {
            place.get("reference") or place.get("name") or "": (
                sensor.get("type") or "camera",
                np.array(
                    (sensor.get("pos") or sensor.findtext("pose") or "0 0 0").split()[:3], float
                ),
            )
            for place in root.iter()
            if place.tag in ("link", "gazebo", "body")
            for sensor in [*place.findall("sensor"), *place.findall("camera")]
        }
    except (ET.ParseError, ValueError) as error:
        what = "not XML: " if isinstance(error, ET.ParseError) else ""
        raise ConfigError(printable(f"{path}: {what}{' '.join(str(error).split())}")) from None
    plugins = [
        {setting.tag: (setting.text or "").strip() for setting in plugin}
        for plugin in root.iter("plugin")
        if "mecanum" in f"{plugin.get('filename')} {plugin.get('name')}".lower()
    ]
    name = model.get("name") or model.get("model") or path.name.partition(".")[0]
    return Description(name, parts, sensors, plugins[0] if plugins else {})


def _expanded(path: Path, arguments: Mapping[str, str]) -> str:
    """Return the URDF of a xacro file."""
    try:
        import xacro  # noqa: PLC0415  # an extra
        from xacrodoc import packages  # noqa: PLC0415  # for $(find …) without ROS
    except ImportError:
        raise MecazenError("xacro files need xacrodoc: pip install 'mecazen[robots]'") from None
    packages.walk_up_from(path)
    try:
        return str(xacro.process_file(str(path), mappings=dict(arguments)).toxml())
    except (xacro.XacroException, ET.ParseError, ValueError, NameError, OSError) as error:
        problem = " ".join(str(error).split())
        raise ConfigError(printable(f"{path}: xacro: {problem or type(error).__name__}")) from None


def _joints(model: ET.Element) -> dict[str, dict[str, Any]]:
    """Return what the joints of a URDF, or of a model of SDF, say about each child's `Part`."""

    def limit(joint: ET.Element, name: str) -> float | None:
        urdf = joint.find("limit")
        sdf = joint.findtext(f"axis/limit/{name}", "0")
        value = float(sdf if urdf is None else urdf.get(name, "0"))
        return value if 0.0 < value < NO_LIMIT else None

    joints: dict[str, dict[str, Any]] = {}
    for joint in model.findall("joint"):
        ends = [joint.find(tag) for tag in ("child", "parent")]
        child, parent = ("" if end is None else end.get("link") or end.text or "" for end in ends)
        joints[child] = {
            "joint": joint.get("name", ""),
            "parent": parent,
            "effort": limit(joint, "effort"),
            "speed": limit(joint, "velocity"),
        }
        xyz = joint.find("axis/xyz")
        if xyz is not None and xyz.get("expressed_in") == MODEL and joint.get("type") in TURNING:
            joints[child]["axis"] = np.array((xyz.text or "").split(), float)
    return joints


def _mjcf(model: ET.Element) -> str:
    """Return an SDF model as MJCF: its links and frames as bodies, in the frames of their poses."""
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian", eulerseq="XYZ")  # about fixed axes
    frame = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name=MODEL)
    places = {
        place.get("name", ""): place for tag in ("link", "frame") for place in model.findall(tag)
    }
    bodies = {name: _pose("body", place) for name, place in places.items()}
    for name, body in bodies.items():
        place, pose = places[name], places[name].find("pose")
        body.set("name", name)
        above = None if pose is None else pose.get("relative_to")
        bodies.get(above or place.get("attached_to") or MODEL, frame).append(body)
        if (inertial := place.find("inertial")) is not None:
            body.append(_pose("inertial", inertial))
            inertia = f"{TINY} {TINY} {TINY}"
            body[-1].attrib |= {"mass": inertial.findtext("mass", "0"), "diaginertia": inertia}
        for part in [*place.findall("collision"), *place.findall("visual")]:
            geometry = part.find("geometry/*")
            if geometry is None or geometry.tag not in SHAPES.values():
                continue
            sizes = {size.tag: np.array((size.text or "").split(), float) for size in geometry}
            for halved in ("size", "length"):
                if halved in sizes:
                    sizes[halved] /= 2
            body.append(_pose("geom", part))
            numbers = np.concatenate([sizes[tag] for tag in SIZES if tag in sizes])
            body[-1].attrib |= {"type": geometry.tag, "size": " ".join(map(str, numbers))}
    for joint in model.findall("joint"):
        child, axis = bodies.get(joint.findtext("child", "")), joint.findtext("axis/xyz", "0 0 1")
        if child is not None and joint.get("type") in TURNING:
            ET.SubElement(child, "joint", axis=axis)
    return ET.tostring(root, encoding="unicode")


def _pose(tag: str, element: ET.Element) -> ET.Element:
    """Return an element of MJCF at the pose of an element of SDF."""
    pose = element.find("pose")
    text = "" if pose is None else pose.text or ""
    x, y, z, *angles = [float(word) for word in text.split()] or [0.0] * 6
    if pose is not None and pose.get("degrees") == "true":
        angles = [math.radians(angle) for angle in angles]
    return ET.Element(tag, pos=f"{x} {y} {z}", euler=" ".join(map(str, angles)))


def _parts(path: Path, root: ET.Element, model: ET.Element) -> dict[str, Part]:
    """Return the parts of a file; raises ValueError as MuJoCo does."""
    import mujoco  # noqa: PLC0415  # takes a while

    is_mjcf = root.tag == "mujoco"
    if is_mjcf:
        spec, joints = mujoco.MjSpec.from_file(str(path)), {}
    elif root.tag == "sdf":
        spec, joints = mujoco.MjSpec.from_string(_mjcf(model)), _joints(model)
    else:
        joints = _joints(root)
        for extension in root.findall("mujoco"):
            root.remove(extension)
        ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", discardvisual="false")
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.compiler.fusestatic, spec.compiler.balanceinertia = False, True
    spec.compiler.boundmass = spec.compiler.boundinertia = TINY
    if not is_mjcf:  # a link without a mass has none
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for geom in list(spec.geoms):
        geom.material = ""
        if int(geom.type) not in SHAPES:
            spec.delete(geom)
    for elements in (spec.meshes, spec.materials, spec.textures, spec.hfields, spec.keys):
        for element in list(elements):
            spec.delete(element)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)

    names = [compiled.body(index).name or f"body {index}" for index in range(compiled.nbody)]
    hinges = {
        int(body): {"joint": compiled.joint(joint).name or names[body], **_hinge(data, joint)}
        for joint, body in enumerate(compiled.jnt_bodyid)
        if compiled.jnt_type[joint] == HINGE
    }
    shapes: dict[int, list[Shape]] = {}
    for geom, (kind, body) in enumerate(zip(compiled.geom_type, compiled.geom_bodyid, strict=True)):
        pose = data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3).copy()
        shape = Shape(SHAPES[int(kind)], compiled.geom_size[geom].copy(), *pose)
        shapes.setdefault(int(body), []).append(shape)
    parts = {}
    for index, name in enumerate(names[1:], 1):
        parent, mass = int(compiled.body_parentid[index]), float(compiled.body_mass[index])
        # URDF and SDF say more about joints than MuJoCo reads
        joint: dict[str, Any] = {"parent": names[parent] if parent else ""}
        joint |= hinges.get(index, {}) | joints.get(name, {})
        parts[name] = Part(
            name,
            place=data.xpos[index].copy(),
            rotation=data.xmat[index].reshape(3, 3).copy(),
            mass=mass if mass > TINY else 0.0,
            shapes=tuple(shapes.get(index, ())),
            **joint,
        )
    return parts


def _hinge(data: Any, joint: int) -> dict[str, Any]:
    """Return axis, damping and limits of a joint that turns."""
    model = data.model
    effort, speed = model.jnt_actfrcrange[joint][1], 0.0
    for index in range(model.nu):
        if model.actuator_trnid[index][0] == joint:
            gear, highest = abs(model.actuator_gear[index][0]), model.actuator_ctrlrange[index][1]
            effort = effort or model.actuator_forcerange[index][1] * gear
            if model.actuator_biastype[index]:  # a servo
                speed = highest
            else:
                effort = effort or highest * gear * model.actuator_gainprm[index][0]
    return {
        "axis": data.xaxis[joint].copy(),
        "damping": float(model.dof_damping[model.jnt_dofadr[joint]]),
        "effort": float(effort) or None,
        "speed": float(speed) or None,
    }
