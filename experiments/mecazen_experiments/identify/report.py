"""The report of an identification: Markdown, JSON and the robot file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
import tomli_w
from mecazen.robot import Robot
from mecazen_tools import files

from mecazen_experiments.identify.fit import Estimate
from mecazen_experiments.identify.identification import Identification, ModelResult
from mecazen_experiments.identify.models import FRAME, rollers_gain
from mecazen_experiments.identify.validate import Validation
from mecazen_experiments.statistics import Interval


def write_validation(
    found: Validation, robot: Robot, figures: Sequence[Path], folder: Path
) -> list[Path]:
    """Write validation.md, validation.json and robot.toml into a folder; return the files."""
    lines = "\n".join(validation_lines(found))
    shown = "\n".join(f"\n![{path.stem}]({path.name})" for path in figures)
    return _write(
        {
            "validation.md": f"# Validation\n\n{lines}\n{shown}\n".encode(),
            "validation.json": _json(found),
            "robot.toml": robot_file(robot, found.identification).encode(),
        },
        folder,
    )


def write(found: Identification, robot: Robot, figures: Sequence[Path], folder: Path) -> list[Path]:
    """Write report.md, identification.json and robot.toml into a folder; return the files."""
    return _write(
        {
            "report.md": markdown(found, figures).encode(),
            "identification.json": _json(found),
            "robot.toml": robot_file(robot, found).encode(),
        },
        folder,
    )


def _json(found: object) -> bytes:
    return msgspec.json.format(msgspec.json.encode(found)) + b"\n"


def _write(content: Mapping[str, bytes], folder: Path) -> list[Path]:
    for name, data in content.items():
        files.write(folder / name, data, "--out")
    return [folder / name for name in content]


def robot_file(robot: Robot, found: Identification) -> str:
    """Return an identified robot as a robot file."""
    tables = {k: v for k, v in msgspec.to_builtins(robot).items() if v is not None}
    return (
        f"# Identified by `mecazen identify` from {found.runs} runs; masses, heights and motors "
        f"are those of {found.robot}.\n{tomli_w.dumps(tables)}"
    )


def markdown(found: Identification, figures: Sequence[Path]) -> str:
    """Return the report as Markdown."""
    return "\n".join(_lines(found, figures)) + "\n"


def _lines(found: Identification, figures: Sequence[Path]) -> Iterator[str]:
    yield f"# Identification of {found.robot}\n"
    yield (
        f"{found.runs} runs of {len(found.sessions)} sessions, {found.duration_s / 60.0:.0f} min. "
        f"The reference's clock is {_estimate(found.offset_s, 1e3)} ms ahead of the wheels'.\n"
    )
    yield from (f"- {note}" for note in found.notes)
    yield "## Models\n"
    yield (
        "Log-likelihood per window of 0.5 s of sessions that the model was not fitted to (two "
        "folds), and how far each model is behind the best, with a 95 % interval over sessions.\n"
    )
    yield "| model | parameters | held-out log-likelihood | behind the best |"
    yield "| --- | --- | --- | --- |"
    for model in found.models:
        own = sum(not name.startswith(FRAME) for name in model.parameters)
        behind = model.behind
        gap = "" if behind is None else interval(behind, 3)
        held_out = "needs two runs" if math.isnan(model.held_out) else f"{model.held_out:.3f}"
        yield f"| {model.name} | {own} | {held_out} | {gap} |"
    yield "\n## Rollers\n"
    yield (
        "The lateral gain is all that the number of rollers changes in these data. So each N is a "
        "hypothesis that rollers alone cause it: slip, or rollers that give way, would look like "
        "fewer rollers.\n"
    )
    yield "| N | sin(π/N)/(π/N) | log-likelihood behind the best (95 % interval over sessions) |"
    yield "| --- | --- | --- |"
    for one in found.rollers:
        expected = rollers_gain(one.count)
        yield f"| {one.count} | {expected:.4f} | {interval(one.behind, 0)} |"
    yield (
        f"\nLateral over forward gain: {interval(found.lateral_gain, 4)}, with the 95 % interval "
        "over sessions. That of a single session is over blocks of windows.\n"
    )
    yield "| session | runs | lateral over forward gain | time without a log of the wheels |"
    yield "| --- | --- | --- | --- |"
    for session in found.sessions:
        gain = interval(session.lateral_gain, 4)
        yield f"| {session.session} | {session.runs} | {gain} | {session.missing:.1%} |"
    if found.motors:
        yield "\n## Motors\n"
        yield "| parameter | value, 95 % interval by the curvature |"
        yield "| --- | --- |"
        yield from (f"| {name} | {_estimate(one)} |" for name, one in found.motors.items())
    for model in found.models:
        yield from _parameters(model)
    yield from (f"\n![{path.stem}]({path.name})" for path in figures)


def _parameters(model: ModelResult) -> Iterator[str]:
    if not model.parameters:
        return
    yield f"\n## Parameters: {model.name}\n"
    yield "| parameter | value, 95 % interval over sessions | ± by the curvature |"
    yield "| --- | --- | --- |"
    for name, one in model.parameters.items():
        yield f"| {name} | {_estimate(one)} | {one.curvature:.2g} |"
    for line in model.ambiguities:
        yield f"\n- {line}"


def _estimate(one: Estimate, scale: float = 1.0) -> str:
    value = f"{scale * one.value:.5g}"
    if math.isnan(one.low):
        return value
    return f"{value} ({scale * one.low:.5g} to {scale * one.high:.5g})"


def validation_lines(found: Validation) -> Iterator[str]:
    """Yield the tables of a validation as Markdown."""
    yield (
        f"Fitted on {len(found.fitted)} sessions, validated on {len(found.held_out)} others "
        f"({found.duration_s / 60.0:.0f} min).\n"
    )
    horizons = list(dict.fromkeys(one.horizon_s for one in found.drifts))
    rows = list(dict.fromkeys((one.model, one.kind) for one in found.drifts))
    of = {(one.model, one.kind, one.horizon_s): one for one in found.drifts}
    for name, unit in (("position", "mm"), ("yaw", "mrad")):
        yield (
            f"Drift in {name} [{unit}]: median (95 % interval over sessions; of two, half of their "
            "difference on both sides), 95th percentile.\n"
        )
        yield f"| model | path | {' | '.join(f'{horizon:g} s' for horizon in horizons)} |"
        yield f"| --- | --- |{' --- |' * len(horizons)}"
        for model, kind in sorted(rows, key=lambda row: row[1]):
            cells = []
            for horizon in horizons:
                one = of[model, kind, horizon]
                pair = (one.position_median_m, one.position_p95_m)
                if name == "yaw":
                    pair = (one.yaw_median_rad, one.yaw_p95_rad)
                cells.append(f"{interval(pair[0], 1, 1e3)}, {1e3 * pair[1].mean:.1f}")
            yield f"| {model} | {kind} | {' | '.join(cells)} |"
        yield ""
    yield "Median drift less that of another model after the longest time, in pairs [mm].\n"
    yield "| model | less | path | sessions | difference (95 % interval over sessions) |"
    yield "| --- | --- | --- | --- | --- |"
    for pair_ in found.differences:
        yield (
            f"| {pair_.model} | {pair_.other} | {pair_.kind} | {pair_.sessions} | "
            f"{interval(pair_.position_m, 1, 1e3)} |"
        )


def interval(one: Interval, digits: int, scale: float = 1.0) -> str:
    """Return a value with its interval, or with both values of two; a single one has none."""
    value, low, high = (f"{scale * each:.{digits}f}" for each in (one.mean, *one.ends))
    return value if one.n == 1 else f"{value} ({low}{', ' if one.n == 2 else ' to '}{high})"
