"""Reports of an identification and of a validation in Markdown, and the robot file."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import tomli_w
from mecazen.robot import Robot
from mecazen.rollers import lateral_gain
from mecazen_tools.statistics import Interval

from mecazen_experiments.identify.identification import Identification
from mecazen_experiments.identify.validate import HORIZON_S, Validation


def robot_file(robot: Robot, result: Identification) -> str:
    """Return an identified robot as a robot file."""
    tables = {k: v for k, v in msgspec.to_builtins(robot).items() if v is not None}
    return (
        f"# Identified by `mecazen identify` from {result.runs} runs; masses, heights and motors "
        f"are those of {result.robot}.\n{tomli_w.dumps(tables)}"
    )


def identification_lines(result: Identification) -> Iterator[str]:
    """Yield the report of an identification as Markdown."""
    yield f"# Identification of {result.robot}\n"
    yield (
        f"{result.runs} runs of {len(result.sessions)} sessions, {result.duration_s / 60.0:.0f} "
        f"min. The reference's clock is {interval(result.offset_s, '.5g', 1e3)} ms ahead of the "
        "wheels'.\n"
    )
    yield from (f"- {note}" for note in result.notes)
    yield "\n## Rollers\n"
    yield (
        "The lateral gain is all that the number of rollers changes in these data. So each N is a "
        "hypothesis that rollers alone cause it: slip, or rollers that give way, would look like "
        "fewer rollers.\n"
    )
    yield "| N | sin(π/N)/(π/N) | log-likelihood behind the best (95 % interval over sessions) |"
    yield "| --- | --- | --- |"
    for count, behind in result.rollers.items():
        yield f"| {count} | {lateral_gain(count):.4f} | {interval(behind, '.0f')} |"
    yield (
        f"\nLateral over forward gain: {interval(result.lateral_gain, '.4f')}, with the 95 % "
        "interval over sessions. That of a single session is over blocks of windows.\n"
    )
    yield "| session | runs | lateral over forward gain | time without a log of the wheels |"
    yield "| --- | --- | --- | --- |"
    for session in result.sessions:
        gain = interval(session.lateral_gain, ".4f")
        yield f"| {session.session} | {session.runs} | {gain} | {session.missing:.1%} |"
    if result.motors:
        yield "\n## Motors\n"
        yield "| parameter | value, 95 % interval by the curvature |"
        yield "| --- | --- |"
        yield from (
            f"| {name} | {interval(value, '.5g')} |" for name, value in result.motors.items()
        )
    for name, model in result.models.items():
        yield f"\n## Parameters: {name}\n"
        yield "| parameter | value, 95 % interval over sessions |"
        yield "| --- | --- |"
        for parameter, estimate in model.parameters.items():
            yield f"| {parameter} | {interval(estimate, '.5g')} |"
        yield from (f"\n- {line}" for line in model.ambiguities)


def validation_lines(result: Validation) -> Iterator[str]:
    """Yield the report of a validation as Markdown."""
    yield "# Validation\n"
    yield (
        f"Fitted on {len(result.fitted)} sessions, validated on {len(result.held_out)} others. "
        f"Drift after {HORIZON_S:g} s: median (95 % interval "
        "over sessions; of two, half of their difference on both sides), 95th percentile.\n"
    )
    yield "| model | path | position [mm] | yaw [mrad] |"
    yield "| --- | --- | --- | --- |"
    for (model, path), drift in result.drifts.items():
        cells = (
            f"{interval(median, '.1f', 1e3)}, {1e3 * p95.mean:.1f}"
            for median, p95 in (drift[:2], drift[2:])
        )
        yield f"| {model} | {path} | {' | '.join(cells)} |"


def interval(value: Interval, form: str, scale: float = 1.0) -> str:
    """Return a value with its interval, or with both values of two; a single one has none."""
    mean, low, high = (f"{scale * each:{form}}" for each in (value.mean, *value.ends))
    return mean if value.n == 1 else f"{mean} ({low}{', ' if value.n == 2 else ' to '}{high})"
