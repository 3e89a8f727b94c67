"""Sketches of the documents as SVG: the data flow, a tick, and the definitions of a standoff."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape

INK, PALE, TOPIC, WANTED, LEFT = "#16202a", "#5b6875", "#0b5394", "#1b7f4b", "#b3541e"
Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, width and height [px]."""

FLOW_BOXES: dict[str, Box] = {
    "target": (20, 60, 120, 46),
    "sensors": (270, 60, 120, 46),
    "follower": (555, 60, 120, 46),
    "guard": (765, 60, 120, 46),
    "physics": (20, 190, 370, 46),
    "controller": (555, 190, 330, 46),
    "viewer, recorder": (20, 275, 865, 40),
}
FLOW: tuple[tuple[str, str, tuple[str, ...], tuple[Point, ...]], ...] = (
    ("physics", "target", ("ground_truth/odom",), ((80, 190), (80, 106))),
    ("physics", "sensors", ("ground_truth/odom",), ((330, 190), (330, 106))),
    ("target", "sensors", ("target/skeleton",), ((140, 83), (270, 83))),
    ("sensors", "follower", ("skeleton/observation", "scan"), ((390, 83), (555, 83))),
    ("sensors", "guard", ("scan",), ((330, 60), (330, 26), (825, 26), (825, 60))),
    ("follower", "guard", ("cmd_vel",), ((675, 83), (765, 83))),
    ("guard", "controller", ("guard/cmd_vel",), ((825, 106), (825, 190))),
    ("controller", "follower", ("odom",), ((615, 190), (615, 106))),
    ("physics", "controller", ("joint_states",), ((390, 203), (555, 203))),
    ("controller", "physics", ("joint_command",), ((555, 226), (390, 226))),
)
"""Arrows between services: their topics, and their corners."""

TICK_LANES = {"physics": 60.0, "target": 125.0, "follower": 190.0, "controller": 255.0}
TICK_STEPS: dict[str, tuple[str, float, str]] = {
    "physics": ("physics", 135, "world of tick k"),
    "target": ("target", 340, "person, frame"),
    "odometry": ("controller", 340, "odometry"),
    "follower": ("follower", 535, "estimate, goal"),
    "controller": ("controller", 720, "wheel speeds"),
    "advance": ("physics", 880, "next world"),
}
"""Steps of a tick: the lane, the left edge [px] and the words of each."""
TICK: tuple[tuple[str, str, str], ...] = (
    ("physics", "target", "ground_truth/odom"),
    ("physics", "odometry", "joint_states"),
    ("target", "follower", "target/observation"),
    ("odometry", "follower", "odom"),
    ("follower", "controller", "cmd_vel"),
    ("controller", "advance", "joint_command"),
)


def flow() -> str:
    """Return the data flow between services of a robot with sensors and guard."""
    return _svg(905, 335, _flow())


def _flow() -> Iterator[str]:
    for name, box in FLOW_BOXES.items():
        observers = name == "viewer, recorder"
        words = f"{name}: take every topic, delay none" if observers else name
        yield _box(box, words, dashed=observers)
    for _, _, topics, corners in FLOW:
        yield _arrow(*corners, colour=TOPIC)
        (x0, y0), (x1, y1) = corners[(len(corners) - 1) // 2 :][:2]
        for line, topic in enumerate(topics):
            if x0 == x1:
                side = -6 if x0 > 800 else 6
                at, anchor = (x0 + side, (y0 + y1) / 2 + 5), "end" if side < 0 else "start"
            else:
                at, anchor = ((x0 + x1) / 2, y0 - 7 - 15 * line), "middle"
            yield _text(at, topic, TOPIC, mono=True, size=12, anchor=anchor)


def tick() -> str:
    """Return the steps of a tick from left to right, in a lane for each service."""
    return _svg(1040, 300, _tick())


def _tick() -> Iterator[str]:
    for name, y in TICK_LANES.items():
        yield f'<path d="M110 {y} H1030" stroke="#dfe4ea" stroke-width="1.5"/>'
        yield _text((100, y + 5), name, INK, bold=True, anchor="end")
    for x, words in ((118.0, "tick k is due"), (1025.0, "tick k + 1 is due")):
        yield f'<path d="M{x} 28 V285" stroke="{PALE}" stroke-dasharray="4 4"/>'
        yield _text((x, 20), words, PALE, anchor="start" if x < 500 else "end")
    for source, sink, topic in TICK:
        (lane, left, _), (other, right, _) = TICK_STEPS[source], TICK_STEPS[sink]
        begin, end = (left + 125, TICK_LANES[lane]), (right, TICK_LANES[other])
        yield _arrow(begin, end, colour=TOPIC)
        share = 0.7 if source == "physics" else 0.5
        middle = (begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1]))
        yield _text((middle[0], middle[1] + 4), topic, TOPIC, mono=True, size=12)
    for lane, left, words in TICK_STEPS.values():
        yield _box((left, TICK_LANES[lane] - 18, 125, 36), words)


def standoff() -> str:
    """Return frames, standoff, bearing, heading, D and Θ, seen from above."""
    return _svg(760, 275, _standoff())


