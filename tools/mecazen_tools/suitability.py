"""Checks at load: can the robot see its person from its place, and keep up with them?"""

from __future__ import annotations

from collections.abc import Iterator

from mecazen.config import Scenario
from mecazen.config.people import SteadyWalk
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Standoff
from mecazen.messages import Unseen
from mecazen.robot import CameraMount
from mecazen.view import out_of_view
from mecazen_people.body.posture import Segments
from mecazen_people.body.recording import height_of
from msgspec.structs import replace

PITCHES_DEG = range(61)
STANDOFFS_M = [0.1 * step for step in range(5, 51)]
"""The values among which the smallest suitable one is looked for."""


def warnings(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each thing that a robot with a follower can't do with its person."""
    for name in scenario.names if "follower" in scenario.services else ():
        part, begin = scenario.of(name), f"{name}: " if name else ""
        drive = Drive.from_scenario(part)
        highest_m_s = max(axis.velocity for axis in drive.axes[:2])
        speed_m_s = min(drive.rim_speed / min(drive.sideways, 1.0), highest_m_s)
        if isinstance(path := part.target.path, SteadyWalk) and path.speed_m_s > speed_m_s:
            problem = f"the person is faster than the robot, which reaches {speed_m_s:.2f} m/s"
            yield f"{begin}target.path.speed_m_s = {path.speed_m_s:g}: {problem}"
        mount, standoff = part.robot.camera, part.follower.standoff
        if mount is None or "tracker" not in part.sensor.features:
            continue
        if not (why := _unseen(part, mount, standoff)):
            continue
        pitches = [
            p for p in PITCHES_DEG if not _unseen(part, replace(mount, pitch_deg=p), standoff)
        ]
        places = [d for d in STANDOFFS_M if not _unseen(part, mount, standoff._replace(distance=d))]
        remedies = [f"robot.camera.pitch_deg = {pitch}" for pitch in pitches[:1]]
        remedies += [f"follower.standoff_m = {distance:g}" for distance in places[:1]]
        end = f"; that takes {' or '.join(remedies)}" if remedies else ""
        yield f"{begin}follower.standoff_m = {standoff.distance:g}: {why}{end}"


def _unseen(part: Scenario, mount: CameraMount, standoff: Standoff) -> Unseen | None:
    """Return why a camera on a robot at its place does not see the pelvis and both shoulders."""
    body, person = Segments.from_height(height_of(part.target.body)), standoff.person(Pose2D())
    shoulder_m = body.standing + body.trunk
    for aside, height in ((0.0, body.standing), (0.5, shoulder_m), (-0.5, shoulder_m)):
        x, y, _ = person.compose(Pose2D(0.0, aside * body.shoulders))
        point = [a - b for a, b in zip((x, y, height), mount.position_m, strict=True)]
        if reason := out_of_view(mount, part.sensors.tracker, point):
            return reason
    return None
