"""Reports of an identification and of a validation in Markdown, and the robot file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec
import tomli_w
from mecazen.robot import Robot
from mecazen.rollers import lateral_gain
from mecazen_tools.statistics import Interval

from mecazen_experiments.identify.identification import ROLLER_COUNTS, Identification
from mecazen_experiments.identify.validate import HORIZON_S


def robot_file(robot: Robot, result: Identification) -> str:
    """Return an identified robot as a robot file."""
    tables = {k: v for k, v in msgspec.to_builtins(robot).items() if v is not None}
    return (
        f"# Identified by `mecazen identify` from {result.runs} runs; all other values are those "
        f"of {result.robot}.\n{tomli_w.dumps(tables)}"
    )


def identification_lines(result: Identification) -> Iterator[str]:
    """Yield the report of an identification as Markdown."""
    yield f"# Identification of {result.robot}\n"
    yield (
        f"{result.runs} runs of {result.sessions} sessions, {result.duration_s / 60.0:.0f} "
        f"min. The reference's clock is {interval(result.offset_s, '.5g', 1e3)} ms ahead of the "
        "wheels'.\n"
    )
    yield from (f"- {note}" for note in result.notes)
    yield "\n## Kinematics\n"
    yield from _table(
        ("parameter, with the 95 % interval", *(fitted.model.name for fitted in result.fits)),
        (
            [name, *(_cell(parameters, name) for parameters in result.parameters)]
            for name in result.parameters[-1]
        ),
    )
    gains = ", ".join(f"{lateral_gain(count):.4f} (N = {count})" for count in ROLLER_COUNTS)
    yield (
        f"\nIntervals are over sessions, or over blocks of a single session. Wheels of N rollers "
        f"have the lateral gain {gains}. Slip, or rollers that give way, would look like fewer "
        "rollers."
    )
    if result.motors:
        yield "\n## Motors\n"
        yield from _table(
            ("parameter", "value, 95 % interval by the curvature"),
            ([name, interval(value, ".5g")] for name, value in result.motors.items()),
        )


def validation_lines(
    result: Identification, drifts: Mapping[tuple[str, str], Sequence[Interval]]
) -> Iterator[str]:
    """Yield the report of a validation as Markdown; `drifts` are those of `validate`."""
    yield "# Validation\n"
    yield (
        f"Fitted on {result.sessions} sessions, validated on the others. "
        f"Drift after {HORIZON_S:g} s: median (95 % interval over sessions; of two, half of their "
        "difference on both sides), 95th percentile.\n"
    )
    yield from _table(
        ("model", "path", "position [mm]", "yaw [mrad]"),
        ([*names, _drift(*drift[:2]), _drift(*drift[2:])] for names, drift in drifts.items()),
    )


def interval(value: Interval, form: str, scale: float = 1.0) -> str:
    """Return a value with its interval, or with both values of two; a single one has none."""
    mean, low, high = (f"{scale * each:{form}}" for each in (value.mean, *value.ends))
    return mean if value.n == 1 else f"{mean} ({low}{', ' if value.n == 2 else ' to '}{high})"


def _cell(parameters: Mapping[str, Interval], name: str) -> str:
    return interval(parameters[name], ".5g") if name in parameters else ""


def _drift(median: Interval, p95: Interval) -> str:
    return f"{interval(median, '.1f', 1e3)}, {1e3 * p95.mean:.1f}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    for row in (header, ["---"] * len(header), *rows):
        yield f"| {' | '.join(row)} |"