def _standoff() -> Iterator[str]:
    person, heading, bearing, wanted_m = (520.0, 205.0), 12.0, 138.0, 220.0
    place = _polar(person, heading + bearing, wanted_m)
    robot, robot_heading = _polar(person, heading + 153, 330.0), -28.0
    yield f'<path d="{_line(person, place)}" stroke="{WANTED}" stroke-dasharray="6 4"/>'
    yield f'<path d="{_line(person, robot)}" stroke="{LEFT}" stroke-width="1.5"/>'
    yield _rectangle(place, heading + bearing + 180, WANTED, dashed=True)
    yield _rectangle(robot, robot_heading, INK)
    yield f'<circle cx="{person[0]:.1f}" cy="{person[1]:.1f}" r="15" fill="#fff" stroke="{INK}"/>'
    yield _arrow(person, _polar(person, heading, 120), colour=INK)
    yield _arrow(robot, _polar(robot, robot_heading, 95), colour=INK)
    parallel = _polar(robot, heading, 110)
    yield f'<path d="{_line(robot, parallel)}" stroke="{PALE}" stroke-dasharray="4 4"/>'
    yield _arc(person, heading, heading + bearing, 55, WANTED)
    yield _arc(robot, heading, robot_heading, 75, LEFT)
    yield _arrow(robot, _polar(robot, robot_heading + 90, 60), colour=PALE)
    yield _arrow((60, 235), (140, 235), colour=PALE)
    yield _arrow((60, 235), (60, 170), colour=PALE)
    yield _text((150, 240), "x", PALE)
    yield _text((60, 162), "y", PALE)
    yield _text((100, 257), "odom", PALE, mono=True)
    yield _text(_polar(robot, robot_heading, 107), "x", INK)
    yield _text(_polar(robot, robot_heading + 90, 70), "y", PALE)
    yield _text((robot[0] - 40, robot[1] + 5), "robot", INK, bold=True, anchor="end")
    yield _text((robot[0] - 40, robot[1] + 22), "base_link", PALE, mono=True, anchor="end")
    yield _text((person[0] + 4, person[1] + 36), "person", INK, bold=True)
    x, y = _polar(person, heading, 130)
    yield _text((x, y + 4), "heading", INK, anchor="start")
    yield _text((place[0] + 10, place[1] - 40), "goal: the standoff", WANTED, bold=True)
    x, y = _polar(person, heading + bearing, 130)
    yield _text((x + 14, y - 8), "D₀", WANTED, bold=True)
    x, y = _polar(person, heading + 153, 190)
    yield _text((x, y + 20), "D", LEFT, bold=True)
    x, y = _polar(person, heading + bearing / 2, 62)
    yield _text((x + 4, y - 4), "bearing", WANTED, anchor="start")
    x, y = _polar(robot, (heading + robot_heading) / 2, 86)
    yield _text((x, y + 5), "Θ", LEFT, bold=True, anchor="start")


SKETCHES = {"flow": flow, "tick": tick, "standoff": standoff}
"""The functions that draw the sketches, by the names of the files."""


def _svg(width: int, height: int, parts: Iterator[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="14" fill="none">'
    )
    tips = "".join(
        f'<marker id="tip{colour[1:]}" markerWidth="9" markerHeight="9" refX="8.5" refY="4.5" '
        f'orient="auto" markerUnits="userSpaceOnUse"><path d="M0 0 L9 4.5 L0 9 z" fill="{colour}"/>'
        "</marker>"
        for colour in (INK, PALE, TOPIC)
    )
    ground = f'<rect width="{width}" height="{height}" rx="10" fill="#f7f8fa"/>'
    return "\n".join((head, f"<defs>{tips}</defs>", ground, *parts, "</svg>", ""))


def _box(box: Box, words: str, *, dashed: bool = False) -> str:
    x, y, width, height = box
    dashes = ' stroke-dasharray="5 4"' if dashed else ""
    shape = (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="#e8eef5" '
        f'stroke="{PALE}"{dashes}/>'
    )
    return shape + _text((x + width / 2, y + height / 2 + 5), words, INK)


def _text(
    at: Point,
    words: str,
    colour: str,
    *,
    bold: bool = False,
    mono: bool = False,
    size: int = 14,
    anchor: str = "middle",
) -> str:
    """Return words with a halo, so that they can be read on a line."""
    style = ' font-weight="bold"' if bold else ""
    style += ' font-family="monospace"' if mono else ""
    style += f' font-size="{size}"' if size != 14 else ""
    halo = "" if bold else ' stroke="#f7f8fa" stroke-width="4" paint-order="stroke"'
    place = f'x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}"'
    return f'<text {place} fill="{colour}"{halo}{style}>{escape(words)}</text>'


def _polar(centre: Point, angle_deg: float, radius: float) -> Point:
    """Return a point around another one; angles are counter-clockwise, y of the page is down."""
    angle = math.radians(angle_deg)
    return centre[0] + radius * math.cos(angle), centre[1] - radius * math.sin(angle)


def _line(*corners: Point) -> str:
    return "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in corners)


def _arrow(*corners: Point, colour: str) -> str:
    style = f'stroke="{colour}" stroke-width="1.5" marker-end="url(#tip{colour[1:]})"'
    return f'<path d="{_line(*corners)}" {style}/>'


def _arc(centre: Point, begin_deg: float, end_deg: float, radius: float, colour: str) -> str:
    (x0, y0), (x1, y1) = (_polar(centre, angle, radius) for angle in (begin_deg, end_deg))
    sweep = int(end_deg < begin_deg)
    arc = f"M{x0:.1f} {y0:.1f} A{radius} {radius} 0 0 {sweep} {x1:.1f} {y1:.1f}"
    return f'<path d="{arc}" stroke="{colour}" stroke-width="1.5"/>'


def _rectangle(centre: Point, heading_deg: float, colour: str, *, dashed: bool = False) -> str:
    """Return a robot's outline, with a line at its front."""
    x, y = centre
    style = 'fill="none" stroke-dasharray="5 4"' if dashed else 'fill="#fff"'
    return (
        f'<g transform="translate({x:.1f} {y:.1f}) rotate({-heading_deg:.1f})">'
        f'<rect x="-30" y="-22" width="60" height="44" rx="4" stroke="{colour}" {style}/>'
        f'<path d="M22 -16 V16" stroke="{colour}" stroke-width="2"/></g>'
    )
