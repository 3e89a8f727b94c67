"""Reports of an identification and of a validation: Markdown, JSON, figures and the robot file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
import tomli_w
from matplotlib import style
from matplotlib.figure import Figure
from mecazen.robot import Robot
from mecazen_tools import files
from mecazen_tools.drawing import BLUE, COLUMN_IN, DASHES, ORANGE, PALETTE, STYLE, save

from mecazen_experiments.identify.identification import (
    Identification,
    SessionResult,
    mean_gain,
)
from mecazen_experiments.identify.models import ROLLER_COUNTS, Estimate, rollers_gain
from mecazen_experiments.identify.validate import HORIZON_S, Validation
from mecazen_experiments.statistics import Interval


def write(
    report: Path,
    lines: Iterable[str],
    sessions: Sequence[SessionResult],
    result: Identification,
    robot: Robot,
) -> list[Path]:
    """Write a report with the lateral gain of sessions, and the identified robot beside it.

    Returns:
        The files: the report in Markdown, lateral_gain.png, identification.json and robot.toml.
    """
    names = "lateral_gain.png", "identification.json", "robot.toml"
    picture, values, model = (report.with_name(name) for name in names)
    save(lateral_gain(sessions), picture, "--out")
    text = "\n".join([*lines, f"\n![Lateral over forward gain by session]({picture.name})\n"])
    files.write(report, text.encode(), "--out")
    files.write(values, msgspec.json.format(msgspec.json.encode(result)) + b"\n", "--out")
    files.write(model, robot_file(robot, result).encode(), "--out")
    return [report, picture, values, model]


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
        f"min. The reference's clock is {_estimate(result.offset_s, 1e3)} ms ahead of the "
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
        yield f"| {count} | {rollers_gain(count):.4f} | {interval(behind, 0)} |"
    yield (
        f"\nLateral over forward gain: {interval(result.lateral_gain, 4)}, with the 95 % interval "
        "over sessions. That of a single session is over blocks of windows.\n"
    )
    yield "| session | runs | lateral over forward gain | time without a log of the wheels |"
    yield "| --- | --- | --- | --- |"
    for session in result.sessions:
        gain = interval(session.lateral_gain, 4)
        yield f"| {session.session} | {session.runs} | {gain} | {session.missing:.1%} |"
    if result.motors:
        yield "\n## Motors\n"
        yield "| parameter | value, 95 % interval by the curvature |"
        yield "| --- | --- |"
        yield from (f"| {name} | {_estimate(value)} |" for name, value in result.motors.items())
    for name, model in result.models.items():
        yield f"\n## Parameters: {name}\n"
        yield "| parameter | value, 95 % interval over sessions | ± by the curvature |"
        yield "| --- | --- | --- |"
        for parameter, estimate in model.parameters.items():
            yield f"| {parameter} | {_estimate(estimate)} | {estimate.curvature:.2g} |"
        yield from (f"\n- {line}" for line in model.ambiguities)


def _estimate(estimate: Estimate, scale: float = 1.0) -> str:
    value = f"{scale * estimate.value:.5g}"
    if math.isnan(estimate.low):
        return value
    return f"{value} ({scale * estimate.low:.5g} to {scale * estimate.high:.5g})"


def validation_lines(result: Validation) -> Iterator[str]:
    """Yield the report of a validation as Markdown."""
    yield "# Validation\n"
    yield (
        f"Fitted on {len(result.fitted)} sessions, validated on {len(result.held_out)} others "
        f"({result.duration_s / 60.0:.0f} min). Drift after {HORIZON_S:g} s: median (95 % interval "
        "over sessions; of two, half of their difference on both sides), 95th percentile.\n"
    )
    yield "| model | path | position [mm] | yaw [mrad] |"
    yield "| --- | --- | --- | --- |"
    for (model, path), drift in result.drifts.items():
        cells = (
            f"{interval(median, 1, 1e3)}, {1e3 * p95.mean:.1f}"
            for median, p95 in (drift[:2], drift[2:])
        )
        yield f"| {model} | {path} | {' | '.join(cells)} |"


def interval(value: Interval, digits: int, scale: float = 1.0) -> str:
    """Return a value with its interval, or with both values of two; a single one has none."""
    mean, low, high = (f"{scale * each:.{digits}f}" for each in (value.mean, *value.ends))
    return mean if value.n == 1 else f"{mean} ({low}{', ' if value.n == 2 else ' to '}{high})"


def lateral_gain(sessions: Sequence[SessionResult]) -> Figure:
    """Return lateral over forward gain by session, beside the gain of wheels with N rollers."""
    with style.context(STYLE):
        figure = Figure(figsize=(2.0 * COLUMN_IN, 0.9 * COLUMN_IN), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        paths = [result.session.split("_")[0] for result in sessions]
        for path, colour in zip(dict.fromkeys(paths), PALETTE, strict=False):
            positions = [index for index, name in enumerate(paths) if name == path]
            gains = [sessions[index].lateral_gain for index in positions]
            means, bars = (
                [gain.mean for gain in gains],
                [gain.ends[1] - gain.mean for gain in gains],
            )
            left.errorbar(positions, means, bars, fmt="o", ms=2.5, lw=0.8, color=colour, label=path)
        names = [result.session.split("_")[-1] for result in sessions]
        left.set_xticks(range(len(names)), names, rotation=90)
        left.set(xlabel="session", ylabel="lateral over forward gain")
        left.legend(loc="upper left")
        counts = list(ROLLER_COUNTS)
        right.plot(counts, [rollers_gain(n) for n in counts], "o", ms=2.5, color=ORANGE)
        mean = mean_gain(sessions)
        for axes in (left, right):
            axes.axhspan(*mean.ends, color=BLUE, alpha=0.2, lw=0.0)
            axes.axhline(1.0, color="black", lw=0.5, ls=DASHES)
        right.annotate("ideal kinematics", (5.0, 1.0), (0, -7), textcoords="offset points")
        right.set(xlabel="rollers in contact per turn, N", title="sin(π/N)/(π/N)", xticks=counts)
        left.set_title("mean over sessions with its 95 % interval as a band")
    return figure
