"""The report of an identification: Markdown, JSON and the robot file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import tomli_w
from mecazen.robot import Robot
from mecazen_tools import files

from mecazen_experiments.identify.fit import Estimate
from mecazen_experiments.identify.identification import Identification, ModelResult
from mecazen_experiments.identify.models import FRAME, rollers_gain


def write(found: Identification, robot: Robot, figures: Sequence[Path], folder: Path) -> list[Path]:
    """Write report.md, identification.json and robot.toml into a folder; return the files."""
    content = {
        "report.md": markdown(found, figures).encode(),
        "identification.json": msgspec.json.format(msgspec.json.encode(found, enc_hook=str))
        + b"\n",
        "robot.toml": robot_file(robot, found).encode(),
    }
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
        gap = "" if behind is None else f"{behind.mean:.3f} ({behind.low:.3f} to {behind.high:.3f})"
        yield f"| {model.name} | {own} | {model.held_out:.3f} | {gap} |"
    yield "\n## Rollers\n"
    yield (
        "The lateral gain is all that the number of rollers changes in these data. So each N is a "
        "hypothesis that rollers alone cause it: slip, or rollers that give way, would look like "
        "fewer rollers.\n"
    )
    yield "| N | sin(π/N)/(π/N) | log-likelihood behind the best | chosen by resampled sessions |"
    yield "| --- | --- | --- | --- |"
    for one in found.rollers:
        expected = rollers_gain(one.count)
        yield f"| {one.count} | {expected:.4f} | {one.behind:.0f} | {one.chosen:.0%} |"
    gain = found.lateral_gain
    yield (
        f"\nLateral over forward gain: {gain.mean:.4f}, 95 % interval over {gain.n} sessions "
        f"{gain.low:.4f} to {gain.high:.4f}.\n"
    )
    yield "| session | runs | lateral over forward gain | time without a log of the wheels |"
    yield "| --- | --- | --- | --- |"
    for session in found.sessions:
        interval = f"{session.lateral_gain:.4f} ({session.low:.4f} to {session.high:.4f})"
        yield f"| {session.session} | {session.runs} | {interval} | {session.missing:.1%} |"
    for model in found.models:
        yield from _parameters(model)
    yield from (f"\n![{path.stem}]({path.name})" for path in figures)


def _parameters(model: ModelResult) -> Iterator[str]:
    if not model.parameters:
        return
    yield f"\n## Parameters: {model.name}\n"
    yield "| parameter | value, 95 % interval by resampled runs | ± by the curvature |"
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
