"""Checks at load: can the robot see its person from its place, and keep up with them?"""

from __future__ import annotations

from collections.abc import Iterator

from mecazen.config import Scenario
from mecazen.config.follower import PolarControl
from mecazen.config.people import SteadyWalk
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Standoff
from mecazen.messages import Unseen
from mecazen.robot import CameraMount
from mecazen.view import out_of_view
from mecazen_people.body.posture import Segments
from msgspec.structs import replace

PITCHES_DEG = range(-60, 61)
STANDOFFS_M = [0.1 * step for step in range(5, 51)]
"""The values among which a suitable one is looked for."""


def warnings(scenario: Scenario) -> list[str]:
    """Return a line for each thing that a robot with a follower can't do with its person."""
    names = scenario.names if "follower" in scenario.services else ()
    return [
        f"{name}: {line}" if name else line
        for name in names
        for part in [scenario.of(name)]
        for line in (*_of_sight(part), *_of_speed(part))
    ]


def _of_sight(part: Scenario) -> Iterator[str]:
    standoff, mount = part.follower.standoff, part.robot.camera
    begin = f"follower.standoff_m = {standoff.distance:g}: "
    if part.sensor.kind in ("pose", "legs"):
        device = part.sensor if part.sensor.kind == "pose" else part.sensors.lidar
        if standoff.distance > device.max_range_m:
            yield f"{begin}the person is out of the sensor's range, {device.max_range_m:g} m"
        return
    reason = _unseen(part, mount, standoff)
    if reason is None:
        return
    settings: dict[str, tuple[float, list[float]]] = {
        "robot.camera.pitch_deg": (
            mount.pitch_deg,
            [p for p in PITCHES_DEG if not _unseen(part, replace(mount, pitch_deg=p), standoff)],
        ),
        "follower.standoff_m": (
            standoff.distance,
            [d for d in STANDOFFS_M if not _unseen(part, mount, standoff._replace(distance=d))],
        ),
    }
    remedies = [
        f"{key} = {min(values, key=lambda value: abs(value - present)):g}"
        for key, (present, values) in settings.items()
        if values
    ]
    yield f"{begin}{reason}" + ("; that takes " if remedies else "") + " or ".join(remedies)


def _unseen(part: Scenario, mount: CameraMount, standoff: Standoff) -> Unseen | None:
    """Return why a camera on a robot at its place does not see the pelvis and both shoulders."""
    body, person = Segments.from_height(part.target.body.height_m), standoff.person(Pose2D())
    shoulder_m = body.standing + body.trunk
    for aside, height in ((0.0, body.standing), (0.5, shoulder_m), (-0.5, shoulder_m)):
        x, y, _ = person.compose(Pose2D(0.0, aside * body.shoulders))
        point = (a - b for a, b in zip((x, y, height), mount.position_m, strict=True))
        if reason := out_of_view(mount, part.sensors.tracker, tuple(point)):
            return reason
    return None


def _of_speed(part: Scenario) -> Iterator[str]:
    path, control, drive = part.target.path, part.follower.control, Drive.from_scenario(part)
    x, y, _ = drive.axes
    if isinstance(control, PolarControl):
        commanded = control.max_speed_m_s
    else:
        commanded = max(control.x.limit, control.y.limit)
    speeds = {
        "robot.wheels": drive.rim_speed / min(drive.sideways, 1.0),
        "controller.limits": max(x.velocity, y.velocity),
        "follower.control": commanded,
    }
    slowest = min(speeds, key=lambda name: speeds[name])
    if isinstance(path, SteadyWalk) and path.speed_m_s > speeds[slowest]:
        yield (
            f"target.path.speed_m_s = {path.speed_m_s:g}: the person is faster than the robot: "
            f"{slowest} allows {speeds[slowest]:.2f} m/s"
        )
